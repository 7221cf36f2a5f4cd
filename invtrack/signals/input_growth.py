"""The input of a plan before its manoeuvre, as the sum of modes that grow towards it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.errors import TrajectoryError
from invtrack.lti.propagation import flow
from invtrack.signals.nominal import NominalTrajectory

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

REST_TOLERANCE = 1e-9
"""What does not grow may still change by this share of its terms and counts as rest."""

UNEXCITED = 1e-12
"""A mode with less than this share of the input before the manoeuvre is rounding."""


@dataclass(frozen=True, eq=False)
class InputGrowth:
    """u(t_0 - sigma) - u_rest = X exp(-A sigma) z, A antistable, in modes: the same is sum_j shares_j exp(-rates_j sigma)."""

    A: Array
    X: Array
    z: Array
    u_rest: Array
    rates: ComplexArray
    shares: ComplexArray
    vectors: ComplexArray

    def size(self, sigma: Array, shift: float = 0.0) -> Array:
        """exp(shift sigma) |u(t_0 - sigma) - u_rest| at each sigma >= 0 [s]."""
        states = flow(shift * np.eye(len(self.A)) - self.A, np.broadcast_to(self.z, (len(sigma), len(self.z))), sigma)
        return np.asarray(np.linalg.norm(states @ self.X.T, axis=1))


def input_growth(nominal: NominalTrajectory) -> InputGrowth:
    """The modes of the plan's first piece. Raises TrajectoryError for a plan that is not at rest before its manoeuvre."""
    trajectory = nominal.trajectory
    generator = trajectory.generators[trajectory.kind[0]]
    n, p = nominal.model.systems[0].n_states, nominal.model.systems[0].n_channels
    M, X = generator.M_b, generator.X_b[n : n + p]
    v = trajectory.v_b[0, : len(M)]
    u_0 = nominal.model.systems[0].operating_point.u0
    if not len(M):
        return _none(u_0)
    schur, Q, k = scipy.linalg.schur(M, output="real", sort=lambda re, im: re > REST_TOLERANCE * np.linalg.norm(M))
    A, rest, coupling = schur[:k, :k], schur[k:, k:], np.zeros((k, len(M) - k))
    if 0 < k < len(M):
        coupling = scipy.linalg.solve_sylvester(A, -rest, -schur[:k, k:])
    q = Q.T @ v
    X_rest = X @ (Q[:, :k] @ coupling + Q[:, k:])
    moving = np.abs(X_rest) @ np.abs(rest @ q[k:])
    if np.any(moving > 1e3 * REST_TOLERANCE * np.linalg.norm(M) * (np.abs(X_rest) @ np.abs(q[k:]) + np.abs(X) @ np.abs(v))):
        raise TrajectoryError(
            "the plan is not at rest before its manoeuvre: the reference moves there for ever; let it hold still before its start"
        )
    u_rest = u_0 + X_rest @ q[k:]
    if k == 0:
        return _none(u_rest)
    X_u, z = X @ Q[:, :k], q[:k] - coupling @ q[k:]
    rates, vectors = np.linalg.eig(A)
    shares = (X_u @ vectors) * np.linalg.solve(vectors, z.astype(complex))
    size = np.linalg.norm(shares, axis=0)
    excited = size > UNEXCITED * max(float(np.max(size)), UNEXCITED * float(np.linalg.norm(np.abs(X) @ np.abs(v))))
    if not np.any(excited):
        return _none(u_rest)
    return InputGrowth(A, X_u, z, u_rest, rates[excited], shares[:, excited], vectors[:, excited])


def _none(u_rest: Array) -> InputGrowth:
    none = np.zeros(0, dtype=complex)
    return InputGrowth(np.zeros((0, 0)), np.zeros((len(u_rest), 0)), np.zeros(0), u_rest, none, none[None], none[None])
