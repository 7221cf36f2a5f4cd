"""A motion on elements and what it costs, and the linear-quadratic problem that stands for it near by."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.shooting import ElementChain, Motion
from invtrack.linear.state_sizes import comparable_size
from invtrack.plans.dynamics import Derivatives, Dynamics
from invtrack.redesign.cost import Weights
from invtrack.redesign.nonlinear.ends import RestEnd
from invtrack.redesign.nonlinear.sensitivities import interpolation, sensitivities

KNOTS = 5
"""Times on an element at which derivatives are taken; between these they are interpolated."""


@dataclass(frozen=True, eq=False)
class Course:
    """A motion, and where it starts: the end of the way from rest to v (n,); see `RestEnd`."""

    motion: Motion
    v: Array


@dataclass(frozen=True, eq=False)
class Linearized:
    """What changes [dx; dc] of an element's start and coefficients do at its nodes, to first order.

    Args:
        states, inputs, outputs: (N, S + 1, n, n + s m), (S + 1, m, n + s m) and (N, S + 1, p, n + s m).
    """

    states: Array
    inputs: Array
    outputs: Array


@dataclass(frozen=True, eq=False)
class Quadratics:
    """What elements cost and where they end, to second and to first order of changes [dx; dc] of their starts and coefficients.

    Cost of element k: [dx; dc]'H_k [dx; dc] + 2 g_k'[dx; dc] + constant, by Gauss-Newton's approximation; end: F_k dx + G_k dc +
    gaps_k beyond the next one's start.

    Args:
        H, g: (N, n + s m, n + s m) and (N, n + s m).
        F, G: (N, n, n) and (N, n, s m).
        gaps: (N, n).
    """

    H: Array
    g: Array
    F: Array
    G: Array
    gaps: Array


@dataclass(frozen=True, eq=False)
class CostedMotions(ElementChain):
    """Motions on a mesh with the cost of a redesign: integral of (u - u_rest)'R (u - u_rest) + (x - x_rest)'Q_x (x - x_rest) +
    (y - y_d)'Q_y (y - y_d) over the window, by Boole's (Simpson's) rule on the steps of integration, and of the ends beyond it.

    Args:
        dynamics: of each interval.
        mesh, scheme: elements, and polynomials on them.
        motion_size: of the outputs (p,), by which misses are measured.
        weights: of the cost.
        wanted, rest_inputs, rest_states: y_d, u_rest and x_rest at the ends and middles of all steps, (N, 2 S + 1, p),
            (N, 2 S + 1, m) and (N, 2 S + 1, n).
        unit_ratios: sizes of states that are comparable (n, n), see `invtrack.linear.state_sizes`.
        ends: before and after the window.
        number: of the mesh, among those that were tried, for the log.
        _last: the nodes of the motion that was asked for last, on which mesh.
    """

    dynamics: Sequence[Dynamics]
    mesh: Mesh
    scheme: Scheme
    motion_size: Array
    weights: Weights
    wanted: Array
    rest_inputs: Array
    rest_states: Array
    unit_ratios: Array
    ends: tuple[RestEnd, RestEnd]
    number: int = 1
    _last: list[tuple[Mesh, Motion, Array]] = field(default_factory=list, repr=False)

    @property
    def states(self) -> Indices:
        """The tangent coordinates that are states (n,)."""
        return self.dynamics[0].state_coordinates

    @property
    def shares(self) -> Array:
        """Of each element's length, that the cost at its S + 1 nodes stands for (S + 1,)."""
        return quadrature_shares(self.scheme.steps)

    @property
    def at_nodes(self) -> Array:
        """The polynomials at the nodes (S + 1, s)."""
        return self.scheme.basis[::2]

    def difference(self, points: Array, origins: Array) -> Array:
        """Of states (k, n) at points (k, .) from those at origins (k, .)."""
        return self.dynamics[0].difference(points, origins)[:, self.states]

    def inputs(self, coefficients: Array) -> Array:
        """At the nodes (N, S + 1, m)."""
        return np.asarray(np.einsum("kim,ji->kjm", coefficients, self.at_nodes))

    def departures(self, nodes: Array, u: Array, y: Array, *, middles: bool = False) -> tuple[Array, Array, Array]:
        """x - x_rest, u - u_rest and y - y_d at the ends of steps, or at their ends and middles (N, S + 1 or 2 S + 1, .)."""
        every = slice(None, None, 1 if middles else 2)
        states = self.dynamics[0].states(nodes.reshape(-1, nodes.shape[2])).reshape(*nodes.shape[:2], -1)
        away = self.dynamics[0].output_difference(y, self.wanted[:, every])
        return states - self.rest_states[:, every], u - self.rest_inputs[:, every], away

    def cost(self, course: Course) -> float:
        """Of a motion over all of time."""
        nodes, u = self.nodes(course.motion), self.inputs(course.motion.coefficients)
        if not np.all(np.isfinite(nodes)):
            return np.inf
        x, v, e = self.departures(nodes, u, self.outputs(nodes, u))
        rate = self.weights.rate(*(part.reshape(-1, part.shape[2]) for part in (x, v, e))).reshape(x.shape[:2])
        return float(self.mesh.lengths @ (rate @ self.shares)) + sum(self.end_costs(course))

    def end_costs(self, course: Course) -> tuple[float, float]:
        """Of what lies before and after the window."""
        before, after = self.ends
        last = after.coordinates(course.motion.points[-1])
        return float(course.v @ before.tail_weight @ course.v), float(last @ after.tail_weight @ last)

    def sizes(self, motion: Motion) -> Array:
        """Peaks of the states' deviations from the start (n,), those that hardly move by what comparable ones make of them."""
        peaks = np.max(np.abs(self.difference(motion.points, np.broadcast_to(motion.points[:1], motion.points.shape))), axis=0)
        size = comparable_size(peaks, self.unit_ratios)
        return np.where(size > 0, size, 1.0)

    def remember(self, motion: Motion, nodes: Array) -> None:
        """The nodes of a motion that was integrated already (N, S + 1, .)."""
        self._last[:] = [(self.mesh, motion, nodes)]

    def gaps(self, motion: Motion) -> Array:
        """By how much elements end beyond the starts of the next ones (N, n)."""
        return self.difference(self.nodes(motion)[:, -1], motion.points[1:])

    def linearized(self, motion: Motion, *, rough: bool = True) -> Linearized:
        """What small changes of starts and coefficients do at the nodes, by derivatives at a few of them."""
        nodes, u = self.nodes(motion), self.inputs(motion.coefficients)
        S, n, m, s = self.scheme.steps, len(self.states), u.shape[2], self.scheme.count
        knots = np.linspace(0, S, min(KNOTS, S + 1)).astype(np.intp)
        A, B, C, D = self.derivatives(nodes[:, knots], u[:, knots], rough=rough)
        spread = interpolation(knots / S, np.linspace(0.0, 1.0, 2 * S + 1))
        A, B = (np.einsum("jl,kl...->kj...", spread, each) for each in (A, B))
        C, D = (np.einsum("jl,kl...->kj...", spread[::2], each) for each in (C, D))
        V = sensitivities(A, B, self.scheme.basis, self.mesh.lengths)
        U = np.zeros((S + 1, m, n + s * m))
        U[:, :, n:] = np.einsum("ji,ab->jaib", self.at_nodes, np.eye(m)).reshape(S + 1, m, s * m)
        return Linearized(V, U, C @ V + D @ U)

    def quadratics(self, motion: Motion, linearized: Linearized) -> Quadratics:
        """Elements along a motion."""
        nodes, u = self.nodes(motion), self.inputs(motion.coefficients)
        x, v, e = self.departures(nodes, u, self.outputs(nodes, u))
        V, U, Y = linearized.states, linearized.inputs[None], linearized.outputs
        n, size = V.shape[2:]
        share = self.mesh.lengths[:, None] * self.shares
        H, g = np.zeros((len(nodes), size, size)), np.zeros((len(nodes), size))
        for rows, weight, away in ((Y, self.weights.Q_y, e), (U, self.weights.R, v), (V, self.weights.Q_x, x)):
            if np.any(weight):
                weighed = np.swapaxes(rows, -1, -2) @ weight
                H += np.einsum("kj,kjab->kab", share, weighed @ rows)
                g += np.einsum("kj,kja->ka", share, (weighed @ away[..., None])[..., 0])
        return Quadratics(H, g, V[:, -1, :, :n], V[:, -1, :, n:], self.gaps(motion))

    def derivatives(self, nodes: Array, inputs: Array, *, rough: bool) -> tuple[Array, Array, Array, Array]:
        """A, B, C and D (N, k, ., .) at nodes (N, k, .) with inputs (N, k, m), of the states."""
        count, states = nodes.shape[1], self.states

        def part(dynamics: Dynamics, chosen: Indices) -> Derivatives:
            return dynamics.derivatives(
                nodes[chosen].reshape(-1, nodes.shape[2]), inputs[chosen].reshape(-1, inputs.shape[2]), rough=rough
            )

        parts = self.by_interval(part)

        def whole(values: Sequence[Array]) -> Array:
            return self.joined([(chosen, a.reshape(-1, count, *a.shape[1:])) for (chosen, _), a in zip(parts, values, strict=True)])

        found = [each for _, each in parts]
        return (
            whole([each.A[:, states][:, :, states] for each in found]),
            whole([each.B[:, states] for each in found]),
            whole([each.C[:, :, states] for each in found]),
            whole([each.D for each in found]),
        )


def quadrature_shares(steps: int) -> Array:
    """Boole's rule on an even number of steps, Simpson's where they are no multiple of four (steps + 1,)."""
    shares = np.zeros(steps + 1)
    rule = np.array([7.0, 32.0, 12.0, 32.0, 7.0]) / 90 if steps % 4 == 0 else np.array([1.0, 4.0, 1.0]) / 6
    span = len(rule) - 1
    for first in range(0, steps, span):
        shares[first : first + span + 1] += rule * span / steps
    return shares
