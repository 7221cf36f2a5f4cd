"""How fast states and outputs change where a plan is known: by its linear models, or by the mechanism's own dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.errors import PlanError
from invtrack.linear.switched import SAME_POINT, SwitchedSystem
from invtrack.plans.dynamics import Dynamics, Mechanism
from invtrack.plans.linearizations import Linearizations

ALONG = 2.0**-17
"""Shares of the quicker of states and inputs by which outputs are looked at ahead and behind."""


class Rates(Protocol):
    """Rates of change in given intervals of a model."""

    def __call__(self, interval: Indices, x: Array, u: Array, u_rate: Array) -> tuple[Array, Array, Array]:
        """x' (k, n), y (k, p) and y' (k, p).

        Args:
            interval: of the model (k,).
            x: states (k, n), as deviations from the operating point.
            u, u_rate: inputs (k, m), absolute, and their rates.
        """
        ...


@dataclass(frozen=True, eq=False)
class LinearRates:
    """By the linear model of each interval."""

    model: SwitchedSystem

    @cached_property
    def _matrices(self) -> tuple[Array, ...]:
        return tuple(np.array([getattr(system, name) for system in self.model.systems]) for name in "ABCD")

    def __call__(self, interval: Indices, x: Array, u: Array, u_rate: Array) -> tuple[Array, Array, Array]:
        """See `Rates`.

        Args:
            interval, x, u, u_rate: see `Rates`.
        """
        model, (A, B, C, D) = self.model, (matrix[interval] for matrix in self._matrices)
        away, acting = x - model.rest_states[interval], u - model.rest_inputs[interval]

        def times(M: Array, values: Array) -> Array:
            return np.asarray(np.einsum("kij,kj->ki", M, values))

        x_rate = times(A, away) + times(B, acting)
        y = model.rest_outputs[interval] + times(C, away) + times(D, acting)
        return x_rate, y, times(C, x_rate) + times(D, u_rate)


@dataclass(frozen=True, eq=False)
class MotionRates:
    """By the dynamics of a mechanism, with the parameters of each interval.

    Raises PlanError for a mechanism with other channels or parameters than the model's, or at another operating point.
    """

    mechanism: Mechanism
    model: SwitchedSystem

    def __post_init__(self) -> None:
        mechanism, model = self.mechanism, self.model
        for kind in ("states", "inputs", "outputs"):
            names, expected = getattr(mechanism, kind).names, getattr(model, kind).names
            if names != expected:
                raise PlanError(f"plant {mechanism.name!r} has the {kind} {list(names)}, the plan is for {list(expected)}")
        unknown = [name for name in model.parameters if name not in mechanism.parameter_values]
        if unknown:
            raise PlanError(f"the plan is for values of {unknown}, plant {mechanism.name!r} has none of these names")
        x0, origin = model.operating_point.x0, mechanism.operating_point[0]
        if x0.shape != origin.shape or np.any(np.abs(x0 - origin) > SAME_POINT * np.maximum(1.0, np.abs(x0))):
            raise PlanError(
                f"the plan's states count from the operating point {x0.tolist()}, plant {mechanism.name!r} stands at "
                f"{origin.tolist()}; take the plant that it was planned for, where it stood then (plant.at or invtrack.trim)"
            )

    @cached_property
    def _dynamics(self) -> tuple[Dynamics, ...]:
        return self.model.map(lambda system: self.mechanism.dynamics(system.parameters))

    def __call__(self, interval: Indices, x: Array, u: Array, u_rate: Array) -> tuple[Array, Array, Array]:
        """See `Rates`.

        Args:
            interval, x, u, u_rate: see `Rates`.
        """
        x_rate, y, y_rate = np.empty_like(x), np.empty((len(x), self.model.n_outputs)), np.empty((len(x), self.model.n_outputs))
        for k in np.unique(interval):
            chosen = np.flatnonzero(interval == k)
            dynamics, inputs, change = self._dynamics[k], u[chosen], u_rate[chosen]
            points = self._points(dynamics, x[chosen])
            rates, y[chosen] = dynamics.evaluate(points, inputs)
            x_rate[chosen] = dynamics.state_rates(points, rates)
            quickest = np.max(np.abs(np.hstack([rates, change])), axis=1, keepdims=True)
            step = ALONG / np.maximum(quickest, 1.0)
            ahead, behind = (
                dynamics.evaluate(dynamics.retract(points, sign * step * rates), inputs + sign * step * change)[1]
                for sign in (1.0, -1.0)
            )
            y_rate[chosen] = dynamics.output_difference(ahead, behind) / (2 * step)
        return x_rate, y, y_rate

    def along(self, edges: Array, interval: Indices, x: Array, u: Array) -> Linearizations:
        """The linear models in the middles of stretches.

        Args:
            edges: of the stretches (k + 1,) [s].
            interval: of the model in which each lies (k,).
            x, u: states (k, n) and inputs (k, m) in their middles.
        """
        n, m = self.model.n_states, self.model.n_inputs
        A, B = np.empty((len(x), n, n)), np.empty((len(x), n, m))
        for k in np.unique(interval):
            chosen, dynamics = np.flatnonzero(interval == k), self._dynamics[k]
            found, states = dynamics.derivatives(self._points(dynamics, x[chosen]), u[chosen]), dynamics.state_coordinates
            A[chosen], B[chosen] = found.A[:, states][:, :, states], found.B[:, states]
        return Linearizations(edges, A, B)

    def _points(self, dynamics: Dynamics, x: Array) -> Array:
        """The points (k, .) with these states (k, n), what acts on nothing at the operating point."""
        tangents = np.zeros((len(x), dynamics.size))
        tangents[:, dynamics.state_coordinates] = x
        return dynamics.retract(np.repeat(self.mechanism.operating_point[0][None], len(x), axis=0), tangents)
