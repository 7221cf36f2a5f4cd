"""From plant, split internal dynamics and reference to the boundary value problem, and from its solution to the trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.inversion.bounded_solution.intervals import Interval, make_interval
from invtrack.inversion.bounded_solution.junctions import junction_conditions
from invtrack.inversion.bounded_solution.pieces import Correction, InversePiece, inverse_piece
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.boundary_value import Conditions
from invtrack.plans.ends import Departure
from invtrack.plans.plan import TwoSidedTrajectory
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Assembly:
    """The boundary value problem and what is needed to turn its solution into a trajectory.

    open_checks: per junction the worst compatibility row without unknowns, and by how much it fails, relative to its terms.
    size: largest right-hand side, the measure for what counts as consistent.
    """

    first: Conditions
    junctions: list[Conditions]
    last: Conditions
    open_checks: list[tuple[int, float]]
    size: float
    reference: PiecewiseSignal
    splits: Sequence[SplitDynamics]
    intervals: list[Interval]
    inverses: list[InversePiece]
    kind: NDArray[np.intp]
    end_anchors: Array

    def trajectory(self, values: list[Array]) -> TwoSidedTrajectory:
        """Two-sided trajectory from z_s at each interval's start and z_u at each interval's end."""
        n_pieces = len(self.kind)
        q = self.reference.anchors.shape[1]
        n_z = max(len(split.internal.A_eta) for split in self.splits)
        v_f, v_b = np.zeros((n_pieces, n_z + q)), np.zeros((n_pieces, n_z + q))
        for k, (interval, split) in enumerate(zip(self.intervals, self.splits, strict=True)):
            n_s, n_u = len(split.A_s), len(split.A_u)
            z_s, z_u = values[k][:n_s], values[k][n_s:]
            if len(interval.pieces):
                parts = interval.boundary_parts(split, values[k], self.reference.breakpoints)
                v_f[interval.pieces, :n_s] = interval.forced_s + parts[0]
                v_b[interval.pieces, :n_u] = interval.forced_u + parts[1]
                self._append_reference(v_f, n_s, self.reference.anchors, interval.pieces)
                self._append_reference(v_b, n_u, self.end_anchors, interval.pieces)
            if k == 0:
                v_b[0, :n_u] = interval.E_u @ z_u + interval.p_u
                self._append_reference(v_b, n_u, self.reference.anchors, np.array([0]))
            if k == len(self.intervals) - 1:
                v_f[-1, :n_s] = interval.E_s @ z_s + interval.p_s
                self._append_reference(v_f, n_s, self.reference.anchors, np.array([n_pieces - 1]))
        last = len(self.inverses) - 1
        generators = [inverse.inside for inverse in self.inverses]
        kind = self.kind.copy()
        generators += [self.inverses[kind[0]].before, self.inverses[kind[-1]].after]
        kind[0], kind[-1] = last + 1, last + 2
        return TwoSidedTrajectory(self.reference.breakpoints, tuple(generators), kind, v_f, v_b)

    def _append_reference(self, v: Array, offset: int, w: Array, pieces: NDArray[np.intp]) -> None:
        """Put the reference's states behind the internal ones."""
        for index in np.unique(self.reference.kind[pieces]):
            chosen = pieces[self.reference.kind[pieces] == index]
            q = len(self.reference.generators[index].S)
            v[chosen, offset : offset + q] = w[chosen, :q]

    def departures(self, trajectory: TwoSidedTrajectory) -> tuple[Departure, Departure]:
        """What dies out before the manoeuvre (backward in time) and after it: distances from the bounded particular solutions."""
        first, last = self.splits[0], self.splits[-1]
        n_u, n_s = len(first.A_u), len(last.A_s)
        before, after = self.inverses[self.kind[0]], self.inverses[self.kind[-1]]
        w_0, w_f = self.reference.anchors[0], self.reference.anchors[-1]
        u = trajectory.v_b[0, :n_u] - before.steady_u @ w_0[: before.steady_u.shape[1]]
        s = trajectory.v_f[-1, :n_s] - after.steady_s @ w_f[: after.steady_s.shape[1]]
        return Departure(-first.A_u, before.before.X_b[:, :n_u], u), Departure(last.A_s, after.after.X_f[:, :n_s], s)


def assemble(
    plant: SwitchedSystem,
    splits: Sequence[SplitDynamics],
    reference: PiecewiseSignal,
    corrections: Sequence[Correction | None] | None = None,
) -> Assembly:
    """Boundary value problem of the bounded inverse for a reference with breakpoints at all switch times.

    Conditions: before the manoeuvre the stable part equals its bounded particular solution, after it the antistable part does; at
    each jump the state is continuous: C*_(k+1) x = zeta_(k+1) (compatibility) and N_(k+1) x gives the new internal state.
    corrections: what each interval's law adds to the exact one (nothing, by default); its split takes account of it.
    """
    corrections = corrections or [None] * len(plant)
    edges = reference.breakpoints
    owner = plant.interval(reference.inner_times())
    inverses, kind = _inverse_of_each(plant, splits, reference, owner, corrections)
    unit = _internal_unit(splits, inverses)
    if unit > 1:
        measured = {id(split): split.in_units_of(unit) for split in splits}
        splits = [measured[id(split)] for split in splits]
        inverses, kind = _inverse_of_each(plant, splits, reference, owner, corrections)
    end_anchors = reference.end_anchors()
    intervals = [make_interval(_pieces_of(owner, k), splits[k], reference, inverses, kind, end_anchors) for k in range(len(plant))]
    junctions, checks, sizes = [], [], [interval.peak for interval in intervals]
    for k, t in enumerate(plant.switch_times):
        right = int(np.searchsorted(edges, t, side="right"))  # the piece that starts at the jump
        before, after = inverses[kind[right - 1]], inverses[kind[right]]
        zeta = before.Z @ _used(end_anchors, before, right - 1), after.Z @ _used(reference.anchors, after, right)
        peak = _zeta_peak(reference, splits[k + 1])
        conditions, check, size = junction_conditions(splits[k], splits[k + 1], intervals[k], intervals[k + 1], *zeta, peak)
        junctions.append(conditions)
        checks.append(check)
        sizes.append(size)
    before, after = inverses[kind[0]], inverses[kind[-1]]
    z_s = before.steady_s @ _used(reference.anchors, before, 0)
    z_u = after.steady_u @ _used(reference.anchors, after, len(kind) - 1)
    n_first, n_last = len(splits[0].internal.A_eta), len(splits[-1].internal.A_eta)
    sizes += [float(np.max(np.abs(z), initial=0.0)) for z in (z_s, z_u)]
    return Assembly(
        first=Conditions(np.eye(len(z_s), n_first), np.zeros((0, 0)), z_s),
        junctions=junctions,
        last=Conditions(np.eye(n_last)[n_last - len(z_u) :], np.zeros((0, 0)), z_u),
        open_checks=checks,
        size=max(sizes),
        reference=reference,
        splits=splits,
        intervals=intervals,
        inverses=inverses,
        kind=kind,
        end_anchors=end_anchors,
    )


def _used(anchors: Array, inverse: InversePiece, piece: int) -> Array:
    return anchors[piece, : inverse.Z.shape[1]]


def _pieces_of(owner: NDArray[np.intp], k: int) -> NDArray[np.intp]:
    """Numbers of the inner pieces that lie in interval k; owner does not decrease."""
    first, last = np.searchsorted(owner[1:-1], [k, k + 1])
    return np.arange(first, last) + 1


def _inverse_of_each(
    plant: SwitchedSystem,
    splits: Sequence[SplitDynamics],
    reference: PiecewiseSignal,
    owner: NDArray[np.intp],
    corrections: Sequence[Correction | None],
) -> tuple[list[InversePiece], NDArray[np.intp]]:
    """The distinct inverses (internal dynamics, reference generator, endless or not), and which one each piece uses."""
    numbers = {id(split): k for k, split in enumerate(splits)}
    model = np.array([numbers[id(split)] for split in splits])[owner]
    endless = np.zeros(len(owner), dtype=np.intp)
    endless[[0, -1]] = 1
    shape = (len(plant), len(reference.generators), 2)
    keys, kind = np.unique(np.ravel_multi_index((model, reference.kind, endless), shape), return_inverse=True)
    inverses = [
        inverse_piece(plant.systems[k], splits[k], reference.generators[g], endless=bool(is_endless), correction=corrections[k])
        for k, g, is_endless in zip(*np.unravel_index(keys, shape), strict=True)
    ]
    return inverses, kind


def _internal_unit(splits: Sequence[SplitDynamics], inverses: Sequence[InversePiece]) -> float:
    """A power of two in which to measure internal coordinates, so that the reference's drive is no larger than the dynamics.

    A spline through close samples has large derivatives; as entries of an augmented matrix they would set the pace of all of it.
    """
    pace = max((np.linalg.norm(A, 1) for split in splits for A in (split.A_s, split.A_u) if A.size), default=0.0)
    drive = max((np.linalg.norm(D, 1) for inverse in inverses for D in (inverse.D_s, inverse.D_u) if D.size), default=0.0)
    return float(2.0 ** np.ceil(np.log2(drive / pace))) if drive > pace > 0 else 1.0


def _zeta_peak(reference: PiecewiseSignal, split: SplitDynamics) -> Array:
    """Largest size over the whole reference of each entry of zeta: at a jump itself it may be passing through zero."""
    sizes = [reference.size(order)[i] for i, r in enumerate(split.internal.form.relative_degree) for order in range(r)]
    return np.array(sizes, dtype=float)
