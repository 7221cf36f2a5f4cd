"""What holds between stretches: continuity and compatibility at a jump, and rest at the end."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, as_divisor
from invtrack.linear.state_sizes import comparable_size
from invtrack.plans.boundary_value import Conditions
from invtrack.plans.stretch import Stretch, recurring, transitions
from invtrack.plans.two_sided import TwoSidedSystem

SAME_ROW_TOLERANCE = 1e-9
"""A compatibility row whose coefficients are below this share of the size of their terms holds no unknown."""


@dataclass(frozen=True, eq=False)
class Junction:
    """What holds at one switch.

    Args:
        conditions: continuity, but for the shift, in the coordinates of the stretch after it, rows scaled to unit size, those of
            compatibility first.
        check: the compatibility row without unknowns that fails worst, and by how much, relative to its terms.
        compatibility_rows: how many others hold unknowns.
        size: of the largest term.
    """

    conditions: Conditions
    check: tuple[int, float]
    compatibility_rows: int
    size: float


def junctions(
    found: Sequence[Stretch], w_left: Array, w_right: Array, shifts: Array, peaks: Sequence[Array], ratios: Array | None
) -> list[Junction]:
    """What holds at each switch (N,); those from one and the same system to another are worked on together.

    Args:
        found: the stretches (N + 1).
        w_left, w_right: J_w w on both sides of each switch (N, m).
        shifts, peaks, ratios: see TwoSidedProblem.
    """
    result: dict[int, Junction] = {}
    E_f, E_b = transitions(found[:-1], 0), transitions(found[1:], 1)
    systems = [stretch.system for stretch in found]
    for members in recurring(list(itertools.pairwise(map(id, systems)))):
        switches = _Switches(
            before=systems[members[0]],
            after=systems[members[0] + 1],
            E_f=np.array([E_f[k] for k in members]),
            z_f=np.array([found[k].forced[0][-1] for k in members]),
            E_b=np.array([E_b[k] for k in members]),
            z_b=np.array([found[k + 1].forced[1][0] for k in members]),
            w_left=w_left[members],
            w_right=w_right[members],
            shift=shifts[members],
            peak=np.array([peaks[k] for k in members]),
        )
        result.update(zip(members, switches.junctions(ratios), strict=True))
    return [result[k] for k in range(len(w_left))]


@dataclass(frozen=True, eq=False)
class _Switches:
    """Continuity at k switches from one system to another.

    Args:
        before, after: the systems.
        E_f, z_f: transition of z_f over the stretch before (k, n_f, n_f), and z_f at its end that the reference causes (k, n_f).
        E_b, z_b: transition of z_b over the stretch after (k, n_b, n_b), and z_b at its start that the reference causes (k, n_b).
        w_left, w_right: J_w w on both sides (k, m).
        shift, peak: see TwoSidedProblem, (k, m) and (k, rho).
    """

    before: TwoSidedSystem
    after: TwoSidedSystem
    E_f: Array
    z_f: Array
    E_b: Array
    z_b: Array
    w_left: Array
    w_right: Array
    shift: Array
    peak: Array

    def equations(self) -> tuple[Array, Array, Array, Array]:
        """Rows on [z_f; z_b] before (k, r, n) and after (k, r, n'), what they add up to, and the size of its terms, (k, r)."""
        before, after = self.before, self.after
        T, rho, n_f, k = after.T, after.prescribed, after.forward.size, len(self.E_f)
        known = self.z_f @ before.forward.J.T + self.w_left
        left = np.empty((k, len(T), before.size))
        left[:, :, : before.forward.size] = T @ before.forward.J @ self.E_f
        left[:, :, before.forward.size :] = T @ before.backward.J
        # The difference first: where nothing switches it is zero to the last bit, and so is what would grow out of it.
        rhs = (self.w_right - known - self.shift) @ T.T
        rhs[:, rho + n_f :] += self.z_b
        right = np.zeros((k, len(T), after.size))
        right[:, rho : rho + n_f, :n_f] = -np.eye(n_f)
        right[:, rho + n_f :, n_f:] = -self.E_b
        terms = (np.abs(known) + np.abs(self.shift)) @ np.abs(T).T
        terms[:, :rho] += np.maximum(np.abs(self.w_right @ T[:rho].T), self.peak)
        return left, right, rhs, terms

    def row_sizes(self, ratios: Array | None) -> Array:
        """The size of the coefficients in the rows of compatibility (rho,)."""
        joined = np.abs(np.hstack([self.before.forward.J, self.before.backward.J])).T  # what is continuous, a row for each unknown
        if ratios is not None:  # an entry that no unknown moves holds rounding: measured against those comparable to it
            joined = comparable_size(joined, ratios)
        prescribing = np.abs(self.after.T[: self.after.prescribed])
        return np.asarray(np.maximum(np.max(joined @ prescribing.T, axis=0, initial=0.0), np.finfo(float).tiny))

    def junctions(self, ratios: Array | None) -> list[Junction]:
        """The conditions of each of the switches, scaled."""
        rho, n = self.after.prescribed, self.before.size
        left, right, rhs, terms = self.equations()
        row_size = self.row_sizes(ratios)
        # Rows of what is prescribed that are the same on both sides hold no unknown: they are checked, not solved for.
        kept = np.max(np.abs(left[:, :rho]), axis=2, initial=0.0) > SAME_ROW_TOLERANCE * row_size
        misses = np.where(kept, 0.0, np.abs(rhs[:, :rho]) / as_divisor(terms[:, :rho]))
        rows = np.asarray_chkfinite(np.concatenate([left, right, rhs[..., None], terms[..., None]], axis=2))
        prescribed, free = rows[:, :rho] / np.where(kept, row_size, 1.0)[..., None], rows[:, rho:]
        if self.before.slack is not None:
            tight = _without(self.after.T[rho:], self.before.slack)
            free = np.concatenate([tight @ free[..., :-1], np.abs(tight) @ free[..., -1:]], axis=2)
        found = []
        for k in range(len(rows)):
            here = np.concatenate([prescribed[k, kept[k]], free[k]])
            worst = int(np.argmax(misses[k])) if rho else 0
            found.append(
                Junction(
                    conditions=Conditions(here[:, :n], here[:, n:-2], here[:, -2]),
                    check=(worst, float(misses[k, worst]) if rho else 0.0),
                    compatibility_rows=int(np.count_nonzero(kept[k])),
                    size=float(np.max(here[:, -1], initial=0.0)),
                )
            )
        return found


def _without(T: Array, slack: Array) -> Array:
    """Orthonormal rows (., r) that take from T (r, m) times what is continuous whatever jumps along `slack` (m, k)."""
    moved, terms = T @ slack, np.abs(T) @ np.abs(slack)
    moved = np.where(np.abs(moved) <= SAME_ROW_TOLERANCE * terms, 0.0, moved) / as_divisor(np.max(terms, axis=0, initial=0.0))
    U, sizes, _ = np.linalg.svd(moved)
    return np.asarray(U[:, int(np.sum(sizes > SAME_ROW_TOLERANCE)) :].T)


def at_rest(stretch: Stretch, steady_f: Array, steady_b: Array) -> Conditions:
    """z_b steady where the manoeuvre ends, and neutral states at rest there."""
    system, n, n_b = stretch.system, stretch.system.decaying, stretch.system.backward.size
    moves = system.moves_neutral
    resting = np.hstack([moves @ transitions([stretch], 0)[0][n:], np.zeros((len(moves), n_b))])
    return Conditions(
        np.vstack([np.eye(n_b, system.size, k=system.forward.size), resting]),
        np.zeros((0, 0)),
        np.concatenate([steady_b, moves @ (steady_f - stretch.forced[0][-1])[n:]]),
    )
