"""S-curves: motions from rest to rest as fast as limits on velocity, acceleration and jerk allow."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, as_divisor, finite_number, real_numbers, require_duration
from invtrack.errors import TrajectoryError
from invtrack.references.profiles import piecewise_polynomial
from invtrack.references.signal import PiecewiseSignal, channel_values

SHORTEST_PHASE = 1e-9
"""A phase below this share of the motion is rounding of one that is not there."""


def s_curve(
    start: ArrayLike,
    end: ArrayLike,
    *,
    max_jerk: ArrayLike | None = None,
    duration: float | None = None,
    max_velocity: ArrayLike = np.inf,
    max_acceleration: ArrayLike = np.inf,
    start_time: float = 0.0,
) -> PiecewiseSignal:
    """The motion from rest at `start` to rest at `end` whose jerk has one size throughout, or is zero: an S-curve.

    With `max_jerk` it is the fastest within the limits; with `duration` the one of least jerk that takes as long, within the limits
    on velocity and acceleration. Up to seven phases of constant jerk: acceleration builds up, holds, goes down; velocity holds; and
    the same backward. Velocity and acceleration are continuous, jerk is not: it serves the inverse of a plant of relative degree up
    to 3. Several channels move in proportion to each other, at the pace of the one that is nearest to its limits.

    Args:
        start, end: values (p,) or scalar, held before and after, in some unit.
        max_jerk: largest jerk (p,) or scalar [unit/s^3].
        duration: how long the motion takes [s]; either this or `max_jerk`.
        max_velocity, max_acceleration: (p,) or scalar [unit/s], [unit/s^2]; unlimited unless stated.
        start_time: when the motion begins [s].

    Raises TrajectoryError for limits that are not positive, ends that are not finite or the same, a duration too short for the
    limits, and where not just one of max_jerk and duration is given. Source: P. Lambrechts, M. Boerlage, M. Steinbuch, "Trajectory
    planning and feedforward design for electromechanical motion systems", Control Engineering Practice 13(2), 2005.
    """
    y_0, y_f = channel_values("start", start), channel_values("end", end)
    if y_0.shape != y_f.shape:
        raise TrajectoryError(f"start and end must have the same channels, got shapes {y_0.shape} and {y_f.shape}")
    distance = np.abs(y_f - y_0)
    if not np.any(distance):
        raise TrajectoryError("start and end are the same, so there is no motion; invtrack.references.constant(value) stands still")
    if (max_jerk is None) == (duration is None):
        raise TrajectoryError(
            "expected either max_jerk, for the fastest motion within the limits, or duration, for the one of least jerk, got "
            f"{'neither' if duration is None else 'both'}"
        )
    v, a = (
        _limit(name, limit, distance, finite=False)
        for name, limit in (("max_velocity", max_velocity), ("max_acceleration", max_acceleration))
    )
    if duration is None:
        phases = _fastest(v, a, _limit("max_jerk", max_jerk, distance, finite=True))
    else:
        require_duration("duration", duration)
        phases = _smoothest(v, a, float(duration))
    return phases.signal(y_0, y_f, finite_number("start_time", start_time, unit="s"))


@dataclass(frozen=True)
class _Phases:
    """A motion over the distance 1: phases of constant jerk, acceleration and velocity, each of its length [s]."""

    jerk: float
    acceleration: float
    velocity: float

    def signal(self, y_0: Array, y_f: Array, start_time: float) -> PiecewiseSignal:
        """From y_0 to y_f (p,); worked out in the motion's own duration as unit of time."""
        given = np.array([self.jerk, self.acceleration, self.jerk, self.velocity, self.jerk, self.acceleration, self.jerk])
        duration = float(np.sum(given))
        if not (0 < duration < np.inf and self.jerk > SHORTEST_PHASE * duration):
            raise TrajectoryError(
                f"phases of {self.jerk:.3g} s of constant jerk in a motion of {duration:.3g} s are beyond what floating-point "
                "numbers resolve; choose limits, or a duration, that are nearer to each other"
            )
        lengths = given / duration
        T_j, T_a, T_v = lengths[0], lengths[1], lengths[3]
        j = 1 / (T_j * (T_j + T_a) * (2 * T_j + T_a + T_v))
        kept = lengths > SHORTEST_PHASE
        lengths, jerks = lengths[kept], np.array([j, 0.0, -j, 0.0, -j, 0.0, j])[kept]
        states = [np.zeros(3)]  # place, velocity and acceleration at the start of each phase
        for tau, jerk in zip(lengths.tolist(), jerks.tolist(), strict=True):
            s, v, a = states[-1]
            states.append(
                np.array([s + tau * (v + tau * (a / 2 + tau * jerk / 6)), v + tau * (a + tau * jerk / 2), a + tau * jerk])
            )
        motion = (y_f - y_0)[:, np.newaxis]
        coefficients = [
            np.hstack([y_0[:, np.newaxis] + motion * s, motion * [v, a / 2, jerk / 6]])
            for (s, v, a), jerk in zip(states[:-1], jerks.tolist(), strict=True)
        ]
        edges = start_time + duration * np.concatenate([[0.0], np.cumsum(lengths)])
        return piecewise_polynomial(edges, coefficients, time_scale=duration, held=(y_0, y_f))


def _limit(name: str, value: ArrayLike | None, distance: Array, *, finite: bool) -> float:
    """A limit (p,) or scalar as one for the motion over the distance 1 in which all channels (p,) take part."""
    limits = real_numbers(name, np.inf if value is None else value)
    highest = np.finfo(float).max if finite else np.inf
    if limits.shape not in ((), distance.shape) or not np.all((limits > 0) & (limits <= highest)):
        kind = "positive and finite" if finite else "positive"
        raise TrajectoryError(
            f"{name} must be {kind}, one for all or one for each of {len(distance)} channels, got {limits.tolist()}"
        )
    return float(np.min(np.where(distance > 0, limits, np.inf) / as_divisor(distance)))


def _fastest(v: float, a: float, j: float) -> _Phases:
    """The phases of the fastest motion within the limits, in units of time in which the limit on jerk is 1 on the way."""
    unit = math.cbrt(1 / j)
    v, a = v * unit, a * unit * unit
    T_j = min(math.cbrt(0.5), math.sqrt(v), a)
    if T_j == 0.0:
        return _Phases(0.0, 0.0, 0.0)
    T_a = max(0.0, min(math.sqrt(T_j * T_j / 4 + 1 / T_j) - 1.5 * T_j, v / T_j - T_j))
    T_v = max(0.0, 1 / (T_j * (T_j + T_a)) - 2 * T_j - T_a)
    return _Phases(unit * T_j, unit * T_a, unit * T_v)


def _smoothest(v: float, a: float, T: float) -> _Phases:
    """The phases of the motion of least jerk that takes T [s] within the limits on velocity and acceleration."""
    least = 1 / v + v / a if v * v < a else 2 / math.sqrt(a)
    if least >= T:
        raise TrajectoryError(
            f"duration must be more than the {least:.6g} s that the limits on velocity and acceleration take however large the "
            f"jerk, got {T} s; allow more time or raise the limits"
        )
    peak = 2 / T
    if peak <= v:  # its peak, whether the acceleration is limited or not
        T_j = min(T / 4, T / 2 - 2 / (a * T))
        return _Phases(T_j, T / 2 - 2 * T_j, 0.0)
    T_j = (T - 1 / v) / 2
    if v / T_j <= a:
        return _Phases(T_j, 0.0, 2 / v - T)
    T_j = T - v / a - 1 / v
    return _Phases(T_j, v / a - T_j, 1 / v - T_j - v / a)
