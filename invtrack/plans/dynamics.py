"""Nonlinear dynamics as planning sees them: states on a manifold, motions over short elements of time, derivatives along them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import singledispatch
from typing import Protocol

from invtrack.arrays import Array, Indices
from invtrack.channels import Channels
from invtrack.linear.state_space import StateSpace
from invtrack.plans.runge_kutta import Steps


@dataclass(frozen=True, eq=False)
class Derivatives:
    """x' = f(x, u), y = h(x, u) at k points, and their derivatives in tangent coordinates.

    Args:
        rates, outputs: x' (k, n), in the tangent space at each point, and y (k, p).
        A, B, C, D: (k, n, n), (k, n, m), (k, p, n) and (k, p, m): d' = A d + B v for a neighbouring motion that is d off in the
            tangent space of the point that moves.
    """

    rates: Array
    outputs: Array
    A: Array
    B: Array
    C: Array
    D: Array


class Dynamics(Protocol):
    """Smooth dynamics x' = f(x, u), y = h(x, u) for one set of values of the physical parameters.

    States are points, rows of any length that only the dynamics themselves know how to read; they differ by tangent vectors (n,).
    Inputs and outputs are absolute.
    """

    @property
    def size(self) -> int:
        """Number of tangent coordinates, n."""
        ...

    @property
    def state_coordinates(self) -> Indices:
        """The tangent coordinates that are states of controllers and plans; the others act on nothing."""
        ...

    def motion(self, points: Array, coefficients: Array, steps: Steps, lengths: Array) -> Array:
        """The points (k, S + 1, .) on k motions, at their starts and at the ends of S even steps.

        Args:
            points: where they start (k, .).
            coefficients: of the polynomials u = sum_i coefficients[:, i] P_i (k, s, m).
            steps: the S steps, and P_i at their stages.
            lengths: how long they last (k,) [s].
        """
        ...

    def evaluate(self, points: Array, inputs: Array) -> tuple[Array, Array]:
        """Rates x' (k, n) and outputs (k, p) at points (k, .) with inputs (k, m)."""
        ...

    def derivatives(self, points: Array, inputs: Array, *, rough: bool = False) -> Derivatives:
        """The same and their derivatives; rough: as good as the steps of an iteration need them, at about half the work."""
        ...

    def retract(self, points: Array, tangents: Array) -> Array:
        """The points that lie at tangents (k, n) from points (k, .)."""
        ...

    def difference(self, points: Array, origins: Array) -> Array:
        """The tangents (k, n) that lead from the origins (k, .) to the points (k, .)."""
        ...

    def output_difference(self, outputs: Array, wanted: Array) -> Array:
        """outputs - wanted (..., p), angles by the shorter way round."""
        ...

    def states(self, points: Array) -> Array:
        """The states (k, .) of points, as controllers and plans have them: deviations from the operating point."""
        ...

    def state_rates(self, points: Array, rates: Array) -> Array:
        """The time derivatives (k, .) of these states, for points (k, .) that move at rates (k, n)."""
        ...

    def linear_model(self, point: Array, inputs: Array) -> StateSpace:
        """The linear model about an equilibrium, its states measured from the operating point."""
        ...

    def require_free(self, points: Array, inputs: Array) -> None:
        """Raises PlantError where something acts on the real plant that smooth dynamics leave out, such as a contact."""
        ...

    def replay(self, points: Array, coefficients: Array, lengths: Array, steps: int) -> tuple[Array, Array]:
        """The points (k, steps, .) and outputs (k, steps, p) at the ends of even steps of k motions, by other means than `motion`.

        Args:
            points, coefficients, lengths: as in `motion`; the polynomials are Legendre's, shifted to each element.
            steps: how many.
        """
        ...


class ScheduledChange(Protocol):
    """At `time` [s] named physical parameters take new values."""

    @property
    def time(self) -> float: ...

    @property
    def parameters(self) -> Mapping[str, float]: ...


class Mechanism(Protocol):
    """What has nonlinear dynamics, in which named physical parameters may change."""

    @property
    def name(self) -> str: ...

    @property
    def inputs(self) -> Channels: ...

    @property
    def outputs(self) -> Channels: ...

    @property
    def states(self) -> Channels: ...

    @property
    def parameter_values(self) -> Mapping[str, float]:
        """The parameters' values before any change."""
        ...

    @property
    def operating_point(self) -> tuple[Array, Array]:
        """The point from which states are measured, and the inputs there."""
        ...

    def dynamics(self, values: Mapping[str, float]) -> Dynamics:
        """The dynamics for these values of the parameters, all of them or some."""
        ...

    @property
    def turns(self) -> bool:
        """Whether states differ by more than a plain difference: rotations in space."""
        ...

    def state_difference(self, x: Array, x_ref: Array) -> Array:
        """x minus x_ref, both (n,), as deviation in the tangent space of x_ref."""
        ...


@singledispatch
def mechanism(model: object) -> Mechanism | None:
    """The nonlinear dynamics of a model, None where it has none; whoever has some registers its class here."""
    return None
