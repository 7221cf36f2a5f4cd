"""What holds between stretches: continuity and compatibility at a jump, and rest at the end."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array, as_divisor
from invtrack.linear.state_sizes import comparable_size
from invtrack.plans.boundary_value import Conditions
from invtrack.plans.stretch import Stretch

SAME_ROW_TOLERANCE = 1e-9
"""A compatibility row whose coefficients are below this share of the size of their terms holds no unknown."""


def junction_conditions(
    left: Stretch, right: Stretch, w_left: Array, w_right: Array, shift: Array, peak: Array, ratios: Array | None
) -> tuple[Conditions, tuple[int, float], int, float]:
    """Continuity, but for the shift, at a switch in the coordinates of the stretch after it, rows scaled to unit size.

    Besides, the compatibility row without unknowns that fails worst and by how much, the number of those with unknowns, and the
    size of the terms.

    Args:
        left, right: the stretches before and after the switch.
        w_left, w_right: J_w w on both sides (m,).
        shift, peak, ratios: see TwoSidedProblem.
    """
    before, after = left.system, right.system
    T, rho, n_f = after.T, after.prescribed, after.forward.size
    (E_f, _), (_, E_b) = left.transitions, right.transitions
    known = before.forward.J @ left.forced[0][-1] + w_left
    rows_left = T @ np.hstack([before.forward.J @ E_f, before.backward.J])
    # The difference first: where nothing switches it is zero to the last bit, and so is what would grow out of it.
    rhs = T @ (w_right - known - shift)
    rhs[rho + n_f :] += right.forced[1][0]
    rows_right = np.zeros((len(T), n_f + after.backward.size))
    rows_right[rho : rho + n_f, :n_f] = -np.eye(n_f)
    rows_right[rho + n_f :, n_f:] = -E_b
    joined = np.abs(np.hstack([before.forward.J, before.backward.J])).T  # the sizes of what is continuous, one row for each unknown
    if ratios is not None:  # an entry that no unknown moves holds rounding: measured against those comparable to it
        joined = comparable_size(joined, ratios)
    row_size = np.maximum(np.max(joined @ np.abs(T).T, axis=0, initial=0.0), np.finfo(float).tiny)
    wanted = np.maximum(np.abs(T[:rho] @ w_right), peak)
    rhs_size = np.abs(T) @ (np.abs(known) + np.abs(shift)) + np.concatenate([wanted, np.zeros(len(T) - rho)])
    # Rows of what is prescribed that are the same on both sides hold no unknown: they are checked, not solved for.
    empty = np.zeros(len(T), dtype=bool)
    empty[:rho] = np.max(np.abs(rows_left[:rho]), axis=1, initial=0.0) <= SAME_ROW_TOLERANCE * row_size[:rho]
    misses = np.where(empty & (rhs_size > 0), np.abs(rhs) / np.where(rhs_size > 0, rhs_size, 1.0), 0.0)
    worst = int(np.argmax(misses)) if len(misses) else 0
    rows = np.column_stack([rows_left, rows_right, rhs, rhs_size])
    kept = np.flatnonzero(~empty[:rho])
    prescribed, free = rows[kept] / row_size[kept, None], rows[rho:]
    if before.slack is not None:
        tight = _without(T[rho:], before.slack)
        free = np.column_stack([tight @ free[:, :-1], np.abs(tight) @ free[:, -1]])
    rows, n_left = np.vstack([prescribed, free]), rows_left.shape[1]
    conditions = Conditions(rows[:, :n_left], rows[:, n_left:-2], rows[:, -2])
    check = (worst, float(misses[worst]) if len(misses) else 0.0)
    return conditions, check, len(prescribed), float(np.max(rows[:, -1], initial=0.0))


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
    resting = np.hstack([moves @ stretch.transitions[0][n:], np.zeros((len(moves), n_b))])
    return Conditions(
        np.vstack([np.eye(n_b, system.size, k=system.forward.size), resting]),
        np.zeros((0, 0)),
        np.concatenate([steady_b, moves @ (steady_f - stretch.forced[0][-1])[n:]]),
    )
