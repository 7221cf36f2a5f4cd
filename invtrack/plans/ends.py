"""How long a decaying part of the inverse stays above a share of the peak."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.linear.propagation import flow
from invtrack.plans.plan import TwoSidedTrajectory

Array = NDArray[np.float64]

SAMPLES = 2000
"""Resolution with which the time is found, in shares of itself."""


@dataclass(frozen=True, eq=False)
class Departure:
    """X exp(M sigma) v, M stable: the part of [x; u; y] that dies out with distance sigma [s] from the manoeuvre."""

    M: Array
    X: Array
    v: Array

    def share_left(self, sigma: float, peak: Array) -> float:
        """Largest |value| at one distance, as a share of its peak."""
        return float(self.shares(np.array([sigma]), peak)[0])

    def shares(self, sigma: Array, peak: Array) -> Array:
        """Largest |value| at each distance (m,), as a share of its peak."""
        if not len(self.v):
            return np.zeros(len(sigma))
        values = np.abs(flow(self.M, np.broadcast_to(self.v, (len(sigma), len(self.v))), sigma) @ self.X.T)
        size = np.maximum(peak, values.max(axis=0, initial=0.0))
        return np.asarray(np.max(values / np.where(size > 0, size, 1.0), axis=1))


def decay_time(departure: Departure, peak: Array, tolerance: float) -> float:
    """Distance [s] beyond which every value stays below `tolerance` times its peak."""
    if not len(departure.v):
        return 0.0
    rate = -np.max(np.linalg.eigvals(departure.M).real)
    horizon = (np.log(1 / tolerance) + 25.0) / rate  # 25: room for values far above the peak and for non-normal growth
    for _ in range(4):  # zoom in on the last time above the tolerance, which may be far shorter than the slowest mode suggests
        sigma = np.linspace(0.0, horizon, SAMPLES)
        above = np.flatnonzero(departure.shares(sigma, peak) > tolerance)
        if above.size == 0:
            return 0.0
        last = min(above[-1] + 1, SAMPLES - 1)
        if last > SAMPLES // 4:
            break
        horizon = sigma[last] * 2
    return float(sigma[last])


def actuation_times(
    trajectory: TwoSidedTrajectory, departures: tuple[Departure, Departure], tolerance: float, limit: float | None
) -> tuple[float, float, tuple[str, ...]]:
    """Preactuation and postactuation [s] of a plan, and a remark where `limit` [s] cuts its preactuation short.

    departures: what dies out before and after the manoeuvre; peaks are those of the trajectory between its breakpoints.
    """
    start, end = trajectory.breakpoints[0], trajectory.breakpoints[-1]
    times = np.concatenate([np.linspace(start, end, SAMPLES + 1), trajectory.breakpoints])
    peak = np.max(np.abs(trajectory(times, trajectory.locate(times))), axis=0)
    preactuation, postactuation = (decay_time(departure, peak, tolerance) for departure in departures)
    if limit is None or preactuation <= limit:
        return preactuation, postactuation, ()
    share = departures[0].share_left(limit, peak)
    return limit, postactuation, (f"preactuation limited to {limit} s: the plan starts {share:.1e} of its peak away from rest",)
