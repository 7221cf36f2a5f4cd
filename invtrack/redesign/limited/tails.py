"""What lies before and after a window in which a plan is limited: optima without limits, with the exact cost that they add."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.plans.ends import Departure
from invtrack.plans.plan import TwoSidedGenerator, TwoSidedTrajectory
from invtrack.redesign.weights import Weights

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Tail:
    """[x; u; y] = held + X exp(M sigma) v at distance sigma [s] from the window, M stable, any v (n,).

    direction: -1 where distance runs backward in time from the window's start, 1 where it runs forward from its end. weights: those
    of the optimum. Where the optimum holds still it costs nothing, so the cost is quadratic in v alone.
    """

    M: Array
    X: Array
    held: Array
    direction: int
    weights: Weights

    @cached_property
    def cost(self) -> Array:
        """V (n, n): the whole tail costs v'V v, of M'V + V M + X'W X = 0."""
        weight = scipy.linalg.block_diag(self.weights.Q_x, self.weights.R, self.weights.Q_y)
        V = scipy.linalg.solve_continuous_lyapunov(self.M.T, -self.X.T @ weight @ self.X)
        return np.asarray((V + V.T) / 2)

    def departure(self, v: Array) -> Departure:
        """The same as what dies out with distance from the window."""
        return Departure(self.M, self.X, v)

    def generator(self) -> TwoSidedGenerator:
        """That of [v; 1], given at the window's start or end."""
        M, X = scipy.linalg.block_diag(self.M, 0.0), np.column_stack([self.X, self.held])
        none, no_columns = np.zeros((0, 0)), np.zeros((len(X), 0))
        return TwoSidedGenerator(none, no_columns, -M, X) if self.direction < 0 else TwoSidedGenerator(M, X, none, no_columns)


def tails_of(optimum: TwoSidedTrajectory, weights: Weights) -> tuple[tuple[Tail, Array], tuple[Tail, Array]]:
    """The tails before and after an optimum without limits, each with the v that it has there."""
    before, after = (optimum.generators[optimum.kind[place]] for place in (0, -1))
    first, last = optimum.v_b[0, : len(before.M_b)], optimum.v_f[-1, : len(after.M_f)]
    return _tail(-before.M_b, before.X_b, first, -1, weights), _tail(after.M_f, after.X_f, last, 1, weights)


def _tail(M: Array, X: Array, v: Array, direction: int, weights: Weights) -> tuple[Tail, Array]:
    """From [s; 1] with s' = M_s s + M_1, relative to where s comes to rest."""
    rest = -np.linalg.solve(M[:-1, :-1], M[:-1, -1]) * v[-1]
    return Tail(M[:-1, :-1], X[:, :-1], X[:, :-1] @ rest + X[:, -1] * v[-1], direction, weights), v[:-1] - rest
