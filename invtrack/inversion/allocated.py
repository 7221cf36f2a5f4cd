"""Exact tracking with more inputs than outputs: of all inputs that do it, those that cost the least."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray, as_divisor
from invtrack.errors import NonHyperbolicError
from invtrack.inversion.input_measure import held_inputs
from invtrack.inversion.tracking_values import tracking_values
from invtrack.linear.hidden_modes import COUPLING_TOLERANCE, ERROR_GROWTH, zero_kinds
from invtrack.linear.internal_dynamics import (
    NOT_UNIQUE,
    ROUNDING_FACTOR,
    InternalDynamics,
    axis_message,
    format_zeros,
    internal_dynamics,
    on_axis,
)
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.pseudospectrum import Pseudospectrum
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.references.signal import Generator

SAME_SUBSPACE = 1e-7
"""Largest principal angle [rad], in balanced states, between subspaces that count as the same."""


@dataclass(frozen=True, eq=False)
class AllocatedDynamics:
    """Internal dynamics and their costate under the inputs of least cost, xi = [eta; lambda]: xi' = A xi + G [zeta; chi; y_d].

    u = F x + G_r chi + Z v (`NormalForm.tracking_law`) has the least integral of (u - N_u y_d)'R (u - N_u y_d), N_u y_d being the
    input at rest, for v = Z'R N_u y_d - B_v'lambda with the costate lambda of eta, lambda' = -dH/deta (Pontryagin's conditions):
    a regular problem in the inputs that are left over, which asks no more derivatives of the outputs than the inverse does.

    Where inputs left over can shift what stays wherever it is put, at no cost (a base that may stand anywhere while a stage on it
    makes up for it), that part of the costate is zero for all time, since the plant may come to rest anywhere in it.

    Args:
        plant: the system.
        internal: its internal dynamics, with inputs weighed by R.
        anywhere: orthonormal basis (n_z, k) of where eta may rest.
        priced: orthonormal basis (n_z, n_z - k) of the rest, and of the costate: priced lambda.
        A: (2 n_z - k, 2 n_z - k).
        G: (2 n_z - k, rho + 2 p).
        u_xi, u_w: u = u_xi xi + u_w [zeta; chi; y_d], (m, 2 n_z - k) and (m, rho + 2 p).
    """

    plant: StateSpace
    internal: InternalDynamics
    anywhere: Array
    priced: Array
    A: Array
    G: Array
    u_xi: Array
    u_w: Array

    @classmethod
    def of(cls, plant: StateSpace, R: Array) -> AllocatedDynamics:
        """Those of `plant`, with inputs weighed by R (m, m). Raises RelativeDegreeError."""
        internal = internal_dynamics(plant, R)
        form, B_v = internal.form, internal.B_v
        F, G_r, Z = form.tracking_law(R)
        N_u = held_inputs(plant, R)
        FV, shift = F @ form.V, Z.T @ R @ N_u
        anywhere, priced = _resting_places(internal, R, FV, np.abs(F) @ np.abs(form.V))
        adjoint, B_l = -priced.T @ FV.T @ R, -B_v @ B_v.T @ priced
        A = np.block([[internal.A_eta, B_l], [adjoint @ FV, -priced.T @ internal.A_eta.T @ priced]])
        G = np.block(
            [[internal.A_zeta, internal.B_r, B_v @ shift], [adjoint @ np.hstack([F @ form.P, G_r, -G_r @ form.B_y @ N_u])]]
        )
        u_w = np.hstack([F @ form.P, G_r, Z @ shift])
        return cls(plant, internal, anywhere, priced, A, G, np.hstack([FV, -Z @ B_v.T @ priced]), u_w)

    @cached_property
    def modes(self) -> ComplexArray:
        """The eigenvalues of A (2 n_z,), as many on the one side of the axis as on the other."""
        return np.asarray(np.linalg.eigvals(self.A * self._scale / self._scale[:, None])).astype(complex)

    @cached_property
    def _scale(self) -> Array:
        return balancing_scale(self.A)

    @cached_property
    def on_axis(self) -> NDArray[np.bool_]:
        """Which of the modes cannot be told from ones on the imaginary axis."""
        balanced = self.A * self._scale / self._scale[:, None]
        rounding = ROUNDING_FACTOR * len(balanced) * np.finfo(float).eps * float(np.linalg.norm(balanced))
        movable, reached = Pseudospectrum(balanced), np.ones(len(self.modes), dtype=bool)
        for share in (0.0, 0.25, 0.5, 0.75):  # as `internal_dynamics.on_axis` does
            way = (share * self.modes.real + 1j * self.modes.imag)[reached]
            reached[reached] = movable.contains(way, max(rounding, self.internal.uncertainty))
        return reached

    def require_hyperbolic(self) -> None:
        """Raises NonHyperbolicError for modes on the imaginary axis that no plan brings to rest, with what they are."""
        zeros = on_axis(self.internal)
        if np.any(zeros):
            raise NonHyperbolicError(axis_message(self.internal, zeros, zero_kinds(self.plant, self.internal.zeros), NOT_UNIQUE))
        if np.sum(self.on_axis) > self.anywhere.shape[1]:
            listed = format_zeros(self.modes[self.on_axis], float(np.max(np.abs(self.modes))))
            raise NonHyperbolicError(
                f"the inputs left over can move something at no cost: a motion at {listed} rad/s changes no output and takes no "
                "input, so that there is no cheapest way to bring it to rest, only ever slower ones; track it as a further output, "
                "or damp it or hold it by a spring"
            )

    def inverse(self, *, endless: bool) -> AllocatedInverse:
        """The bounded inverse; modes on the imaginary axis are refused where the interval is `endless`, else run forward."""
        if endless:
            self.require_hyperbolic()
        modes, axis, d, form = self.modes, self.on_axis, self._scale, self.internal.form
        balanced = self.A * d / d[:, None]
        stable = axis | (modes.real <= 0)
        # By the nearest mode: reordering the Schur form puts one on the axis to either side of it.
        parts = invariant_parts(balanced, lambda mode: bool(stable[np.argmin(np.abs(modes - mode))]))
        A_f, W_f, L_f, neutral = parts.A_1, parts.W_1, parts.L_1, np.zeros((0, 0))
        if endless and np.any(axis):
            inner = invariant_parts(A_f, lambda mode: not axis[np.argmin(np.abs(modes - mode))])
            A_f = scipy.linalg.block_diag(inner.A_1, np.zeros_like(inner.A_2))  # where it may rest anywhere nothing moves it
            W_f, L_f = W_f @ np.hstack([inner.W_1, inner.W_2]), np.vstack([inner.L_1, inner.L_2]) @ L_f
            neutral = np.zeros_like(inner.A_2)
        n, rho = self.plant.n_states, len(form.C_star)
        into = scipy.linalg.block_diag(form.N, self.priced.T @ form.V.T) / d[:, None]
        out = scipy.linalg.block_diag(form.V, form.N.T @ self.priced) * d
        built = []
        for A, W in ((A_f, W_f), (parts.A_2, parts.W_2)):
            joined, u = out @ W, self.u_xi @ (d[:, None] * W)
            x = joined[:n]
            built.append(Part(A, tracking_values(self.plant, x, x @ A, np.zeros((self.plant.n_outputs, len(A))), u), joined))
        T = np.vstack([np.hstack([form.C_star, np.zeros((rho, n))]), L_f @ into, parts.L_2 @ into])
        slack = np.vstack([np.zeros((n, rho)), form.C_star.T])
        system = TwoSidedSystem(built[0], built[1], T, rho, neutral, slack)
        drive = self.G / d[:, None]
        return AllocatedInverse(self, system, L_f @ drive, parts.L_2 @ drive)


def _resting_places(internal: InternalDynamics, R: Array, FV: Array, terms: Array) -> tuple[Array, Array]:
    """Orthonormal bases of where the internal state stays wherever it is put, without any input, and of the rest.

    FV (m, n_z): the input that the internal state takes, with the sizes of the terms that it is the sum of.
    """
    A_eta, scale = internal.A_eta, np.sqrt(np.diag(R))[:, None]
    A_couples = max(COUPLING_TOLERANCE * float(np.linalg.norm(A_eta)), ERROR_GROWTH * internal.uncertainty)
    F_couples = COUPLING_TOLERANCE * float(np.linalg.norm(scale * terms))
    _, sizes, Vh = np.linalg.svd(np.vstack([A_eta / as_divisor(A_couples), scale * FV / as_divisor(F_couples)]))
    moved = int(np.sum(sizes > 1.0))
    return Vh[moved:].T, Vh[:moved].T


def require_same_resting_places(inverses: Sequence[AllocatedInverse]) -> None:
    """Raises NonHyperbolicError where what may rest anywhere changes at a jump, so that no input is the cheapest."""
    first = inverses[0]
    basis, units = first.internal.form.V @ first.dynamics.anywhere, first.internal.form.units[:, None]
    for k, each in enumerate(inverses[1:], start=1):
        other = each.internal.form.V @ each.dynamics.anywhere
        same = basis.shape == other.shape
        if same and basis.shape[1]:
            same = bool(np.max(scipy.linalg.subspace_angles(basis / units, other / units)) <= SAME_SUBSPACE)
        if not same:
            raise NonHyperbolicError(
                f"what the inputs left over can shift without changing an output or taking an input differs between interval 0 and "
                f"interval {k} ({basis.shape[1]} and {other.shape[1]} direction(s)), so that no input is the cheapest; track it as "
                "a further output, or hold it by a spring"
            )


@dataclass(frozen=True, eq=False)
class AllocatedInverse:
    """The allocated dynamics in a part that runs forward and one that runs backward; continuous through a jump are [x; costate].

    The costate of the whole state is N'lambda and, of what the outputs prescribe, whatever it takes: it may jump along C*'.
    """

    dynamics: AllocatedDynamics
    system: TwoSidedSystem
    G_f: Array
    G_b: Array

    @property
    def internal(self) -> InternalDynamics:
        """The internal dynamics of the plant."""
        return self.dynamics.internal

    def driven(self, generator: Generator) -> DrivenSystem:
        """The inverse for outputs y_d = R w, w' = S w."""
        form, plant = self.internal.form, self.dynamics.plant
        Z, highest = form.zeta.rows(generator.derivative), form.chi.rows(generator.derivative)
        drive, x = np.vstack([Z, highest, generator.R]), form.P @ Z
        D_f, D_b, n = self.G_f @ drive, self.G_b @ drive, plant.n_states
        rate = self.system.forward.J[:n] @ D_f + self.system.backward.J[:n] @ D_b + x @ generator.S
        values = tracking_values(plant, x, rate, generator.R, self.dynamics.u_w @ drive)
        return DrivenSystem(system=self.system, S=generator.S, D_f=D_f, D_b=D_b, X_w=values, J_w=np.vstack([x, np.zeros_like(x)]))
