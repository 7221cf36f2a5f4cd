"""Partial pole placement: the chains of integrators and the moved zeros get their poles, nothing else is touched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray, closed_under_conjugation, complex_numbers, shown
from invtrack.errors import InversionError
from invtrack.inversion.modified.target_chains import TargetChains
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.pole_placement import has_poles, placing_gain


@dataclass(frozen=True, eq=False)
class MovablePart:
    """The part of the modified inverse that is placed: z = [e; Y' xi], z' = M z + B v, xi = eta - eta_eq.

    The errors e = zeta - zeta_d are chains of integrators. Together with them Y' xi obeys equations of its own; the two need not
    be decoupled, which zeros at or near the origin would not allow.

    Args:
        M, B: (rho + k, rho + k) and (rho + k, p).
        Y: basis of the left invariant subspace of A_eta that belongs to the k zeros to move, Y' A_eta = M_22 Y' (n_z, k).
        degrees: relative degree of each output (p,).
        error_poles: poles wanted of the errors (rho,) [rad/s].
        targets: where the zeros are moved (k,) [rad/s].
    """

    M: Array
    B: Array
    Y: Array
    degrees: tuple[int, ...]
    error_poles: ComplexArray
    targets: ComplexArray

    @property
    def poles(self) -> ComplexArray:
        """All poles wanted."""
        return np.concatenate([self.error_poles, self.targets])

    @property
    def chains(self) -> list[ComplexArray] | None:
        """The poles of each output's chain, or None where they cannot be shared out in conjugate pairs as they stand."""
        parts = np.split(self.error_poles, np.cumsum(self.degrees)[:-1])
        return parts if all(closed_under_conjugation(part) for part in parts) else None

    @property
    def keeps_a_pole(self) -> bool:
        """Whether a pole wanted is there already, so that no state is reached through it."""
        distance = np.abs(np.linalg.eigvals(self.M)[:, None] - self.poles)
        return bool(np.min(distance, initial=np.inf) <= 1e-9 * np.max(np.abs(self.poles), initial=0.0))

    def full_gain(self, gain: Array) -> Array:
        """F (p, n) on [e; xi] from the gain (p, rho + k) on z."""
        rho = sum(self.degrees)
        return np.hstack([gain[:, :rho], gain[:, rho:] @ self.Y.T])


def integrator_chains(form: NormalForm) -> tuple[Array, Array]:
    """J (rho, rho) and E (rho, p) of zeta' = J zeta + E y^(r)."""
    degrees = form.orders
    J = scipy.linalg.block_diag(*[np.eye(r, k=1) for r in degrees]) if sum(degrees) else np.zeros((0, 0))
    E = np.zeros((sum(degrees), len(degrees)))
    for i, last in enumerate(np.cumsum(degrees) - 1):
        if degrees[i]:
            E[last, i] = 1.0
    return J, E


def movable_part(
    internal: InternalDynamics, moved: NDArray[np.bool_], targets: ComplexArray, error_poles: Sequence[complex] | ComplexArray
) -> MovablePart:
    """The part to place, from an ordered real Schur form of A_eta'.

    Raises InversionError for chain poles of a wrong number, unstable or not in conjugate pairs.
    """
    form = internal.form
    rho, wanted = sum(form.orders), np.ravel(complex_numbers("error_poles", error_poles, error=InversionError))
    if len(wanted) != rho or not np.all(np.isfinite(wanted)) or not np.all(wanted.real < 0) or not closed_under_conjugation(wanted):
        raise InversionError(
            f"error_poles must be {rho} poles left of the imaginary axis, complex ones in conjugate pairs (as many as "
            f"the relative degrees {form.orders} add up to); got {shown(error_poles)}"
        )
    n_z, k = len(internal.A_eta), int(np.sum(moved))
    Q = np.zeros((n_z, 0))
    if k:
        chosen = _selector(internal.zeros, moved)
        _, Q, count = scipy.linalg.schur(internal.A_eta.T, output="real", sort=chosen)
        if count != k:
            raise InversionError(
                f"the zeros {format_zeros(internal.zeros[moved])} cannot be told from the others "
                f"{format_zeros(internal.zeros[~moved])} to within rounding; move those that are nearly equal together"
            )
    Y = Q[:, :k]
    J, E = integrator_chains(form)
    M = np.block([[J, np.zeros((rho, k))], [Y.T @ internal.A_zeta, Y.T @ internal.A_eta @ Y]])
    B = np.vstack([E, Y.T @ internal.B_r])
    return MovablePart(M, B, Y, form.orders, wanted, targets[moved])


def _selector(zeros: ComplexArray, moved: NDArray[np.bool_]) -> Callable[[float, float], bool]:
    def chosen(re: float, im: float) -> bool:
        return bool(moved[np.argmin(np.abs(zeros - complex(re, im)))])

    return chosen


def robust_gain(part: MovablePart, output_scale: Array) -> Array | None:
    """Gain (p, m) by `placing_gain`, in units in which outputs count alike; None where it fails."""
    if not len(part.M):
        return np.zeros((part.B.shape[1], 0))
    pace = float(np.exp(np.mean(np.log(np.abs(part.poles)))))
    sizes = output_scale / 2.0 ** np.floor(np.log2(np.max(output_scale)))  # a common factor changes nothing
    d_e = np.array([size * pace**k for size, r in zip(sizes, part.degrees, strict=True) for k in range(r)])
    d_v = np.array([size * pace**r for size, r in zip(sizes, part.degrees, strict=True)])
    rho = len(d_e)
    off = np.linalg.norm(part.B[rho:] * d_v) / pace if len(part.B) > rho else 1.0
    d = np.concatenate([d_e, np.full(len(part.M) - rho, off if off > 0 else 1.0)])
    M, B, poles = part.M * d / d[:, None] / pace, part.B * d_v / d[:, None] / pace, part.poles / pace

    gain = placing_gain(M, B, poles)
    return None if gain is None else _accepted(part, gain * d_v[:, None] / d)


def structured_gain(part: MovablePart, chains: TargetChains, directions: Array) -> Array | None:
    """Gain (p, m) that leaves each output's errors to themselves and moves the zeros, in `chains`, through `directions` (p, k).

    M Q + B G = Q Lambda, F = G Q^-1: each output's error answers with its own poles; what it costs to move the zeros shows in the
    outputs in the proportion of the directions. None where the directions do not reach the zeros.
    """
    if part.chains is None or part.keeps_a_pole:
        return None
    blocks, inputs = [], []
    for i, poles in enumerate(part.chains):
        if len(poles):
            blocks.append(companion(poles))
            G = np.zeros((part.B.shape[1], len(poles)))
            G[i, 0] = 1.0
            inputs.append(G)
    Lambda = scipy.linalg.block_diag(*blocks, chains.matrix) if len(part.M) else np.zeros((0, 0))
    G = np.hstack([*inputs, directions])
    try:
        Q = scipy.linalg.solve_sylvester(part.M, -Lambda, -part.B @ G)
        size = np.linalg.norm(Q, axis=0)
        if not np.all(size > 0):
            return None
        gain = np.linalg.solve((Q / size).T, (G / size).T).T
    except np.linalg.LinAlgError:
        return None
    return _accepted(part, gain) if np.all(np.isfinite(gain)) else None


def companion(poles: ComplexArray) -> Array:
    """Companion matrix with these eigenvalues, coefficients in its last row."""
    result: Array = np.eye(len(poles), k=1)
    result[-1] = -np.real(np.poly(poles))[:0:-1]
    return result


def _accepted(part: MovablePart, gain: Array) -> Array | None:
    """The gain if it places the poles."""
    return gain if has_poles(part.M + part.B @ gain, part.poles) else None
