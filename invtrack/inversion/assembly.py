"""From plant, split internal dynamics and reference to the boundary value problem, and from its solution to the trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.inversion.boundary_value import Conditions
from invtrack.inversion.decay import Departure
from invtrack.inversion.pieces import InversePiece, inverse_piece
from invtrack.lti.propagation import flow
from invtrack.lti.switched import SwitchedSystem
from invtrack.lti.zero_dynamics import SplitDynamics
from invtrack.signals.nominal import TwoSidedTrajectory
from invtrack.signals.piecewise import PiecewiseSignal

Array = NDArray[np.float64]

SAME_ROW_TOLERANCE = 1e-9
"""A compatibility row whose coefficients are below this share of the size of their terms holds no unknown."""


@dataclass(frozen=True, eq=False)
class Interval:
    """One interval of the plant within the manoeuvre: v_k = [z_s at its start; z_u at its end] is unknown.

    z_s at the end is E_s z_s(start) + p_s, z_u at the start is E_u z_u(end) + p_u. forced_s, forced_u: the particular parts at the
    start and at the end of each of the interval's pieces, whose numbers are `pieces`; peak: the largest value they take.
    """

    pieces: NDArray[np.intp]
    length: float
    E_s: Array
    p_s: Array
    E_u: Array
    p_u: Array
    forced_s: Array
    forced_u: Array
    peak: float


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
            edges = self.reference.breakpoints
            for j, forced_s, forced_u in zip(interval.pieces, interval.forced_s, interval.forced_u, strict=True):
                since, until = edges[j - 1] - edges[interval.pieces[0] - 1], edges[interval.pieces[-1]] - edges[j]
                v_f[j, :n_s] = flow(split.A_s, z_s[None], np.array([since]))[0] + forced_s
                v_b[j, :n_u] = flow(-split.A_u, z_u[None], np.array([until]))[0] + forced_u
                self._append_reference(v_f[j], n_s, self.reference.anchors[j], j)
                self._append_reference(v_b[j], n_u, self.end_anchors[j], j)
            if k == 0:
                start_u = interval.E_u @ z_u + interval.p_u
                v_b[0, :n_u] = start_u
                self._append_reference(v_b[0], n_u, self.reference.anchors[0], 0)
            if k == len(self.intervals) - 1:
                v_f[-1, :n_s] = interval.E_s @ z_s + interval.p_s
                self._append_reference(v_f[-1], n_s, self.reference.anchors[-1], n_pieces - 1)
        last = len(self.inverses) - 1
        generators = [inverse.inside for inverse in self.inverses]
        kind = self.kind.copy()
        generators += [self.inverses[kind[0]].before, self.inverses[kind[-1]].after]
        kind[0], kind[-1] = last + 1, last + 2
        return TwoSidedTrajectory(self.reference.breakpoints, tuple(generators), kind, v_f, v_b)

    def _append_reference(self, row: Array, offset: int, w: Array, piece: int) -> None:
        q = len(self.reference.generators[self.reference.kind[piece]].S)
        row[offset : offset + q] = w[:q]

    def departures(self, trajectory: TwoSidedTrajectory) -> tuple[Departure, Departure]:
        """What dies out before the manoeuvre (backward in time) and after it: distances from the bounded particular solutions."""
        first, last = self.splits[0], self.splits[-1]
        n_u, n_s = len(first.A_u), len(last.A_s)
        before, after = self.inverses[self.kind[0]], self.inverses[self.kind[-1]]
        w_0, w_f = self.reference.anchors[0], self.reference.anchors[-1]
        u = trajectory.v_b[0, :n_u] - before.steady_u @ w_0[: before.steady_u.shape[1]]
        s = trajectory.v_f[-1, :n_s] - after.steady_s @ w_f[: after.steady_s.shape[1]]
        return Departure(-first.A_u, before.before.X_b[:, :n_u], u), Departure(last.A_s, after.after.X_f[:, :n_s], s)


def assemble(plant: SwitchedSystem, splits: Sequence[SplitDynamics], reference: PiecewiseSignal) -> Assembly:
    """Boundary value problem of the bounded inverse for a reference with breakpoints at all switch times.

    Conditions: before the manoeuvre the stable part equals its bounded particular solution, after it the antistable part does; at
    each jump the state is continuous: C*_(k+1) x = zeta_(k+1) (compatibility) and N_(k+1) x gives the new internal state.
    """
    edges = reference.breakpoints
    middle = np.concatenate([[edges[0] - 1.0], (edges[:-1] + edges[1:]) / 2, [edges[-1] + 1.0]])
    owner = plant.interval(middle)
    inverses, kind = _inverse_of_each(plant, splits, reference, owner)
    end_anchors = _end_anchors(reference)
    intervals = [
        _interval(np.flatnonzero(owner[1:-1] == k) + 1, splits[k], reference, inverses, kind, end_anchors)
        for k in range(len(plant))
    ]
    junctions, checks, sizes = [], [], [interval.peak for interval in intervals]
    for k, t in enumerate(plant.switch_times):
        right = int(np.searchsorted(edges, t, side="right"))  # the piece that starts at the jump
        zeta_left = inverses[kind[right - 1]].Z @ _used(end_anchors, inverses[kind[right - 1]], right - 1)
        zeta_right = inverses[kind[right]].Z @ _used(reference.anchors, inverses[kind[right]], right)
        peak = _derivative_sizes(reference, splits[k + 1])
        conditions, check, size = _junction(splits[k], splits[k + 1], intervals[k], intervals[k + 1], zeta_left, zeta_right, peak)
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


def _inverse_of_each(
    plant: SwitchedSystem, splits: Sequence[SplitDynamics], reference: PiecewiseSignal, owner: NDArray[np.intp]
) -> tuple[list[InversePiece], NDArray[np.intp]]:
    """The distinct inverses (plant model and reference generator), and which one each piece uses."""
    known: dict[tuple[int, int, bool], int] = {}
    inverses: list[InversePiece] = []
    kind = np.empty(len(owner), dtype=np.intp)
    for piece, (k, g) in enumerate(zip(owner, reference.kind, strict=True)):
        endless = piece in (0, len(owner) - 1)
        key = (id(plant.systems[k]), int(g), endless)
        if key not in known:
            known[key] = len(inverses)
            inverses.append(inverse_piece(plant.systems[k], splits[k], reference.generators[g], endless=endless))
        kind[piece] = known[key]
    return inverses, kind


def _end_anchors(reference: PiecewiseSignal) -> Array:
    """The reference's own state w at the end of each piece (of the first piece: its anchor)."""
    result = reference.anchors.copy()
    lengths = np.concatenate([[0.0], np.diff(reference.breakpoints), [0.0]])
    for index, generator in enumerate(reference.generators):
        chosen = reference.kind == index
        q = len(generator.S)
        result[chosen, :q] = flow(generator.S, reference.anchors[chosen, :q], lengths[chosen])
    return result


def _interval(
    pieces: NDArray[np.intp],
    split: SplitDynamics,
    reference: PiecewiseSignal,
    inverses: list[InversePiece],
    kind: NDArray[np.intp],
    end_anchors: Array,
) -> Interval:
    n_s, n_u = len(split.A_s), len(split.A_u)
    lengths = np.diff(reference.breakpoints)[pieces - 1]
    z_s, z_u = np.zeros(n_s), np.zeros(n_u)
    forced_s, forced_u = np.zeros((len(pieces), n_s)), np.zeros((len(pieces), n_u))
    peak, shares = 0.0, np.array([1 / 3, 2 / 3, 1.0])  # at the ends alone all may happen to pass through zero
    for i, (j, length) in enumerate(zip(pieces, lengths, strict=True)):
        forced_s[i] = z_s
        start = np.concatenate([z_s, _used(reference.anchors, inverses[kind[j]], j)])
        z = flow(inverses[kind[j]].inside.M_f, np.tile(start, (3, 1)), length * shares)[:, :n_s]
        z_s, peak = z[-1], max(peak, np.max(np.abs(z), initial=0.0))
    for i, (j, length) in reversed(list(enumerate(zip(pieces, lengths, strict=True)))):
        forced_u[i] = z_u
        end = np.concatenate([z_u, _used(end_anchors, inverses[kind[j]], j)])
        z = flow(-inverses[kind[j]].inside.M_b, np.tile(end, (3, 1)), length * shares)[:, :n_u]
        z_u, peak = z[-1], max(peak, np.max(np.abs(z), initial=0.0))
    total = float(lengths.sum())
    E_s, E_u = scipy.linalg.expm(split.A_s * total), scipy.linalg.expm(-split.A_u * total)
    return Interval(pieces, total, E_s, z_s, E_u, z_u, forced_s, forced_u, float(peak))


def _derivative_sizes(reference: PiecewiseSignal, split: SplitDynamics) -> Array:
    """Largest size over the whole reference of each entry of zeta: at a jump itself it may be passing through zero."""
    sizes = [reference.size(order)[i] for i, r in enumerate(split.internal.form.relative_degree) for order in range(r)]
    return np.array(sizes, dtype=float)


def _junction(
    left: SplitDynamics,
    right: SplitDynamics,
    before: Interval,
    after: Interval,
    zeta_left: Array,
    zeta_right: Array,
    zeta_peak: Array,
) -> tuple[Conditions, tuple[int, float], float]:
    """Continuity of the state at a jump, in the new interval's coordinates; rows scaled to unit size."""
    form_l, form_r = left.internal.form, right.internal.form
    x_from_s, x_from_u = form_l.V @ left.W_s, form_l.V @ left.W_u
    unknown = np.hstack([x_from_s @ before.E_s, x_from_u])  # x at the end of the old interval, from its v
    known = form_l.P @ zeta_left + x_from_s @ before.p_s
    T = np.vstack([form_r.C_star, right.L_s @ form_r.N, right.L_u @ form_r.N])
    rho, n_s = len(form_r.C_star), len(right.A_s)
    rows_left, rhs = T @ unknown, -T @ known
    rows_right = np.zeros((len(T), n_s + len(right.A_u)))
    rows_right[rho : rho + n_s, :n_s] = -np.eye(n_s)
    rows_right[rho + n_s :, n_s:] = -after.E_u
    rhs[:rho] += zeta_right
    rhs[rho + n_s :] += after.p_u
    row_size = np.maximum(np.max(np.abs(T) @ np.abs(np.hstack([x_from_s, x_from_u])), axis=1, initial=0.0), np.finfo(float).tiny)
    rhs_size = np.abs(T) @ np.abs(known) + np.concatenate([np.maximum(np.abs(zeta_right), zeta_peak), np.zeros(len(T) - rho)])
    # Rows of C* that are the same on both sides hold no unknown: they are checked, not solved for.
    empty = np.zeros(len(T), dtype=bool)
    empty[:rho] = np.max(np.abs(rows_left[:rho]), axis=1, initial=0.0) <= SAME_ROW_TOLERANCE * row_size[:rho]
    misses = np.where(empty & (rhs_size > 0), np.abs(rhs) / np.where(rhs_size > 0, rhs_size, 1.0), 0.0)
    worst = int(np.argmax(misses)) if len(misses) else 0
    kept = ~empty
    scale = np.concatenate([row_size[:rho], np.ones(len(T) - rho)])[kept]
    rows_left, rows_right, rhs = rows_left[kept] / scale[:, None], rows_right[kept] / scale[:, None], rhs[kept] / scale
    size = float(np.max(rhs_size[kept] / scale, initial=0.0))
    return Conditions(rows_left, rows_right, rhs), (worst, float(misses[worst])), size
