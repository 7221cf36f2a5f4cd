"""Conditions at a parameter jump: the state is continuous, the output and its derivatives are the wanted ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.inversion.bounded_solution.intervals import Interval
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.plans.boundary_value import Conditions

Array = NDArray[np.float64]

SAME_ROW_TOLERANCE = 1e-9
"""A compatibility row whose coefficients are below this share of the size of their terms holds no unknown."""


def junction_conditions(
    left: SplitDynamics,
    right: SplitDynamics,
    before: Interval,
    after: Interval,
    zeta_left: Array,
    zeta_right: Array,
    zeta_peak: Array,
) -> tuple[Conditions, tuple[int, float], float]:
    """Continuity of the state at a jump, in the new interval's coordinates; rows scaled to unit size.

    C_star (rho rows) are the outputs and derivatives that have to be the wanted ones: none of them in a modified inverse, whose
    internal coordinates N are the whole state.
    """
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
    rhs[:rho] += zeta_right[:rho]
    rhs[rho:] += T[rho:] @ (form_r.P @ zeta_right)  # zero where N P = 0, as in the normal form
    rhs[rho + n_s :] += after.p_u
    row_size = np.maximum(np.max(np.abs(T) @ np.abs(np.hstack([x_from_s, x_from_u])), axis=1, initial=0.0), np.finfo(float).tiny)
    rhs_size = np.abs(T) @ np.abs(known) + np.concatenate([np.maximum(np.abs(zeta_right), zeta_peak)[:rho], np.zeros(len(T) - rho)])
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
