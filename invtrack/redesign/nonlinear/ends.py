"""What it costs to leave a rest, and to come to one: the linear redesign about it, in closed form."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.inversion.nonlinear.transfer import Outside
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.tail import SIDES, Side, Tail
from invtrack.redesign.cost import Weights
from invtrack.redesign.optimum import TrackedSystem, optimum

UNMOVED = 1e-12
"""Directions that cost less than this share of the dearest, in units in which each costs as much, are out of the input's reach."""

SAMPLES = 200
"""Instants at which a tail is held against the nonlinear dynamics."""

TAIL_TIMES = 20.0
"""Time constants of its slowest mode over which it is."""


@dataclass(frozen=True, eq=False)
class RestEnd:
    """The optimum of the linear model at a rest, on the side of the window away from the manoeuvre.

    x = X v, u = U v, y = Y v as deviations from rest, costate = S v, with v = exp(M sigma) v_0 at a distance sigma [s] from the
    window's edge: before it the cheapest way from rest to x, after it the cheapest way back to rest.

    Args:
        side: of the manoeuvre.
        dynamics, rest: where it comes from, or goes to.
        M: stable (n, n).
        X, U, Y, S: (n, n), (m, n), (p, n) and (n, n), of the states of controllers and plans.
    """

    side: Side
    dynamics: Dynamics
    rest: Rest
    M: Array
    X: Array
    U: Array
    Y: Array
    S: Array

    @classmethod
    def of(cls, side: Side, dynamics: Dynamics, rest: Rest, model: StateSpace, weights: Weights) -> RestEnd:
        """The end at a rest with this linear model. Raises RedesignError where the linear redesign does."""
        system = optimum(TrackedSystem.of([model]), weights).system
        part = system.backward if side == "before" else system.forward
        X, U, Y, S = np.split(part.X, np.cumsum([model.n_states, model.n_inputs, model.n_outputs]))
        return cls(side, dynamics, rest, -part.A if side == "before" else part.A, X, U, Y, S)

    @cached_property
    def tail_weight(self) -> Array:
        """V (n, n), where the tail costs v'V v: costates are half the gradient of what is to come, less that of what is past."""
        V = self.X.T @ self.S
        return (-1.0 if self.side == "before" else 1.0) * (V + V.T) / 2

    @cached_property
    def state_weight(self) -> Array:
        """P (n, n), where coming to rest from a deviation x costs x'P x."""
        P = np.linalg.solve(self.X.T, self.S.T)
        return np.asarray((P + P.T) / 2)

    @property
    def slowest(self) -> float:
        """Rate [1/s] at which its slowest mode dies out."""
        return float(-np.max(np.linalg.eigvals(self.M).real, initial=-np.inf))

    @property
    def fastest(self) -> float:
        """Size [rad/s] of its fastest mode."""
        return float(np.max(np.abs(np.linalg.eigvals(self.M)), initial=0.0))

    def point(self, v: Array) -> Array:
        """The state that the way from rest to `v` ends in, as a point."""
        return np.asarray(self.dynamics.retract(self.rest.point[None], self._in_tangent(self.X @ v)[None])[0])

    def coordinates(self, point: Array) -> Array:
        """v (n,) of the state in which the window ends, where the way back to rest begins."""
        return np.asarray(np.linalg.solve(self.X, self.away(point)))

    def away(self, point: Array) -> Array:
        """The states' deviation (n,) of a point from rest."""
        tangent = self.dynamics.difference(point[None], self.rest.point[None])[0]
        return np.asarray(tangent[self.dynamics.state_coordinates])

    def further(self, v: Array, distance: float) -> Array:
        """v of the state so far out [s]."""
        return np.asarray(scipy.linalg.expm(self.M * distance) @ v)

    def step(self, v: Array, P: Array, p: Array, gap: Array) -> Array:
        """dv with the least (v + dv)'V (v + dv) + dx'P dx + 2 p'dx, dx = X dv + gap: how a window starts that costs so much."""
        H, g = self.tail_weight + self.X.T @ P @ self.X, self.tail_weight @ v + self.X.T @ (p + P @ gap)
        return -solve_semidefinite(H, g)

    def tail(self, v: Array, held: Array, rows: Array) -> Tail:
        """The tail with values rows v + held beyond the window: rows (r, n), held (r,)."""
        return Tail(
            direction=-1 if self.side == "before" else 1,
            departure=Propagator(self.M),
            X=rows,
            v=v,
            S=np.zeros((1, 1)),
            X_w=held[:, np.newaxis],
            w=np.ones(1),
        )

    def outside(self, v: Array, point: Array) -> Outside:
        """The motion beyond the window, which it joins in this point: what of it is no state of the plan is held."""
        n, m = self.dynamics.size, len(self.U)
        rows = np.zeros((n + m, self.X.shape[1]))
        rows[self.dynamics.state_coordinates], rows[n:] = self.X, self.U
        held = np.zeros(n + m)
        held[:n] = self.dynamics.difference(point[None], self.rest.point[None])[0] - rows[:n] @ v
        return Outside(self.dynamics, self.rest, self.tail(v, held, rows))

    def tail_error(self, v: Array, point: Array, sizes: Array) -> float:
        """By how much the tail misses the nonlinear dynamics in all, as a share of the states' sizes (n,)."""
        if not np.any(v):
            return 0.0
        outside, states = self.outside(v, point), self.dynamics.state_coordinates
        distance = TAIL_TIMES / self.slowest * np.linspace(0.0, 1.0, SAMPLES) ** 2  # dense where it leaves the window
        rates = self.dynamics.evaluate(outside.points(distance), outside.inputs(distance))[0][:, states]
        linear = outside.tail.derivative().values(distance, slice(self.dynamics.size), 0.0)[:, states]
        missed = np.trapezoid(np.abs(rates - linear), distance, axis=0)
        return float(np.max(missed / sizes))

    def _in_tangent(self, states: Array) -> Array:
        tangent = np.zeros(self.dynamics.size)
        tangent[self.dynamics.state_coordinates] = states
        return tangent


def solve_semidefinite(H: Array, g: Array) -> Array:
    """H^+ g of a positive semidefinite H, whatever the units; what costs nothing stays zero."""
    diagonal = np.diag(H)
    unit = 1 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    values, vectors = scipy.linalg.eigh(H * np.outer(unit, unit))
    kept = values > UNMOVED * np.max(values, initial=0.0)
    along = vectors[:, kept]
    return np.asarray(unit * (along @ ((along.T @ (unit * g)) / values[kept])))


def ends_of(
    dynamics: tuple[Dynamics, Dynamics], rests: tuple[Rest, Rest], models: tuple[StateSpace, StateSpace], weights: Weights
) -> tuple[RestEnd, RestEnd]:
    """Those before and after a manoeuvre."""
    before, after = (RestEnd.of(*each, weights) for each in zip(SIDES, dynamics, rests, models, strict=True))
    return before, after
