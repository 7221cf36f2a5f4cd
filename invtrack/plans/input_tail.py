"""The input of a plan before or after its manoeuvre, as the sum of modes that die out away from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import TrajectoryError
from invtrack.linear.propagation import flow
from invtrack.plans.plan import Plan
from invtrack.plans.tail import Side

UNEXCITED = 1e-12
"""A mode with less than this share of the input's tail is rounding."""

SAME_RATE = 1e-6
"""Modes whose real parts differ by less than this share are equally slow (rounding splits repeated ones)."""

SAMPLES = 40_000
"""Points at which a tail is looked at, at most."""


@dataclass(frozen=True, eq=False)
class InputTail:
    """u - u_rest = X exp(M sigma) z at distance sigma >= 0 [s] from the trajectory's edge: the sum of shares_j exp(rates_j sigma).

    Args:
        edge: the trajectory's first or last breakpoint [s].
        M, X, z: (n_z, n_z), (p, n_z) and (n_z,); without states where nothing is left of the input there.
        rates: eigenvalues of M whose modes appear in the input (k,) [rad/s].
        shares: what each of these modes adds to the input at the edge (p, k).
        vectors: eigenvectors of M that belong to the rates (n_z, k).
    """

    edge: float
    M: Array
    X: Array
    z: Array
    rates: ComplexArray
    shares: ComplexArray
    vectors: ComplexArray

    def __bool__(self) -> bool:
        """Whether there is anything left of the input."""
        return len(self.z) > 0

    @property
    def slowest(self) -> float:
        """Rate at which the slowest mode dies out [1/s]; not positive where it does not."""
        return float(np.min(-self.rates.real))

    def size(self, sigma: Array, shift: float = 0.0) -> Array:
        """exp(shift sigma) |u - u_rest| at each distance sigma (m,) [s], in the Euclidean norm over the inputs."""
        states = flow(shift * np.eye(len(self.M)) + self.M, np.broadcast_to(self.z, (len(sigma), len(self.z))), sigma)
        return np.asarray(np.linalg.norm(states @ self.X.T, axis=1))

    def distances(self, horizon: float) -> Array:
        """Distances from 0 to the horizon [s], close enough for the fastest mode as far as their number allows."""
        count = int(np.clip(np.ceil(200 * horizon * np.max(np.abs(self.rates))), 200, SAMPLES))
        return np.linspace(0.0, max(horizon, np.finfo(float).tiny), count)

    def amplitude(self, chosen: NDArray[np.bool_] | slice = slice(None)) -> float:
        """Bound on |sum_j shares_j exp(i Im(rates_j) sigma)| over all sigma, reached where frequencies have no common measure.

        chosen: which of the modes (k,), conjugates together; all by default.
        """
        rates, shares = self.rates[chosen], self.shares[:, chosen]
        real, upper = np.abs(rates.imag) <= SAME_RATE * np.abs(rates), rates.imag > SAME_RATE * np.abs(rates)
        amplitude = float(np.linalg.norm(np.sum(shares[:, real].real, axis=1)))
        for share in shares[:, upper].T:
            amplitude += 2 * float(np.linalg.norm(np.column_stack([share.real, share.imag]), 2))
        return amplitude


def input_tail(plan: Plan, side: Side) -> InputTail:
    """What a plan's input does before or after its manoeuvre. Raises TrajectoryError where the reference goes on moving there."""
    before = side == "before"
    tail = plan.trajectory.before if before else plan.trajectory.after
    edge = float(plan.breakpoints[0 if before else -1])
    n, p = plan.model.n_states, plan.model.n_inputs
    rows = slice(n, n + p)
    if np.any(np.isnan(plan.rest_inputs[0 if before else 1])):
        there = "before its start" if before else "after its end"
        raise TrajectoryError(
            f"the plan is not at rest {side} its manoeuvre: the reference moves there for ever; let it hold still {there}"
        )
    if not tail.departs:
        return _nothing(edge, p)
    M, X, z = tail.departure.M, tail.X[rows], tail.v
    rates, vectors = np.linalg.eig(M)
    shares = (X @ vectors) * np.linalg.solve(vectors, z.astype(complex))
    size = np.linalg.norm(shares, axis=0)
    excited = size > UNEXCITED * max(float(np.max(size)), UNEXCITED * float(np.linalg.norm(np.abs(X) @ np.abs(z))))
    if not np.any(excited):
        return _nothing(edge, p)
    return InputTail(edge, M, X, z, rates[excited], shares[:, excited], vectors[:, excited])


def _nothing(edge: float, p: int) -> InputTail:
    none = np.zeros(0, dtype=complex)
    return InputTail(edge, np.zeros((0, 0)), np.zeros((p, 0)), np.zeros(0), none, np.zeros((p, 0), dtype=complex), none[None])
