"""Trajectories over all of time: segments between breakpoints, and a tail on either side."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, Indices
from invtrack.plans.tail import Side, Tail
from invtrack.plans.two_sided import DrivenSystem
from invtrack.references.signal import finite_times, selection

SAMPLES = 2000
"""Points between the first and the last breakpoint at which peaks are looked for, beside the breakpoints."""


class Segments(Protocol):
    """Segments of one kind, numbered from 0 on; values stack what the trajectory consists of (r,)."""

    @property
    def rows(self) -> int:
        """How many values there are, r."""
        ...

    @property
    def pace(self) -> float:
        """How fast the values can change [rad/s]."""
        ...

    @property
    def lasting_pace(self) -> float:
        """How fast they change where what dies out within a radian of its own is gone, away from both ends [rad/s]."""
        ...

    def values(self, number: Indices, since: Array, until: Array, rows: slice, resolution: float) -> Array:
        """Values (k, rows) at k times.

        Args:
            number: of the segment of each time (k,).
            since, until: distance of each time from the start and from the end of its segment (k,) [s].
            rows: which of the r values.
            resolution: by how much rounding may have moved the times [s].
        """
        ...

    def derivative(self) -> Segments:
        """Segments whose values are the time derivatives of these."""
        ...

    def mapped(self, M: Array) -> Segments:
        """Segments whose values are M (., r) times these."""
        ...


@dataclass(frozen=True, eq=False)
class TwoSidedSegments:
    """Segments of one driven two-sided system.

    Args:
        driven: the system.
        start: forward part and reference's state [z_f; w] at the segments' starts (k, n_f + q).
        end: backward part and reference's state [z_b; w] at their ends (k, n_b + q).
    """

    driven: DrivenSystem
    start: Array
    end: Array

    @property
    def rows(self) -> int:
        """How many values there are, r."""
        return len(self.driven.X_w)

    @property
    def pace(self) -> float:
        """How fast the values can change [rad/s]."""
        return self.driven.pace

    @property
    def lasting_pace(self) -> float:
        """How fast they change away from both ends [rad/s]."""
        return self.driven.lasting_pace

    def values(self, number: Indices, since: Array, until: Array, rows: slice, resolution: float) -> Array:
        """X_f z_f + X_w w, integrated from the start, plus X_b z_b, integrated from the end.

        Args:
            number, since, until, rows, resolution: see `Segments.values`.
        """
        forward, backward = self.driven.system.forward, self.driven.system.backward
        X_w = self.driven.X_w[rows]
        result = np.zeros((len(number), len(X_w)))
        both = self.driven.propagators
        if both[0].size:
            result += both[0].outputs(np.hstack([forward.X[rows], X_w]), self.start, number, since, resolution=resolution)
        if backward.size:
            backward_rows = np.hstack([backward.X[rows], np.zeros_like(X_w)])
            result += both[1].outputs(backward_rows, self.end, number, until, resolution=resolution)
        return result

    def derivative(self) -> TwoSidedSegments:
        """Segments whose values are the time derivatives of these."""
        return replace(self, driven=self.driven.derivative())

    def mapped(self, M: Array) -> TwoSidedSegments:
        """Segments whose values are M (., r) times these."""
        return replace(self, driven=self.driven.mapped(M))


@dataclass(frozen=True, eq=False)
class PolynomialSegments:
    """Segments with values sum_i coefficients[k, i] (since / lengths[k])^i: coefficients (k, degree + 1, r), lengths (k,) [s]."""

    coefficients: Array
    lengths: Array

    @property
    def rows(self) -> int:
        """How many values there are, r."""
        return int(self.coefficients.shape[2])

    @property
    def pace(self) -> float:
        """How fast the values can change [rad/s]."""
        return float((self.coefficients.shape[1] - 1) / np.min(self.lengths, initial=np.inf))

    @property
    def lasting_pace(self) -> float:
        """The same: nothing of a polynomial dies out."""
        return self.pace

    def values(self, number: Indices, since: Array, until: Array, rows: slice, resolution: float) -> Array:
        """The polynomials' values, by Horner's scheme.

        Args:
            number, since, until, rows, resolution: see `Segments.values`.
        """
        share = np.clip(since / self.lengths[number], 0.0, 1.0)[:, None]
        chosen = self.coefficients[number][:, :, rows]
        result = chosen[:, -1].copy()
        for order in range(chosen.shape[1] - 2, -1, -1):
            result *= share
            result += chosen[:, order]
        return result

    def derivative(self) -> PolynomialSegments:
        """Segments whose values are the time derivatives of these."""
        order = np.arange(1, max(self.coefficients.shape[1], 2))
        raised = self.coefficients[:, 1:] if self.coefficients.shape[1] > 1 else np.zeros_like(self.coefficients)
        return replace(self, coefficients=raised * order[:, None] / self.lengths[:, None, None])

    def mapped(self, M: Array) -> PolynomialSegments:
        """Segments whose values are M (., r) times these."""
        return replace(self, coefficients=self.coefficients @ M.T)


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Values (r,) over all of time, for a plan [x; u; y] as deviations from the rest of the interval in which each piece lies.

    There are m + 2 pieces: 0 is the tail before t_0, piece j the segment from t_(j-1) to t_j, the last one the tail after t_m. A
    time on a breakpoint belongs to both sides; the caller says which piece is meant.

    Args:
        breakpoints: t_0 ... t_m (m + 1,) [s].
        groups: the segments by their kinds.
        group, number: which group, and which of its segments, each inner piece is (m,).
        before, after: the tails.
    """

    breakpoints: Array
    groups: tuple[Segments, ...]
    group: Indices
    number: Indices
    before: Tail
    after: Tail

    @property
    def rows(self) -> int:
        """How many values there are, r."""
        return len(self.before.X_w)

    def locate(self, t: ArrayLike) -> Indices:
        """Index of the piece that holds each time; a breakpoint belongs to the piece on its right."""
        return np.searchsorted(self.breakpoints, np.asarray(t, dtype=float), side="right")

    def __call__(self, times: Array, piece: Indices, rows: slice = slice(None)) -> Array:
        """Values at times (k,) taken in the pieces (k,) stated, all or some of their rows: (k, r)."""
        edges, last = self.breakpoints, len(self.breakpoints)
        result = np.empty((len(times), len(range(self.rows)[rows])))
        for end, tail, edge in ((0, self.before, edges[0]), (last, self.after, edges[-1])):
            chosen = selection(piece == end)
            if chosen is not None:
                distance = np.maximum(tail.direction * (times[chosen] - edge), 0.0)
                result[chosen] = tail.values(distance, rows, _resolution(times[chosen]))
        inner = np.clip(piece, 1, last - 1) - 1
        group = np.where((piece > 0) & (piece < last), self.group[inner] if len(self.group) else -1, -1)
        for index, segments in enumerate(self.groups):
            chosen = selection(group == index)
            if chosen is None:
                continue
            at, t = inner[chosen], times[chosen]
            since, until = np.maximum(t - edges[at], 0.0), np.maximum(edges[at + 1] - t, 0.0)
            result[chosen] = segments.values(self.number[at], since, until, rows, _resolution(t))
        return result

    def at(self, t: ArrayLike, inside: ArrayLike | None, rows: slice = slice(None)) -> Array:
        """Values at times t (k,) in the pieces that hold the times `inside` (by default t itself)."""
        times, within = finite_times(t, inside)
        return self(times, self.locate(within), rows)

    @cached_property
    def peaks(self) -> Array:
        """Largest size of each value from the first to the last breakpoint (r,)."""
        edges = self.breakpoints
        even = np.linspace(edges[0], edges[-1], SAMPLES + 1)  # apart from the edges, so that they stay recognizable as even
        return np.asarray(np.max([np.max(np.abs(self(times, self.locate(times))), axis=0) for times in (even, edges)], axis=0))

    def settled(self) -> Trajectory:
        """The trajectory without the departures before and after it: there it is at rest, or moves with the reference."""
        before, after = (replace(tail, v=np.zeros_like(tail.v)) for tail in (self.before, self.after))
        return replace(self, before=before, after=after)

    def paces(self) -> Array:
        """How fast the values of each piece can change [rad/s], (m + 2,)."""
        return self._of_pieces(self.before.pace, [segments.pace for segments in self.groups], self.after.pace)

    def lasting_paces(self) -> Array:
        """How fast the values of each piece change away from its ends [rad/s], (m + 2,)."""
        return self._of_pieces(self.before.lasting_pace, [each.lasting_pace for each in self.groups], self.after.lasting_pace)

    def _of_pieces(self, before: float, groups: Sequence[float], after: float) -> Array:
        """For each piece, m + 2 in all, the pace of its group or tail."""
        inner = np.array(groups)[self.group] if len(self.group) else np.zeros(0)
        return np.concatenate([[before], inner, [after]])

    def derivative(self) -> Trajectory:
        """The time derivative, piece by piece."""
        return self._each(lambda segments: segments.derivative(), lambda tail: tail.derivative())

    def mapped(self, M: Array) -> Trajectory:
        """The trajectory of M (., r) times the values."""
        return self._each(lambda segments: segments.mapped(M), lambda tail: tail.mapped(M))

    def _each(self, change: Callable[[Segments], Segments], change_tail: Callable[[Tail], Tail]) -> Trajectory:
        groups = tuple(change(segments) for segments in self.groups)
        return replace(self, groups=groups, before=change_tail(self.before), after=change_tail(self.after))


def away_from_rest(trajectory: Trajectory, side: Side, time: float) -> float:
    """How far a trajectory is at a time [s] from its rest before or after it: the largest share of a value's peak."""
    tail, edge = (
        (trajectory.before, trajectory.breakpoints[0]) if side == "before" else (trajectory.after, trajectory.breakpoints[-1])
    )
    distance, peaks = tail.direction * (time - float(edge)), trajectory.peaks
    if distance >= 0:
        return float(tail.shares(np.array([distance]), peaks)[0])
    return float(np.max(np.abs(trajectory.at([time], None)[0] - tail.held) / np.where(peaks > 0, peaks, 1.0)))


def grouped(breakpoints: Array, owner: Indices, make: Callable[[int, Indices], Segments], before: Tail, after: Tail) -> Trajectory:
    """The trajectory whose inner pieces have owners; the pieces of one owner form a group.

    Args:
        breakpoints: edges of the inner pieces (m + 1,) [s].
        owner: of each inner piece (m,), any whole numbers.
        make: from an owner, and the numbers of its pieces among the inner ones, to its segments.
        before, after: the tails.
    """
    owners, group = np.unique(owner, return_inverse=True)
    number = np.empty(len(owner), dtype=np.intp)
    groups = []
    for index, which in enumerate(owners.tolist()):
        pieces = np.flatnonzero(group == index)
        number[pieces] = np.arange(len(pieces))
        groups.append(make(int(which), pieces))
    return Trajectory(breakpoints, tuple(groups), group, number, before, after)


def _resolution(times: Array) -> float:
    """How far times [s] of this size are off by rounding."""
    return 4 * float(np.spacing(np.max(np.abs(times))))
