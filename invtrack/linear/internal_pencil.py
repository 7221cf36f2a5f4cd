"""The internal dynamics as a matrix pencil, which no gain of the tracking law enters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import NonHyperbolicError
from invtrack.linear.invariant_parts import InvariantParts, separated
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

FAST = 1e3
"""Internal dynamics this often as fast as the plant itself are split by their pencil."""

PASSED_ON = 1e-11
"""An input's gain on a derivative that it does not reach is none below this share of its terms."""


@dataclass(frozen=True, eq=False)
class InternalPencil:
    """E z' = M z + D [zeta; chi] with z = basis eta: the plant's equations among those rows that no input enters.

    A_eta = N (A - B B_y^-1 A_x) V holds B_y^-1, which is large where the inputs set the outputs weakly, as at the end of a chain of
    lightly damped joints: zeros far beyond the plant's own modes, whose rounding hides what the slow ones are. With Q'B = 0 the
    same dynamics are Q'V eta' = Q'A V eta + Q'(A P zeta - P zeta'), all of the plant's own size, and fast zeros are small singular
    values of E, as those at infinity are zero ones.

    Args:
        E, M: (n_z, n_z), in the plant's units.
        D: (n_z, rho + p).
        basis: (n_z, n_z), coordinates z, orthonormal in the plant's units, from eta.
    """

    E: Array
    M: Array
    D: Array
    basis: Array

    def parts(self, first: Callable[[complex], bool]) -> tuple[InvariantParts, Array, Array]:
        """The dynamics in a part with the zeros for which `first` holds and one with the rest, and what drives each.

        By an ordered generalized Schur form (C. B. Moler and G. W. Stewart, SIAM J. Numerical Analysis 10, 1973), E = Q T Z' and
        M = Q S Z': of E^-1 M, T^-1 S is then the Schur form. Raises NonHyperbolicError where rounding does not let them be parted.
        """

        def chosen(alpha: Array, beta: Array) -> list[bool]:
            return [first(complex(a / b)) for a, b in zip(alpha, beta, strict=True)]

        try:
            S, T, alpha, beta, Q, Z = scipy.linalg.ordqz(self.M, self.E, sort=chosen, output="real")
        except ValueError as reason:
            raise NonHyperbolicError(
                f"the internal dynamics cannot be parted into a stable and an antistable part: {reason}; zeros of both sides are "
                "so close to each other, or so far beyond the plant's modes, that rounding exchanges them"
            ) from reason
        n_1 = sum(chosen(alpha, beta))
        # In coordinates of the Schur form, where the drive of slow parts stands beside that of fast ones, and not in sums with it.
        parts = separated(scipy.linalg.solve_triangular(T, S), np.eye(len(S)), n_1)
        drive = scipy.linalg.solve_triangular(T, Q.T @ self.D)
        W = np.linalg.solve(self.basis, Z @ np.hstack([parts.W_1, parts.W_2]))
        L = Z.T @ self.basis
        in_eta = InvariantParts(parts.A_1, parts.A_2, W[:, :n_1], W[:, n_1:], parts.L_1 @ L, parts.L_2 @ L)
        return in_eta, parts.L_1 @ drive, parts.L_2 @ drive


def internal_pencil(system: StateSpace, form: NormalForm, A_eta: Array) -> InternalPencil | None:
    """The pencil of a square plant whose internal dynamics A_eta (n_z, n_z) are far faster than the plant; None for others.

    Of those the Schur form of A_eta is as accurate, and several times as fast.
    """
    units = plant_units(system)
    A, B = system.A * units / units[:, None], system.B / units[:, None]
    n_z = len(A_eta)
    if system.n_inputs != system.n_outputs or not n_z:
        return None
    V, basis = np.linalg.qr(form.V / units[:, None])
    pace = np.linalg.norm(scipy.linalg.solve_triangular(basis, (basis @ A_eta).T, trans="T").T)
    if pace <= FAST * np.linalg.norm(A):
        return None
    size = np.linalg.norm(B, axis=0)
    free = np.linalg.qr(B / np.where(size > 0, size, 1.0), mode="complete")[0][:, system.n_inputs :]
    rows = free @ np.linalg.svd(free.T @ V, full_matrices=False)[0]
    P = form.P / units[:, None]
    shift, passed = _chains(system, form)
    D = rows.T @ np.hstack([A @ P - P @ shift, -P @ passed])
    return InternalPencil(rows.T @ V, rows.T @ A @ V, D, basis)


def _chains(system: StateSpace, form: NormalForm) -> tuple[Array, Array]:
    """J (rho, rho) and K (rho, p) of zeta' = J zeta + K chi: each row's derivative is the next, and chi at the end of its output's.

    Where rows were combined, the derivative of one also holds multiples of the chi that were taken away from it.
    """
    rho, orders = len(form.C_star), np.array(form.orders)
    K = np.zeros((rho, len(orders)))
    if form.combined:
        _, G, _ = form.tracking_law()
        terms = np.abs(form.C_star) @ np.abs(system.B) @ np.abs(G)
        K = form.C_star @ system.B @ G
        K = np.where(np.abs(K) > PASSED_ON * terms, K, 0.0)
    reached = np.flatnonzero(orders)
    last = np.cumsum(orders)[reached] - 1
    J = np.eye(rho, k=1)
    J[last] = 0.0
    K[last] = np.eye(len(orders))[reached]
    return J, K
