"""The internal dynamics as a matrix pencil, which no gain of the tracking law enters."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, as_divisor
from invtrack.errors import NonHyperbolicError
from invtrack.linear.invariant_parts import InvariantParts, separated
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import own_pace, plant_units

FAST = 1e3
"""Internal dynamics this often as fast as the plant itself are split by their pencil."""

QUICK = 30.0
"""Zeros this often as fast as the plant are kept apart from the others."""

PASSED_ON = 1e-11
"""An input's gain on a derivative that it does not reach is none below this share of its terms."""


NOT_PARTED = (
    "the internal dynamics cannot be parted into a stable and an antistable part: zeros of both sides are so close to each other, "
    "or so far beyond the plant's modes, that rounding exchanges them"
)


@dataclass(frozen=True, eq=False)
class PencilParts:
    """Internal dynamics in two parts that do not act on each other.

    parts: of eta. D_1 (n_1, rho + p), D_2 (n_2, rho + p): what [zeta; chi] adds to z_1' and z_2'. quick: of each part, how many
    states, the last ones, belong to zeros far beyond the plant's own modes; nothing couples them with the others.
    """

    parts: InvariantParts
    D_1: Array
    D_2: Array
    quick: tuple[int, int]


@dataclass(frozen=True, eq=False)
class InternalPencil:
    """E z' = M z + D [zeta; chi] with z = basis eta: the plant's equations among those rows that no input enters.

    A_eta = N (A - B B_y^-1 A_x) V holds B_y^-1, which is large where the inputs set the outputs weakly, as at the end of a chain of
    lightly damped joints: zeros far beyond the plant's own modes, whose rounding hides what the slow ones are. With Q'B = 0 the
    same dynamics are Q'V eta' = Q'A V eta + Q'(A P zeta - P zeta'), all of the plant's own size, and fast zeros are small singular
    values of E, as those at infinity are zero ones. Where inputs show in an output at once, its equation is a row among them.

    Args:
        E, M: (n_z, n_z), in the plant's units.
        D: (n_z, rho + p).
        basis: (n_z, n_z), coordinates z, orthonormal in the plant's units, from eta.
        quick: zeros beyond this [rad/s] are far beyond the plant's own modes.
    """

    E: Array
    M: Array
    D: Array
    basis: Array
    quick: float

    def parts(self, first: Callable[[complex], bool]) -> PencilParts:
        """The dynamics in a part with the zeros for which `first` holds and one with the rest, quick ones the last in each.

        By an ordered generalized Schur form (C. B. Moler and G. W. Stewart, SIAM J. Numerical Analysis 10, 1973), E = Q T Z' and
        M = Q S Z': of E^-1 M, T^-1 S is then the Schur form. Raises NonHyperbolicError where rounding does not let them be parted.
        """
        S, T, zeros, Q, Z = self._ordered(first)
        # In coordinates of the Schur form with quick zeros first nothing as large as they are enters the equations of slow ones.
        A, drive, into = scipy.linalg.solve_triangular(T, S), scipy.linalg.solve_triangular(T, Q.T @ self.D), Z.T @ self.basis
        n_q = sum(abs(zero) > self.quick for zero in zeros)
        apart = separated(A, np.eye(len(A)), n_q)
        both = []
        for A_group, own in ((apart.A_1, zeros[:n_q]), (apart.A_2, zeros[n_q:])):
            both.append(separated(A_group, np.eye(len(A_group)), sum(map(first, own))))
        quick, slow = both
        blocks = [(slow.A_1, quick.A_1), (slow.A_2, quick.A_2)]
        W = [np.hstack([apart.W_2 @ slow.W_1, apart.W_1 @ quick.W_1]), np.hstack([apart.W_2 @ slow.W_2, apart.W_1 @ quick.W_2])]
        L = [np.vstack([slow.L_1 @ apart.L_2, quick.L_1 @ apart.L_1]), np.vstack([slow.L_2 @ apart.L_2, quick.L_2 @ apart.L_1])]
        A_1, A_2 = (scipy.linalg.block_diag(*pair) for pair in blocks)
        W_1, W_2 = (np.asarray(np.linalg.solve(self.basis, Z @ side)) for side in W)
        in_eta = InvariantParts(A_1, A_2, W_1, W_2, L[0] @ into, L[1] @ into)
        return PencilParts(in_eta, L[0] @ drive, L[1] @ drive, (len(quick.A_1), len(quick.A_2)))

    def _ordered(self, first: Callable[[complex], bool]) -> tuple[Array, Array, list[complex], Array, Array]:
        """S, T, the zeros, Q, Z: quick zeros before slow ones, and of both those for which `first` holds before the others."""

        def chosen(alpha: Array, beta: Array) -> list[bool]:
            return [first(complex(a / b)) for a, b in zip(alpha, beta, strict=True)]

        try:
            S, T, alpha, beta, Q, Z = scipy.linalg.ordqz(self.M, self.E, sort=chosen, output="real")
        except ValueError as reason:
            raise NonHyperbolicError(NOT_PARTED) from reason
        quick = [abs(a / b) > self.quick for a, b in zip(alpha, beta, strict=True)]
        S, T, real, imag, beta, Q, Z, *_, info = scipy.linalg.lapack.dtgsen(
            quick, S, T, Q, Z, ijob=0, lwork=4 * len(S) + 16, liwork=1
        )
        if info:
            raise NonHyperbolicError(NOT_PARTED)
        return S, T, [complex(a / c, b / c) for a, b, c in zip(real, imag, beta, strict=True)], Q, Z


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
    if pace <= FAST * own_pace(system):
        return None
    direct = np.flatnonzero(np.array(form.orders) == 0)
    rows, gains = form.A_x[direct] * units, form.B_y[direct]
    scale = np.linalg.norm(A) / as_divisor(np.linalg.norm(rows, axis=1))[:, None]
    entering = np.vstack([B, scale * gains])
    free = np.linalg.qr(entering / as_divisor(np.linalg.norm(entering, axis=0)), mode="complete")[0][:, system.n_inputs :]
    free = free @ np.linalg.svd(free[: len(A)].T @ V, full_matrices=False)[0]
    Q, Q_direct = free[: len(A)], scale * free[len(A) :]
    P = form.P / units[:, None]
    shift, passed = _chains(system, form)
    shown = np.eye(len(form.orders))[direct]
    D = Q.T @ np.hstack([A @ P - P @ shift, -P @ passed]) + Q_direct.T @ np.hstack([rows @ P, -shown])
    return InternalPencil(Q.T @ V, (Q.T @ A + Q_direct.T @ rows) @ V, D, basis, QUICK * own_pace(system))


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
