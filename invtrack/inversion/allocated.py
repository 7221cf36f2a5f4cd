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
from invtrack.inversion.axis_zeros import REST_TOLERANCE, resolved_inverse
from invtrack.inversion.input_measure import held_inputs
from invtrack.inversion.tracking_values import tracking_values
from invtrack.linear.hidden_modes import COUPLING_TOLERANCE, ERROR_GROWTH, zero_kinds
from invtrack.linear.internal_dynamics import (
    NOT_UNIQUE,
    ROUNDING_FACTOR,
    InternalDynamics,
    axis_message,
    internal_dynamics,
    on_axis,
)
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.pseudospectrum import Pseudospectrum
from invtrack.linear.staircase import unreached
from invtrack.linear.state_space import StateSpace
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import TwoSidedSolution
from invtrack.references.generator import Generator

SAME_SUBSPACE = 1e-7
"""Largest principal angle [rad], in balanced states, between subspaces that count as the same."""


@dataclass(frozen=True, eq=False)
class AllocatedDynamics:
    """Internal dynamics and their costate under the inputs of least cost: xi' = A xi + G [zeta; chi; y_d].

    u = F x + G_r chi + Z v (`NormalForm.tracking_law`) has the least integral of (u - N_u y_d)'R (u - N_u y_d), N_u y_d being the
    input at rest, for v = Z'R N_u y_d - B_v'lambda with the costate lambda of eta, lambda' = -dH/deta (Pontryagin's conditions):
    a regular problem in the inputs that are left over, which asks no more derivatives of the outputs than the inverse does.

    Motions of eta that take no input, and neither grow nor die out (a heading that nobody asks for, a base that may stand anywhere
    while the stage on it makes up for that), cost nothing. No input is spent on them: their part of the costate is zero. They start
    at rest, and where the others leave them at rest nothing cheaper exists. With eta = U eta_0 + P eta_1, of which eta_0 costs
    nothing, xi = [eta_1; P'lambda] and eta_0' = A_0 eta_0 + K xi + G_0 [zeta; chi; y_d].

    Args:
        plant: the system.
        internal: its internal dynamics, with inputs weighed by R.
        U, P: orthonormal, (n_z, k) and (n_z, n_z - k).
        A, A_0, K: (2 (n_z - k), 2 (n_z - k)), (k, k) and (k, 2 (n_z - k)).
        G, G_0: (2 (n_z - k), rho + 2 p) and (k, rho + 2 p).
        u_xi, u_w: u = u_xi xi + u_w [zeta; chi; y_d], (m, 2 (n_z - k)) and (m, rho + 2 p).
    """

    plant: StateSpace
    internal: InternalDynamics
    U: Array
    P: Array
    A: Array
    A_0: Array
    K: Array
    G: Array
    G_0: Array
    u_xi: Array
    u_w: Array

    @classmethod
    def of(cls, plant: StateSpace, R: Array) -> AllocatedDynamics:
        """Those of `plant`, with inputs weighed by R (m, m). Raises RelativeDegreeError."""
        internal = internal_dynamics(plant, R)
        form = internal.form
        F, G_r, Z = form.tracking_law(R)
        U, P = _unpriced(internal, R)
        N_u, FV, B_v, A_eta = held_inputs(plant, R), F @ form.V @ P, P.T @ internal.B_v, internal.A_eta @ P
        shift, u_r = Z.T @ R @ N_u, np.hstack([F @ form.P, G_r])
        driven, adjoint = np.hstack([internal.A_zeta, internal.B_r, internal.B_v @ shift]), -FV.T @ R
        A = np.block([[P.T @ A_eta, -B_v @ B_v.T], [adjoint @ FV, -A_eta.T @ P]])
        return cls(
            plant=plant,
            internal=internal,
            U=U,
            P=P,
            A=A,
            A_0=U.T @ internal.A_eta @ U,
            K=np.hstack([_without_rounding(plant, U.T @ form.N, F, form.V @ P), -U.T @ internal.B_v @ B_v.T]),
            G=np.vstack([P.T @ driven, adjoint @ np.hstack([u_r, -G_r @ form.B_y @ N_u])]),
            G_0=np.hstack([_without_rounding(plant, U.T @ form.N, F, form.P, G_r), U.T @ internal.B_v @ shift]),
            u_xi=np.hstack([FV, -Z @ B_v.T]),
            u_w=np.hstack([u_r, Z @ shift]),
        )

    @cached_property
    def modes(self) -> ComplexArray:
        """The eigenvalues of A, as many on the one side of the axis as on the other."""
        return np.asarray(np.linalg.eigvals(self._balanced)).astype(complex)

    @cached_property
    def _scale(self) -> Array:
        """Units of xi: eta's are balanced, the costate's such that what it does to eta is as strong as what eta does to it."""
        n = self.P.shape[1]
        own, acts, acted_on = (np.linalg.norm(M) for M in (self.A[:n, :n], self.A[:n, n:], self.A[n:, :n]))
        ratio = acted_on / acts if acts > 0 else (acted_on / own) ** 2 if own > 0 else 1.0
        unit = np.exp2(np.rint(np.log2(ratio) / 2)) if ratio > 0 else 1.0
        return np.concatenate([np.ones(n), np.full(n, unit)])

    @cached_property
    def _balanced(self) -> Array:
        return np.asarray(self.A * self._scale / self._scale[:, None])

    @cached_property
    def on_axis(self) -> NDArray[np.bool_]:
        """Which of the modes cannot be told from ones on the imaginary axis; zeros of the plant among them are judged as such."""
        rounding = ROUNDING_FACTOR * len(self.A) * float(np.finfo(float).eps * np.linalg.norm(self._balanced))
        found = Pseudospectrum(self._balanced).joins_axis(self.modes, max(rounding, self.internal.uncertainty))
        for zero in self.internal.zeros[~on_axis(self.internal)]:
            for mode in (zero, -zero):
                found[np.argmin(np.abs(self.modes - mode))] = False
        return found

    def require_hyperbolic(self) -> None:
        """Raises NonHyperbolicError for modes on the imaginary axis that no plan brings to rest, with what they are."""
        zeros = on_axis(self.internal)
        if np.any(zeros):
            raise NonHyperbolicError(axis_message(self.internal, zeros, zero_kinds(self.plant, self.internal.zeros), NOT_UNIQUE))
        if np.any(self.on_axis):
            raise NonHyperbolicError(
                f"the inputs left over have modes at {_frequencies(self.modes[self.on_axis])} rad/s on the imaginary axis, which "
                "neither die out before the manoeuvre nor after it; track a further output, damp what moves there, or weigh the "
                "inputs otherwise (R)"
            )

    def inverse(self, *, endless: bool) -> AllocatedInverse:
        """The bounded inverse; modes on the imaginary axis are refused where the interval is `endless`, else run forward."""
        if endless:
            self.require_hyperbolic()
        modes, d, form = self.modes, self._scale, self.internal.form
        stable, k = self.on_axis | (modes.real <= 0), self.U.shape[1]
        # By the nearest mode: reordering the Schur form puts one on the axis to either side of it.
        parts = invariant_parts(self._balanced, lambda mode: bool(stable[np.argmin(np.abs(modes - mode))]))
        # eta_0 - X xi is driven by the outputs alone.
        X = scipy.linalg.solve_sylvester(self.A_0, -self.A, -self.K) if k and len(modes) else np.zeros_like(self.K)
        W_f, W_b = d[:, None] * parts.W_1, d[:, None] * parts.W_2
        n, rho = self.plant.n_states, len(form.C_star)
        from_xi = scipy.linalg.block_diag(form.V @ self.P, form.N.T @ self.P)
        from_xi[:n] += form.V @ self.U @ X
        at_rest = np.vstack([form.V @ self.U, np.zeros((n, k))])
        to_xi = scipy.linalg.block_diag(self.P.T @ form.N, self.P.T @ form.V.T)
        to_rest = np.hstack([self.U.T @ form.N, np.zeros((k, n))]) - X @ to_xi
        forward = self._part(
            scipy.linalg.block_diag(parts.A_1, self.A_0),
            np.hstack([from_xi @ W_f, at_rest]),
            np.pad(self.u_xi @ W_f, ((0, 0), (0, k))),
        )
        backward = self._part(parts.A_2, from_xi @ W_b, self.u_xi @ W_b)
        L_f, L_b = np.vstack([parts.L_1 / d @ to_xi, to_rest]), parts.L_2 / d @ to_xi
        slack = np.vstack([np.zeros((n, rho)), form.C_star.T])
        neutral = resolved_inverse(self.A_0, self.internal.uncertainty) if endless else np.zeros((0, 0))
        T = np.vstack([np.hstack([form.C_star, np.zeros((rho, n))]), L_f, L_b])
        system = TwoSidedSystem(forward, backward, T, rho, neutral, slack)
        return AllocatedInverse(self, system, np.vstack([parts.L_1 / d @ self.G, self.G_0 - X @ self.G]), parts.L_2 / d @ self.G)

    def _part(self, A: Array, joined: Array, u: Array) -> Part:
        """A part z' = A z of which [x; costate] is `joined` z, and the input u z."""
        x = joined[: self.plant.n_states]
        return Part(A, tracking_values(self.plant, x, x @ A, np.zeros((self.plant.n_outputs, len(A))), u), joined)


def _without_rounding(plant: StateSpace, L: Array, F: Array, X: Array, G_r: Array | None = None) -> Array:
    """[L (A + B F) X, L B G_r] without what is rounding of its terms, or may be an error of the model: rest must stay at rest."""
    left, law = np.abs(L), np.abs(F)
    found = [L @ (plant.A + plant.B @ F) @ X]
    terms = [left @ (np.abs(plant.A) + np.abs(plant.B) @ law) @ np.abs(X)]
    errors = [left @ (plant.errors("A") + plant.errors("B") @ law) @ np.abs(X)]
    if G_r is not None:
        found.append(L @ plant.B @ G_r)
        terms.append(left @ np.abs(plant.B) @ np.abs(G_r))
        errors.append(left @ plant.errors("B") @ np.abs(G_r))
    value, noise = np.hstack(found), np.maximum(COUPLING_TOLERANCE * np.hstack(terms), ERROR_GROWTH * np.hstack(errors))
    return np.where(np.abs(value) <= noise, 0.0, value)


def _unpriced(internal: InternalDynamics, R: Array) -> tuple[Array, Array]:
    """Orthonormal bases of the motions of eta that take no input and neither grow nor die out, and of the rest."""
    form, A_eta, n_z, scale = internal.form, internal.A_eta, len(internal.A_eta), np.sqrt(np.diag(R))[:, None]
    F, G_r, _ = form.tracking_law(R)
    FV, size = scale * F @ form.V, np.abs(form.V)
    terms, error = (float(np.linalg.norm(scale * part @ size)) for part in (np.abs(F), np.abs(G_r) @ form.A_x_error))
    A_couples = max(COUPLING_TOLERANCE * float(np.linalg.norm(A_eta)), ERROR_GROWTH * internal.uncertainty)
    F_couples = max(COUPLING_TOLERANCE * terms, ERROR_GROWTH * error)
    free = unreached([A_eta.T / as_divisor(A_couples)], FV.T / as_divisor(F_couples))
    within = free.T @ A_eta @ free
    modes = np.linalg.eigvals(within).astype(complex)
    axis = Pseudospectrum(within).joins_axis(modes, max(internal.uncertainty, A_couples))
    kept = invariant_parts(within, lambda mode: bool(axis[np.argmin(np.abs(modes - mode))])).W_1
    Q = np.linalg.qr(np.hstack([free @ kept, np.eye(n_z)]))[0]
    return Q[:, : kept.shape[1]], Q[:, kept.shape[1] :]


def require_unpriced_rest(
    problem: PlanningProblem, inverses: Sequence[AllocatedInverse], equations: TwoSidedSolution
) -> tuple[str, ...]:
    """What a user should know about motions that cost nothing, and where they come to rest.

    Raises NonHyperbolicError where the manoeuvre leaves them moving: then no input is the cheapest.
    """
    last = inverses[-1].dynamics
    if not len(last.A_0):
        return ()
    left, size = equations.unrest
    share = float(np.linalg.norm(left)) / size if size > 0 else 0.0
    states = _involved(last, problem.plant.states.names)
    if share > REST_TOLERANCE:
        modes = _frequencies(np.linalg.eigvals(last.A_0).astype(complex))
        raise NonHyperbolicError(
            f"the inputs left over could stop at no cost what the manoeuvre leaves moving: a motion of {states} at {modes} rad/s "
            "changes no output and takes no input, so that there is no cheapest way to bring it to rest, only ever slower ones; "
            "track it as a further output, damp it, or hold it by a spring"
        )
    return (f"nothing is asked of the motion of {states}, which changes no output and takes no input",)


def _involved(dynamics: AllocatedDynamics, names: Sequence[str]) -> str:
    """The states that take part in motions that cost nothing."""
    form = dynamics.internal.form
    part = np.linalg.norm(form.V @ dynamics.U / form.units[:, None], axis=1)
    return ", ".join(name for name, share in zip(names, part, strict=True) if share > 1e-3 * np.max(part))


def _frequencies(modes: ComplexArray) -> str:
    """Their frequencies as text, those that rounding has split together."""
    frequencies, size = np.abs(modes.imag), float(np.max(np.abs(modes), initial=0.0))
    apart = np.unique(np.round(frequencies / size, 3)) * size if size > 0 else np.zeros(1)
    return ", ".join(f"{w:.3g}" for w in apart)


def require_same_unpriced(inverses: Sequence[AllocatedInverse]) -> None:
    """Raises NonHyperbolicError where what costs nothing changes at a jump, so that no input is the cheapest."""
    first = inverses[0]
    basis, units = first.internal.form.V @ first.dynamics.U, first.internal.form.units[:, None]
    for k, each in enumerate(inverses[1:], start=1):
        other = each.internal.form.V @ each.dynamics.U
        same = basis.shape == other.shape
        if same and basis.shape[1]:
            same = bool(np.max(scipy.linalg.subspace_angles(basis / units, other / units)) <= SAME_SUBSPACE)
        if not same:
            raise NonHyperbolicError(
                f"what the inputs left over can move without changing an output or taking an input differs between interval 0 and "
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
