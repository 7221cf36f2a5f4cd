"""The two-sided boundary value problem: stretches of two-sided systems, joined at jumps, at rest or steady at both ends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.linear.state_sizes import unit_ratios
from invtrack.plans.boundary_value import BoundaryValueSolution, Conditions, solve
from invtrack.plans.junctions import at_rest, junctions
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.stretch import DrivenPieces, Stretch, piece_states, stretches
from invtrack.plans.trajectory import Trajectory, TwoSidedSegments, grouped
from invtrack.plans.two_sided import DrivenSystem, TwoSidedSystem, drive_units
from invtrack.references.generator import Generator


@dataclass(frozen=True, eq=False)
class Pieces:
    """Which driven two-sided system holds when, and the states of the reference that drives it.

    Args:
        breakpoints: edges of the m + 2 pieces (m + 1,) [s]; the first piece has no start, the last one no end.
        driven: the driven systems.
        which: for each piece, the number of its driven system among these (m + 2,).
        w_start, w_end: the reference's state at each piece's start and end (m + 2, q), padded to the largest q; of the first
            and the last piece both are the state at the one edge that they have.
    """

    breakpoints: Array
    driven: Sequence[DrivenSystem]
    which: Indices
    w_start: Array
    w_end: Array

    def anchor(self, end: int) -> Array:
        """The reference's state where the first piece ends (0), or where the last one starts (-1)."""
        return self.w_start[end, : len(self.driven[self.which[end]].S)]


@dataclass(frozen=True, eq=False)
class TwoSidedProblem(Pieces):
    """Two-sided systems joined at switches; the solution is bounded before and after the manoeuvre.

    Args:
        breakpoints, driven, which, w_start, w_end: see Pieces.
        owner: the interval of the plant in which each piece lies (m + 2,).
        systems: of each interval (N + 1,).
        switch_times: breakpoints at which the systems change (N,) [s].
        shifts: by how much what else is continuous jumps at each of them (N, m): with the rest from which states are measured.
        peaks: per switch the largest size anywhere of what the new system prescribes (rho,), since it may pass through zero there.
        ratios: size (m, m) that entry i of what is continuous has where entry j is 1 (`unit_ratios`); None: nothing is prescribed.
    """

    owner: Indices
    systems: Sequence[TwoSidedSystem]
    switch_times: Array
    shifts: Array
    peaks: Sequence[Array]
    ratios: Array | None = None

    def solve(self) -> TwoSidedSolution:
        """Every stretch's v from z_f steady before the manoeuvre, continuity at the switches, and z_b steady after it."""
        inner = DrivenPieces(self.driven, self.which[1:-1], np.diff(self.breakpoints), self.w_start[1:-1], self.w_end[1:-1])
        found = stretches(self.systems, self.owner[1:-1], inner)
        before, after = self.driven[self.which[0]], self.driven[self.which[-1]]
        z_first = before.steady()[0] @ self.anchor(0)
        z_last = after.steady()[1] @ self.anchor(-1)
        none = np.zeros((0, 0))
        joined = junctions(found, *self._joined(), self.shifts, self.peaks, self.ratios)
        conditions = [each.conditions for each in joined]
        sizes = [stretch.peaks for stretch in found] + [np.array([each.size for each in joined]), np.abs(z_first), np.abs(z_last)]
        last = found[-1]
        rest_before = Conditions(np.eye(len(z_first), found[0].system.size), none, z_first)
        rest_after = Conditions(np.eye(len(z_last), last.system.size, k=last.system.forward.size), none, z_last)
        boundary = solve(rest_before, conditions, rest_after)
        if boundary.freedom and len(last.system.neutral):  # where nothing is left open, rest is for the caller to judge
            boundary = solve(rest_before, conditions, at_rest(last, after.steady()[0] @ self.anchor(-1), z_last))
        return TwoSidedSolution(
            problem=self,
            stretches=found,
            conditions=[rest_before, *conditions],
            boundary=boundary,
            open_checks=[each.check for each in joined],
            compatibility_rows=[each.compatibility_rows for each in joined],
            size=float(np.max(np.concatenate(sizes), initial=0.0)),
        )

    def _joined(self) -> tuple[Array, Array]:
        """What the reference adds to what is continuous, J_w w, on both sides of each switch: (N, m) each."""
        right = np.searchsorted(self.breakpoints, self.switch_times, side="right")  # the pieces that start there
        sides = []
        for piece, w in ((right - 1, self.w_end), (right, self.w_start)):
            added, which = np.zeros_like(self.shifts), self.which[piece]
            for index in np.unique(which).tolist():
                driven, chosen = self.driven[index], which == index
                added[chosen] = w[piece[chosen], : len(driven.S)] @ driven.J_w.T
            sides.append(added)
        return sides[0], sides[1]


class Driveable(Protocol):
    """What a method makes of a linear model: a two-sided system that a reference can drive."""

    @property
    def system(self) -> TwoSidedSystem: ...

    def driven(self, generator: Generator) -> DrivenSystem:
        """The system with what a reference from this generator adds."""
        ...


def two_sided_problem(
    problem: PlanningProblem,
    models: Sequence[Driveable],
    *,
    shifts: Array | None = None,
    peaks: Sequence[Array] | None = None,
    one_unit: bool = True,
) -> TwoSidedProblem:
    """The two-sided problem of a plant and a reference.

    Args:
        problem: the plant and the reference.
        models: of each interval (N + 1,); those that recur share what is worked out.
        shifts: by how much the states jump with their rest at each switch (N, n), where what is continuous begins with them; none
            unless stated.
        peaks: see TwoSidedProblem; none where nothing is prescribed.
        one_unit: whether z_f and z_b are of one kind, to be compared with each other in one unit, and never in a smaller one.
    """
    reference = problem.deviation
    place = {key: number for number, key in enumerate(dict.fromkeys(map(id, models)))}
    model = np.array([place[id(each)] for each in models])
    distinct = [models[k] for k in np.unique(model, return_index=True)[1]]
    shape = (len(distinct), len(reference.generators))
    keys, which = np.unique(np.ravel_multi_index((model[problem.owner], reference.kind), shape), return_inverse=True)
    pairs = list(zip(*np.unravel_index(keys, shape), strict=True))
    driven = [distinct[k].driven(reference.generators[g]) for k, g in pairs]
    units = drive_units(driven)
    units = (max(1.0, *units),) * 2 if one_unit else units
    systems = [each.system.in_units(*units) for each in distinct]
    return TwoSidedProblem(
        breakpoints=reference.breakpoints,
        owner=problem.owner,
        systems=[systems[k] for k in model],
        switch_times=problem.plant.switch_times,
        shifts=_joined_shifts(problem, systems[0], shifts),
        driven=[each.in_units(*units, systems[k]) for each, (k, _) in zip(driven, pairs, strict=True)],
        which=which,
        w_start=reference.anchors,
        w_end=problem.end_anchors,
        peaks=peaks or [np.zeros(0)] * len(problem.plant.switch_times),
        ratios=None if peaks is None else _ratios(problem, systems[0]),
    )


def _joined_shifts(problem: PlanningProblem, system: TwoSidedSystem, shifts: Array | None) -> Array:
    """Shifts of states (N, n), with which what is continuous begins; costates jump with nothing: (N, m)."""
    found = np.zeros((len(problem.plant.switch_times), system.T.shape[1]))
    if shifts is not None:
        found[:, : shifts.shape[1]] = shifts
    return found


def _ratios(problem: PlanningProblem, system: TwoSidedSystem) -> Array:
    """`unit_ratios` of the states, with which what is continuous begins; costates stand for themselves."""
    m, ratios = system.T.shape[1], unit_ratios(problem.plant)
    return np.pad(ratios, (0, m - len(ratios)))


@dataclass(frozen=True, eq=False)
class TwoSidedSolution:
    """v of each stretch, [z_f at its start; z_b at its end], with how the equations were solved.

    Args:
        problem, stretches: what was solved.
        conditions: those of rest before the manoeuvre and those of each switch, rows of compatibility first.
        boundary: the solution of the boundary value problem.
        open_checks: per switch the compatibility row without unknowns that fails worst, and by how much, relative to its terms.
        compatibility_rows: per switch, how many others hold unknowns.
        size: largest right-hand side, the measure of what counts as consistent.
    """

    problem: TwoSidedProblem
    stretches: Sequence[Stretch]
    conditions: Sequence[Conditions]
    boundary: BoundaryValueSolution
    open_checks: list[tuple[int, float]]
    compatibility_rows: list[int]
    size: float

    def along(self, weights: Array) -> TwoSidedSolution:
        """The solution with this combination (f,) of what the equations leave open added."""
        return replace(self, boundary=self.boundary.along(weights))

    def compatibility_miss(self, switch: int) -> float:
        """By how much the rows of compatibility at a switch contradict what the past leaves, whatever the time after asks."""
        before, here, rows = self.conditions[: switch + 1], self.conditions[switch + 1], self.compatibility_rows[switch]
        compatibility = Conditions(here.left[:rows], np.zeros((0, 0)), here.rhs[:rows])
        return float(solve(before[0], before[1:], compatibility).inconsistency[-1])

    @property
    def first_b(self) -> Array:
        """z_b at the start of the manoeuvre."""
        return self.stretches[0].outer(self.boundary.values[0])[1]

    @property
    def last_f(self) -> Array:
        """z_f at the end of the manoeuvre."""
        return self.stretches[-1].outer(self.boundary.values[-1])[0]

    @property
    def unrest(self) -> tuple[Array, float]:
        """What keeps the neutral states of the last stretch from rest at its end (n_c,), and their peak in it."""
        stretch = self.stretches[-1]
        system, n = stretch.system, stretch.system.decaying
        steady = self.problem.driven[self.problem.which[-1]].steady()[0] @ self.problem.anchor(-1)
        start = np.abs(self.boundary.values[-1][n : system.forward.size])
        size = max(np.max(values, initial=0.0) for values in (stretch.peaks[n : system.forward.size], start))
        return system.moves_neutral @ (self.last_f - steady)[n:], float(size)

    def trajectory(self) -> Trajectory:
        """The values on all of time."""
        return two_sided_trajectory(self.problem, *self.states(), self.first_b, self.last_f)

    def states(self) -> tuple[Array, Array]:
        """z_f at the start and z_b at the end of every inner piece, padded with zeros to the largest number of states."""
        return piece_states(self.stretches, self.boundary.values)


def two_sided_trajectory(pieces: Pieces, z_f: Array, z_b: Array, first_b: Array, last_f: Array) -> Trajectory:
    """The trajectory of driven two-sided systems.

    Args:
        pieces: which systems, when, and the reference's states.
        z_f: at the start of each inner piece (m, n_f), padded to the largest number of states.
        z_b: at their ends (m, n_b), padded alike.
        first_b: z_b at the start of the manoeuvre.
        last_f: z_f at its end.
    """
    w_start, w_end = pieces.w_start[1:-1], pieces.w_end[1:-1]

    def segments(number: int, chosen: Indices) -> TwoSidedSegments:
        driven, P_f, P_b = shown[number]
        q, n_f, n_b = len(driven.S), driven.system.forward.size, driven.system.backward.size
        w_s, w_e = w_start[chosen, :q], w_end[chosen, :q]
        return TwoSidedSegments(
            driven, np.hstack([z_f[chosen, :n_f] - w_s @ P_f.T, w_s]), np.hstack([z_b[chosen, :n_b] - w_e @ P_b.T, w_e])
        )

    shown = [_shown(driven) for driven in pieces.driven]
    (before, _, P_b), (after, P_f, _) = shown[pieces.which[0]], shown[pieces.which[-1]]
    w_first, w_last = pieces.anchor(0), pieces.anchor(-1)
    return grouped(
        pieces.breakpoints,
        pieces.which[1:-1],
        segments,
        before.tail_before(w_first, first_b - P_b @ w_first),
        after.tail_after(w_last, last_f - P_f @ w_last),
    )


def _shown(driven: DrivenSystem) -> tuple[DrivenSystem, Array, Array]:
    """The system from which values are to be read, and what of w is to be taken from z_f and z_b for it."""
    if driven.settled is not None:
        return driven.settled.driven, driven.settled.P_f, driven.settled.P_b
    return driven, np.zeros_like(driven.D_f), np.zeros_like(driven.D_b)
