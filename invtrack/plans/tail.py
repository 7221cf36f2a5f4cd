"""The two ends of a trajectory: what dies out away from the manoeuvre, around what the reference does there for ever."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np

from invtrack.arrays import Array
from invtrack.linear.propagation import Propagator
from invtrack.linear.scaling import pace_of

Side = Literal["before", "after"]
"""Of a manoeuvre."""

SIDES: tuple[Side, Side] = ("before", "after")

SAMPLES = 2000
"""Resolution with which a decay time is found, in shares of itself."""

AT_REST = 1e-12
"""A reference's state that changes by less than this share of its terms holds still."""


LOW_DEGREE = 20
"""States of a reference's generator up to which it may make polynomials, but none that change much within a piece of theirs."""


def generator_pace(S: Array) -> float:
    """How fast a reference w' = S w changes [rad/s], S (q, q): polynomials of a low degree count as slow, however short."""
    if len(S) > LOW_DEGREE:
        return pace_of(S)
    return float(np.max(np.abs(np.linalg.eigvals(S)), initial=0.0))


@dataclass(frozen=True, eq=False)
class Tail:
    """values = X exp(M sigma) v + X_w exp(direction S sigma) w at distance sigma >= 0 [s] from the edge of the manoeuvre.

    The first term is the departure, which dies out where M is stable; the second is the bounded particular solution for the
    reference's state, w' = S w, constant where the reference holds still.

    Args:
        direction: -1 before the manoeuvre, 1 after it.
        departure: exp(M sigma) for the departure's M (n, n).
        X, v: of the departure, (r, n) and (n,).
        S, X_w, w: of the particular solution, (q, q), (r, q) and (q,).
    """

    direction: int
    departure: Propagator
    X: Array
    v: Array
    S: Array
    X_w: Array
    w: Array

    @classmethod
    def holding(cls, direction: int, held: Array) -> Tail:
        """A tail that holds the values (r,)."""
        none = np.zeros((0, 0))
        return cls(
            direction, Propagator(none), np.zeros((len(held), 0)), np.zeros(0), np.zeros((1, 1)), held[:, np.newaxis], np.ones(1)
        )

    @cached_property
    def _particular(self) -> Propagator:
        return Propagator(self.direction * self.S)

    @cached_property
    def pace(self) -> float:
        """How fast the values can change [rad/s]."""
        return max(pace_of(self.S), self.departure.pace if self.departs else 0.0)

    @cached_property
    def lasting_pace(self) -> float:
        """How fast the values change beyond the first moments after the edge [rad/s]; see `Propagator.lasting_pace`."""
        return max(generator_pace(self.S), self.departure.lasting_pace if self.departs else 0.0)

    @property
    def held(self) -> Array:
        """Values (r,) of the particular solution at the edge; where the reference holds still there, at any distance."""
        return np.asarray(self.X_w @ self.w)

    @property
    def holds_still(self) -> bool:
        """Whether the reference does not move there."""
        return not np.any(np.abs(self.S @ self.w) > AT_REST * np.abs(self.S) @ np.abs(self.w))

    @property
    def departs(self) -> bool:
        """Whether there is anything but the particular solution. (Where there is not, M may well be unstable.)"""
        return bool(np.any(self.v))

    @property
    def lasts(self) -> bool:
        """Whether the departure does not die out."""
        return self.departs and self.departure.growth >= 0

    def values(self, distance: Array, rows: slice, resolution: float) -> Array:
        """Values (m, rows) at distances (m,) [s]; resolution [s]: how far these may be off as they are."""
        owner = np.zeros(len(distance), dtype=np.intp)
        result = self._particular.outputs(self.X_w[rows], self.w[np.newaxis], owner, distance, resolution=resolution)
        if self.departs:
            result += self.departure.outputs(self.X[rows], self.v[np.newaxis], owner, distance, resolution=resolution)
        return result

    def derivative(self) -> Tail:
        """The tail whose values are the time derivatives of this one's."""
        return replace(self, X=self.direction * self.X @ self.departure.M, X_w=self.X_w @ self.S)

    def mapped(self, M: Array) -> Tail:
        """The tail whose values are M (., r) times this one's."""
        return replace(self, X=M @ self.X, X_w=M @ self.X_w)

    def shares(self, distance: Array, peak: Array) -> Array:
        """Largest |departure| at each distance (m,) [s], as a share of each value's peak (r,)."""
        if not self.departs:
            return np.zeros(len(distance))
        values = np.abs(self.departure.outputs(self.X, self.v[np.newaxis], np.zeros(len(distance), dtype=np.intp), distance))
        size = np.maximum(peak, values.max(axis=0, initial=0.0))
        return np.asarray(np.max(values / np.where(size > 0, size, 1.0), axis=1))

    def decay_time(self, peak: Array, tolerance: float) -> float:
        """Distance [s] beyond which every value's departure stays below `tolerance` times its peak (r,); infinite if it lasts."""
        if not self.departs:
            return 0.0
        rate = -self.departure.growth
        if rate <= 0:
            return np.inf
        horizon = (np.log(1 / tolerance) + 25.0) / rate  # 25: room for values far above the peak and for non-normal growth
        for _ in range(4):  # zoom in on the last time above the tolerance, which may be far shorter than the slowest mode suggests
            distance = np.linspace(0.0, horizon, SAMPLES)
            above = np.flatnonzero(self.shares(distance, peak) > tolerance)
            if above.size == 0:
                return 0.0
            last = min(above[-1] + 1, SAMPLES - 1)
            if last > SAMPLES // 4:
                break
            horizon = distance[last] * 2
        return float(distance[last])
