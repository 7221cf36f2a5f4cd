"""Multiple shooting for a motion whose outputs are given: conditions on states at nodes and on inputs, and Newton's step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TypeVar

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.bend import Border
from invtrack.inversion.nonlinear.boundary_value import TwoPointProblem
from invtrack.inversion.nonlinear.elements import ElementMaps, Scheme, element_maps
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.plans.dynamics import Derivatives, Dynamics
from invtrack.plans.tail import SIDES

T = TypeVar("T")

FLOOR = 1e-6
"""A state counts as no smaller than this share of the largest, in balanced units."""


@dataclass(frozen=True, eq=False)
class Motion:
    """States at the nodes of a mesh (N + 1, .), coefficients of the inputs on its elements (N, s, m), and how outputs are bent.

    bend: weights of the bumps by which outputs depart from those wanted (J, p); none where they are followed exactly.
    """

    points: Array
    coefficients: Array
    bend: Array = field(default_factory=lambda: np.zeros((0, 0)))


@dataclass(frozen=True, eq=False)
class Change:
    """A step of Newton's method: of states, as tangents (N + 1, n), of coefficients (N, s m), and of the bend (J, p).

    gap: share of the bend's integral of squares by which a bend that does as much could be less, to first order.
    """

    states: Array
    coefficients: Array
    bend: Array
    gap: float = 0.0


class ElementChain:
    """Elements of a motion one after the other, each integrated from its own start.

    Args:
        dynamics: of each interval.
        mesh, scheme: elements, and polynomials and points on them.
        motion_size: of the outputs (p,), by which misses are measured.
        _last: the nodes of the motion that was asked for last, on which mesh.
    """

    dynamics: Sequence[Dynamics]
    mesh: Mesh
    scheme: Scheme
    motion_size: Array
    _last: list[tuple[Mesh, Motion, Array]]

    def nodes(self, motion: Motion) -> Array:
        """The states at the ends of the steps of all elements (N, S + 1, .)."""
        for mesh, known, nodes in self._last:
            if mesh is self.mesh and known is motion:
                return nodes
        steps = self.scheme.integration
        parts = self.by_interval(
            lambda dynamics, chosen: dynamics.motion(
                motion.points[:-1][chosen], motion.coefficients[chosen], steps, self.mesh.lengths[chosen]
            )
        )
        found = self.joined(parts)
        self._last[:] = [(self.mesh, motion, found)]
        return found

    def ends_of(self, motion: Motion, elements: Indices, scheme: Scheme) -> Array:
        """The states at the ends of some elements (k,), in the steps of another scheme (k, .)."""
        result = np.empty((len(elements), motion.points.shape[1]))
        for k in np.unique(self.mesh.interval[elements]):
            here = np.flatnonzero(self.mesh.interval[elements] == k)
            own = elements[here]
            starts, lengths = motion.points[own], self.mesh.lengths[own]
            result[here] = self.dynamics[k].motion(starts, motion.coefficients[own], scheme.integration, lengths)[:, -1]
        return result

    def outputs(self, nodes: Array, inputs: Array) -> Array:
        """Outputs (N, k, p) at nodes (N, k, .) with inputs (N, k, m)."""
        count = nodes.shape[1]

        def part(dynamics: Dynamics, chosen: Indices) -> Array:
            y = dynamics.evaluate(_flat(nodes[chosen]), _flat(inputs[chosen]))[1]
            return y.reshape(-1, count, y.shape[1])

        return self.joined(self.by_interval(part))

    def by_interval(self, work: Callable[[Dynamics, Indices], T]) -> list[tuple[Indices, T]]:
        """[(elements, work(dynamics, elements))] for each interval that has elements."""
        found = []
        for k in np.unique(self.mesh.interval):
            chosen = np.flatnonzero(self.mesh.interval == k)
            found.append((chosen, work(self.dynamics[k], chosen)))
        return found

    def joined(self, parts: Sequence[tuple[Indices, Array]]) -> Array:
        """Values of all elements (N, ...) from those of each interval."""
        result = np.empty((len(self.mesh), *parts[0][1].shape[1:]))
        for chosen, values in parts:
            result[chosen] = values
        return result


@dataclass(frozen=True, eq=False)
class Shooting(ElementChain):
    """What a motion has to meet: x_(k+1) = Phi(x_k, c_k), outputs at their points, and the ends.

    With a border outputs may be bent, as little as puts what it names to rest at both ends.

    Args:
        dynamics: of each interval.
        mesh, scheme: elements, and polynomials and points on them.
        wanted: outputs at the matched points (N, p, s).
        motion_size: of the outputs (p,), by which misses are measured.
        ends: where the motion starts and ends.
        number: of the mesh, among those that were tried, for the log.
        border: what bends the outputs, and what for; None where they are followed exactly.
        _last: the nodes of the motion that was asked for last, on which mesh.
    """

    dynamics: Sequence[Dynamics]
    mesh: Mesh
    scheme: Scheme
    wanted: Array
    motion_size: Array
    ends: tuple[End, End]
    number: int = 1
    border: Border | None = None
    _last: list[tuple[Mesh, Motion, Array]] = field(default_factory=list, repr=False)

    def maps(self, motion: Motion, nodes: Array) -> ElementMaps:
        """Derivatives of all elements along the motion."""
        knots, scheme = self.scheme.knots, self.scheme
        inputs = np.einsum("kim,ji->kjm", motion.coefficients, scheme.basis[2 * knots])

        def part(dynamics: Dynamics, chosen: Indices) -> ElementMaps:
            found: Derivatives = dynamics.derivatives(_flat(nodes[chosen][:, knots]), _flat(inputs[chosen]), rough=True)
            return element_maps(found, scheme, self.mesh.lengths[chosen])

        parts = self.by_interval(part)
        names = [field.name for field in fields(ElementMaps)]
        return ElementMaps(*(self.joined([(chosen, getattr(maps, name)) for chosen, maps in parts]) for name in names))

    def misses(self, motion: Motion, nodes: Array) -> tuple[Array, Array]:
        """Gaps Phi(x_k, c_k) - x_(k+1) (N, n), and outputs less those wanted (N, p, s) at the matched points."""
        gaps = self.dynamics[0].difference(nodes[:, -1], motion.points[1:])
        points = np.unique(self.scheme.points)
        inputs = np.einsum("kim,ji->kjm", motion.coefficients, self.scheme.basis[2 * points])
        y = self.outputs(nodes[:, points], inputs)
        place = np.searchsorted(points, self.scheme.points)
        reached = np.stack([y[:, place[i], i] for i in range(len(place))], axis=1)
        wanted = self.wanted if self.border is None else self.wanted + self._bent(self.border, motion.bend)
        away = self.dynamics[0].output_difference(reached.transpose(0, 2, 1), wanted.transpose(0, 2, 1))
        return gaps, away.transpose(0, 2, 1)

    def departures(self, motion: Motion) -> Array:
        """Of the states from rest at the start (N + 1, n)."""
        origin = np.broadcast_to(self.ends[0].rest.point, motion.points.shape)
        return self.dynamics[0].difference(motion.points, origin)

    def sizes(self, motion: Motion) -> Array:
        """Peaks of the states (n,), those that hardly move by others' in balanced units."""
        peaks = np.max(np.abs(self.departures(motion)), axis=0)
        scale = self.ends[0].scale
        largest = float(np.max(peaks / scale))
        return np.asarray(np.maximum(peaks, FLOOR * largest * scale) if largest > 0 else scale)

    def ends_away(self, motion: Motion) -> tuple[Array, Array]:
        """The first and the last state less rest there (n,)."""
        first, last = (
            self.dynamics[0].difference(motion.points[[number]], end.rest.point[None])[0]
            for number, end in zip((0, -1), self.ends, strict=True)
        )
        return first, last

    def end_conditions(self, motion: Motion) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
        """Of both ends the rows for a change of the state, and by how much it misses what they ask for; see `End.conditions`."""
        (first, last), (start, end) = self.ends_away(motion), self.ends
        return start.conditions("before", first), end.conditions("after", last)

    def ends_missed(self, motion: Motion) -> float:
        """By how much the ends miss what is asked of them, as a share of the largest peak in balanced units."""
        scale = self.ends[0].scale
        worst = max(float(np.max(np.abs(missed), initial=0.0)) for _, missed in self.end_conditions(motion))
        return worst / float(np.max(self.sizes(motion) / scale))

    def on_tails(self, motion: Motion) -> Motion:
        """The same but for its first and last state, of which only what lies in the tails is kept."""
        points = motion.points.copy()
        for number, end, side, away in zip((0, -1), self.ends, SIDES, self.ends_away(motion), strict=True):
            points[number] = self.dynamics[0].retract(end.rest.point[None], end.departure(side).part(away)[None])[0]
        return replace(motion, points=points)

    def step(self, motion: Motion, nodes: Array, gaps: Array, away: Array) -> Change:
        """Newton's step. Raises LinAlgError where there is none."""
        maps = self.maps(motion, nodes)
        back, gain = maps.inverse
        (first, last), ((L, left), (R, right)) = self.ends_away(motion), self.end_conditions(motion)
        problem = TwoPointProblem.of(maps.exact, L, R, self.ends[0].scale)

        def solved(away: Array) -> tuple[Array, Array]:
            wanting = np.einsum("kij,kj->ki", gain, away.reshape(len(away), -1))
            b = gaps - np.einsum("kij,kj->ki", maps.end_c, wanting)
            states = problem.solve(b, -left, -right)
            return states, -wanting - np.einsum("kij,kj->ki", back, states[:-1])

        states, coefficients = solved(away)
        if self.border is None:
            return Change(states, coefficients, motion.bend)
        moved = np.concatenate([self.border.start @ (first + states[0]), self.border.end @ (last + states[-1])])
        influence = problem.influence(self.border.start, self.border.end)
        pull = np.einsum("rkn,knj,kji->rki", influence, maps.end_c, gain).reshape(len(influence), *away.shape)
        bend, gap = self.border.step(self.mesh, self.scheme, pull, motion.bend, moved)
        return Change(*solved(away - self._bent(self.border, bend)), bend, gap)

    def _bent(self, border: Border, bend: Array) -> Array:
        """By how much a bend (J, p) changes the outputs at the matched points (N, p, s)."""
        return border.bumps.bent(self.mesh, self.scheme, bend)

    def moved(self, motion: Motion, change: Change) -> Motion:
        """The motion after a step."""
        points = self.dynamics[0].retract(motion.points, change.states)
        coefficients = motion.coefficients + change.coefficients.reshape(motion.coefficients.shape)
        return Motion(points, coefficients, motion.bend + change.bend)


def _flat(values: Array) -> Array:
    return values.reshape(-1, values.shape[-1])


def at_rest(shooting: Shooting) -> Motion:
    """The motion that stays where it starts."""
    rest, border = shooting.ends[0].rest, shooting.border
    coefficients = np.zeros((len(shooting.mesh), shooting.scheme.count, len(rest.inputs)))
    coefficients[:, 0] = rest.inputs
    bend = np.zeros((0, 0)) if border is None else np.zeros((border.bumps.count, len(border.bumps.scale)))
    return Motion(np.repeat(rest.point[None], len(shooting.mesh) + 1, axis=0), coefficients, bend)
