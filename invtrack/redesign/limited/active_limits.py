"""Where a plan touches its limits, and what more room there would be worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.limited.limit_check import STEP_SHARES, tops, values_between
from invtrack.redesign.limited.transcription import LimitRows
from invtrack.redesign.limits import Bound

TOUCHING = 1e-5
"""A value nearer to its limit than this share of the limit's size counts as on it."""


@dataclass(frozen=True)
class ActiveStretch:
    """A time from `start` to `end` [s] in which a plan is at a limit.

    multiplier: by how much the cost falls per unit by which the limit is loosened during this stretch alone, to first order: the
    integral of the limit's Lagrange multiplier over it. Not negative.
    """

    start: float
    end: float
    multiplier: float


@dataclass(frozen=True)
class ActiveLimit:
    """A side of a limit that a plan touches.

    Args:
        name: of the limit.
        side: "low" or "high".
        limit: its value in absolute units.
        unit: of that value, "" where it is not known.
        stretches: when, in order.
    """

    name: str
    side: Literal["low", "high"]
    limit: float
    unit: str
    stretches: tuple[ActiveStretch, ...]

    @property
    def duration(self) -> float:
        """How long [s] it is touched in all."""
        return sum(stretch.end - stretch.start for stretch in self.stretches)

    @property
    def multiplier(self) -> float:
        """By how much the cost falls per unit by which this side is loosened, all the time, to first order. Not negative."""
        return sum(stretch.multiplier for stretch in self.stretches)

    @property
    def sensitivity(self) -> float:
        """d cost / d limit: negative for a high side, which is loosened by raising it, positive for a low one."""
        return self.multiplier if self.side == "low" else -self.multiplier

    def __str__(self) -> str:
        spans = ", ".join(f"{stretch.start:.6g} to {stretch.end:.6g} s" for stretch in self.stretches[:4])
        more = f" and {len(self.stretches) - 4} more" if len(self.stretches) > 4 else ""
        value = f"{self.limit:.6g} {self.unit}".rstrip()
        loosening = "raising" if self.side == "high" else "lowering"
        return (
            f"{self.name} is at its {self.side} limit {value} for {self.duration:.4g} s ({spans}{more}); "
            f"{loosening} it lowers the cost by {self.multiplier:.4g} per {self.unit or 'unit'}"
        )


def active_limits(trajectory: Trajectory, bounds: Sequence[Bound], rows: LimitRows, multipliers: Array) -> tuple[ActiveLimit, ...]:
    """Where the plan touches its limits between its breakpoints, by limit and side.

    rows: those by which the limits were imposed. multipliers: of these, (rows,), in cost per unit of what each limits.
    """
    values = values_between(trajectory, bounds, STEP_SHARES)
    edges, lengths = trajectory.breakpoints[:-1, None], np.diff(trajectory.breakpoints)[:, None]
    sides: tuple[tuple[Literal["low", "high"], int], ...] = (("low", -1), ("high", 1))
    found = []
    for number, (bound, value) in enumerate(zip(bounds, values, strict=True)):
        for side, sign in sides:
            limit = bound.low if sign < 0 else bound.high
            if not np.isfinite(limit):
                continue
            excess = sign * (value - limit)
            top, share = tops(excess)  # a limit may be touched between the instants
            shares = np.hstack([np.broadcast_to(STEP_SHARES, value.shape), share[:, None]])
            touches = np.hstack([excess, top[:, None]]) >= -TOUCHING * bound.size
            if np.any(touches):
                times = edges + lengths * shares
                order = np.argsort(times, axis=None, kind="stable")
                starts, ends = _runs(times.ravel()[order], touches.ravel()[order], times.shape[1])
                ours = (rows.bound == number) & (rows.side == sign)
                worth = _by_stretch(starts, ends, rows.time[ours], multipliers[ours])
                stretches = tuple(ActiveStretch(*map(float, stretch)) for stretch in zip(starts, ends, worth, strict=True))
                found.append(ActiveLimit(bound.name, side, float(limit + bound.offset), bound.unit, stretches))
    return tuple(found)


def _runs(times: Array, touches: NDArray[np.bool_], longest: int) -> tuple[Array, Array]:
    """Starts and ends of the stretches over which `touches` holds; within a step it may lift off, for up to `longest` instants."""
    at = np.flatnonzero(touches)
    breaks = np.flatnonzero(np.diff(at) > longest)
    return times[at[np.concatenate([[0], breaks + 1])]], times[at[np.concatenate([breaks, [len(at) - 1]])]]


def _by_stretch(starts: Array, ends: Array, times: Array, multipliers: Array) -> Array:
    """The sum of the multipliers of each stretch, each counted where its time is nearest: (stretches,)."""
    middle = (ends[:-1] + starts[1:]) / 2  # between one stretch and the next
    return np.asarray(np.bincount(np.searchsorted(middle, times), weights=multipliers, minlength=len(starts)), dtype=float)
