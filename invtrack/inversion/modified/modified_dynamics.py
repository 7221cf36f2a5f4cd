"""The modified inverse as a linear system: all of the state is internal to it, since no output is prescribed any more."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from invtrack.arrays import Array, ComplexArray
from invtrack.inversion.inverse_system import Correction
from invtrack.inversion.modified.placement import MovablePart, integrator_chains
from invtrack.linear.internal_dynamics import AXIS_TOLERANCE, InternalDynamics, SplitDynamics, internal_dynamics, split_by
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.switched import SwitchedSystem


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """eta_eq = H zeta_d + H_0 y^(r): internal states that hold the output where it is (and follow it, where it moves slowly).

    H (n_z, rho) holds the first terms of the series in the derivatives of y_d that solves the internal dynamics for polynomials,
    A_eta H_k = H_(k-1) - A_zeta,k: it does not depend on the choice of eta, and the errors that remain are driven by y_d^(r) alone.
    H_0 (n_z, p) is needed for outputs of relative degree 0, whose value is not in zeta. residual (n_z, p): what is left of
    A_eta eta + A_zeta zeta + B_r y^(r) for a held output, zero unless A_eta is singular (a zero at the origin).
    """

    H: Array
    H_0: Array
    residual: Array


def equilibrium(internal: InternalDynamics) -> Equilibrium:
    """Internal equilibrium of the held output; with A_eta singular to within its uncertainty, as near to one as there is."""
    form, n_z = internal.form, len(internal.A_eta)
    solve = _solver(internal)
    p, rho = len(form.orders), sum(form.orders)
    H, H_0, residual, column = np.zeros((n_z, rho)), np.zeros((n_z, p)), np.zeros((n_z, p)), 0
    for i, r in enumerate(form.orders):
        if r == 0:
            H_0[:, i] = solve(-internal.B_r[:, i])
            residual[:, i] = internal.A_eta @ H_0[:, i] + internal.B_r[:, i]
        previous = np.zeros(n_z)
        for k in range(r):
            H[:, column] = previous = solve(previous - internal.A_zeta[:, column])
            if k == 0:
                residual[:, i] = internal.A_eta @ previous + internal.A_zeta[:, column]
            column += 1
    return Equilibrium(H, H_0, residual)


def _solver(internal: InternalDynamics) -> Callable[[Array], Array]:
    """A_eta^-1, or its pseudoinverse where singular values are rounding."""
    U, sizes, Vh = np.linalg.svd(internal.A_eta)
    kept = sizes > internal.uncertainty

    def solve(rhs: Array) -> Array:
        solution: Array = Vh[kept].T @ ((U[:, kept].T @ rhs) / sizes[kept])
        return solution

    return solve


def has_equilibrium(internal: InternalDynamics) -> bool:
    """Whether every value of the output can be held: A_eta is not singular to within what the model resolves."""
    return not len(internal.A_eta) or float(np.linalg.svd(internal.A_eta, compute_uv=False)[-1]) > internal.uncertainty


def undivided_dynamics(plant: SwitchedSystem) -> tuple[SplitDynamics, ...]:
    """Internal dynamics of each interval, all of them in the part that runs forward, whatever their zeros."""
    return plant.map(lambda system: split_by(internal_dynamics(system), lambda zero: True))


def derivative_columns(form: NormalForm) -> list[tuple[int, int, int]]:
    """(output i, order k, column of [zeta_d; y_d^(r)]) for k = 1 ... r_i: what L may act on without disturbing a held output."""
    columns, column, rho = [], 0, sum(form.orders)
    for i, r in enumerate(form.orders):
        columns += [(i, k, column + k if k < r else rho + i) for k in range(1, r + 1)]
        column += r
    return columns


@dataclass(frozen=True, eq=False)
class ModifiedDynamics:
    """x = P zeta_d + V xi, xi' = A xi + R [zeta_d; y_d^(r)], split; v = F xi_0 + L [zeta_d; y_d^(r)], xi_0 = [e; eta - eta_eq].

    Args:
        split: the dynamics for L = 0.
        F: (p, n).
        feedthrough: what outputs of relative degree 0 need in L so that they are held (p, rho + p).
        N: what takes the state's distance V xi from P zeta_d to xi_0 (n, n).
        G_v: what v adds to xi' (n, p).
        poles: all poles of the modified inverse (n,) [rad/s].
    """

    split: SplitDynamics
    F: Array
    feedthrough: Array
    N: Array
    G_v: Array
    poles: ComplexArray

    def with_feedforward(self, L: Array) -> tuple[SplitDynamics, Correction]:
        """Split dynamics and correction for v = F [e; eta - eta_eq] + L [zeta_d; y_d^(r)], L (p, rho + p)."""
        total = L + self.feedthrough
        drive = self.G_v @ total
        split = replace(
            self.split, G_s=self.split.G_s + self.split.L_s @ drive, G_u=self.split.G_u + self.split.L_u @ drive
        )  # what L adds to the drive
        return split, Correction(self.F @ self.N, total)


def modified_dynamics(internal: InternalDynamics, part: MovablePart, gain: Array, unmoved: ComplexArray) -> ModifiedDynamics:
    """The modified inverse S + G_v F of a plant with these internal dynamics, split into its stable and its antistable part.

    gain (p, rho + k): on the movable part. unmoved: the zeros left where they are.
    """
    form, F = internal.form, part.full_gain(gain)
    rho, p = sum(form.orders), len(form.orders)
    n_z = len(internal.A_eta)
    n = rho + n_z
    J, E = integrator_chains(form)
    G_v = np.vstack([E, internal.B_r])
    S = np.block([[J, np.zeros((rho, n_z))], [internal.A_zeta, internal.A_eta]]) + G_v @ F
    rest = equilibrium(internal)
    R_eta = np.hstack([internal.A_eta @ rest.H + internal.A_zeta - rest.H @ J, internal.B_r - rest.H @ E])
    feedthrough = np.hstack([np.zeros((p, rho)), -F[:, rho:] @ rest.H_0])
    # In balanced coordinates, powers of two, the Schur form does not care for the units of outputs and time.
    d = balancing_scale(S)
    S, R = S * d / d[:, None], np.vstack([np.zeros((rho, rho + p)), R_eta]) / d[:, None]
    T, T_inverse = np.vstack([form.C_star, form.N]) / d[:, None], np.hstack([form.P, form.V]) * d
    frame = replace(form, C_star=np.zeros((0, n)), N=T, P=form.P + form.V @ rest.H, V=T_inverse)
    poles = np.concatenate([part.poles, unmoved])
    modified = InternalDynamics(frame, S, R[:, :rho], R[:, rho:], np.zeros((n, 0)), np.eye(n), poles, internal.uncertainty)
    return ModifiedDynamics(_split(modified), F, feedthrough, np.vstack([form.C_star, form.N]), G_v / d[:, None], poles)


def _split(internal: InternalDynamics) -> SplitDynamics:
    """Stable part (poles on the axis, harmless over an interval that ends, included) and antistable part."""
    antistable = internal.zeros.real > AXIS_TOLERANCE * np.abs(internal.zeros)
    return split_by(internal, lambda pole: not antistable[np.argmin(np.abs(internal.zeros - pole))])
