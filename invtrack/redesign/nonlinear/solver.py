"""From a problem to its motion of least cost: mesh, Gauss-Newton's method, refinement."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RedesignError
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.refinement import defects_of, parts_for, steps_for
from invtrack.inversion.nonlinear.shooting import Motion
from invtrack.inversion.nonlinear.transfer import Known
from invtrack.linear.state_sizes import unit_ratios
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.runge_kutta import legendre
from invtrack.redesign.cost import Weights
from invtrack.redesign.nonlinear.costed import CostedMotions, Course
from invtrack.redesign.nonlinear.ends import RestEnd, ends_of
from invtrack.redesign.nonlinear.gauss_newton import GaussNewtonStep, converged
from invtrack.redesign.nonlinear.moving_rest import MovingRest
from invtrack.redesign.nonlinear.optimality import Stationarity, stationarity

COUNT = 4
"""Coefficients of each input on an element."""

REFINEMENT = 2
"""Steps of integration per half of a coefficient's share of an element: with fewer the errors of the integration outweigh what
polynomials of the third degree, whose first moments vanish, do to a chain of integrators."""

ELEMENTS = 50
"""Elements of the manoeuvre, at least, before refinement."""

FASTEST = 1.0
"""Half of a coefficient's share of an element times the fastest mode [rad], at most: what a plan's polynomials can follow."""

RESOLVED = 2.0
"""Length of the elements beside the manoeuvre times the fastest mode of the optimum there [rad], at most."""

GROWTH = 1.4
"""Each element outside the manoeuvre is longer than its inner neighbour by this factor, at most."""

FIRST_SHARE = 3e-2
"""The mesh ends at first where so much of the slowest mode is left, or as far out as the manoeuvre is long."""

STATIONARY = 1e-10
"""Share of its cost that other inputs could take off a plan, at most: its inputs are then right to about the root of that."""

HELD_REFINEMENT = 8
"""Steps of integration per half of a hold, at most, that are taken for this reason."""

HELD_STATIONARY = 1e-8
"""The same for inputs that are held, where only shorter steps of integration make them better."""

WIDESPREAD = 0.25
"""Where the integration is too coarse on fewer elements than this share, these are split; else all take shorter steps."""

DEFECT_ORDER = 5
"""Power of an element's length with which its integration's error falls."""

STATIONARITY_ORDER = 2 * COUNT + 1
"""The same for what other inputs on it could take off the cost."""

MESHES = 12
"""Meshes that are tried, at most."""

MOST_ELEMENTS = 20_000
"""Elements that are planned, at most."""

MARGIN = 0.1
"""Share of the accuracy that tails are to reach when the mesh is made longer for them."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """The motion of least cost, what is left of its stationarity, and the steps that led to it."""

    motions: CostedMotions
    course: Course
    cost: float
    stationarity: Stationarity
    log: tuple[GaussNewtonStep, ...]


@dataclass(frozen=True, eq=False)
class LeastCostMotion:
    """From a problem to its motion of least cost.

    Args:
        problem: mechanism, reference, changes.
        weights: of the cost, in a unit in which they are about one.
        unit: of that cost.
        accuracy: largest error of the integration and of the tails, as a share of the states' sizes.
        hold: period of a zero-order hold [s], or None.
    """

    problem: MotionProblem
    weights: Weights
    unit: float
    accuracy: float
    hold: float | None

    @cached_property
    def rest(self) -> MovingRest:
        """What departures cost from."""
        return MovingRest.of(self.problem)

    @cached_property
    def ends(self) -> tuple[RestEnd, RestEnd]:
        """Before and after the window."""
        problem, models = self.problem, self.problem.linear_models
        return ends_of(
            (problem.dynamics[0], problem.dynamics[-1]),
            (problem.rests[0], problem.rests[-1]),
            (models[0], models[-1]),
            self.weights,
        )

    def solve(self) -> Optimum:
        """The motion. Raises RedesignError."""
        scheme = Scheme(COUNT if self.hold is None else 1, (), REFINEMENT)
        motions = self.motions_on(scheme, self._first_mesh(), 1)
        course = self._at_rest(motions)
        log: tuple[GaussNewtonStep, ...] = ()
        while True:
            course, step, log = converged(motions, course, log, self.unit)
            cost = motions.cost(course)
            left = stationarity(motions, course, step, cost)
            finer = self._finer(motions, course, left)
            if finer is None:
                left.require()
                return Optimum(motions, course, cost, left, log)
            if motions.number >= MESHES:
                raise RedesignError(
                    f"the mesh does not get fine enough: with {len(motions.mesh)} elements other inputs could still take "
                    f"{left.total:.1e} off the cost ({STATIONARY:.0e} is aimed at); ask for less accuracy, or make inputs dearer"
                )
            motions, course = self.carried(motions, course, *finer)

    def _first_mesh(self) -> Mesh:
        stops = self.problem.stops
        duration = float(stops[-1] - stops[0])
        lengths = [duration / ELEMENTS if duration > 0 else np.inf, self._longest, RESOLVED / max(end.fastest for end in self.ends)]
        length = float(min(lengths)) if self.hold is None else self.hold
        reach = [min(-np.log(FIRST_SHARE) / end.slowest, duration if duration > 0 else np.inf) for end in self.ends]
        before, after = (self._outward(length, each, end) for each, end in zip(reach, self.ends, strict=True))
        require_few(duration / length + len(before) + len(after), duration + sum(reach), length)
        inner = Mesh.even(stops, self.problem.switch_times, length).edges if duration > 0 else stops
        edges = np.concatenate([inner[0] - np.cumsum(before)[::-1], inner, inner[-1] + np.cumsum(after)])
        return Mesh.of(edges, self.problem.switch_times)

    def _outward(self, inner: float, reach: float, end: RestEnd) -> Array:
        """Lengths [s] of elements that reach so far, each longer than its inner neighbour where inputs are not held."""
        if self.hold is not None:
            return np.full(max(1, int(np.ceil(reach / inner * (1 - 1e-9)))), inner)
        found: list[float] = []
        total = 0.0
        while total < reach or not found:
            inner = max(inner, min(GROWTH * inner, self._longest, 1 / end.slowest))
            found.append(inner)
            total += inner
        return np.array(found)

    @property
    def _longest(self) -> float:
        """Length of elements [s] over which the integration follows the fastest mode, of the plant and of the optimum."""
        of_plant = [float(np.max(np.abs(np.linalg.eigvals(model.A)), initial=0.0)) for model in self.problem.linear_models]
        fastest = max(*of_plant, *(end.fastest for end in self.ends))
        return FASTEST * 2 * COUNT / fastest if fastest > 0 else np.inf

    def motions_on(self, scheme: Scheme, mesh: Mesh, number: int) -> CostedMotions:
        """Motions on other elements."""
        problem = self.problem
        shares = np.linspace(0.0, 1.0, 2 * scheme.steps + 1)
        times = (mesh.edges[:-1, None] + mesh.lengths[:, None] * shares).ravel()
        inside = np.repeat((mesh.edges[:-1] + mesh.edges[1:]) / 2, len(shares))

        def by_element(values: Array) -> Array:
            return values.reshape(len(mesh), len(shares), -1)

        model = SwitchedSystem([problem.linear_models[0]], [])
        return CostedMotions(
            dynamics=problem.dynamics,
            mesh=mesh,
            scheme=scheme,
            motion_size=self._motion_size,
            weights=self.weights,
            wanted=by_element(problem.reference(times, inside=inside)),
            rest_inputs=by_element(self.rest.inputs(times, inside)),
            rest_states=by_element(self.rest.states(times, inside)),
            unit_ratios=unit_ratios(model),
            ends=self.ends,
            number=number,
        )

    @cached_property
    def _motion_size(self) -> Array:
        size = self.problem.motion_size
        largest = float(np.max(size, initial=0.0))
        return np.where(size > 0, size, largest if largest > 0 else 1.0)

    def _at_rest(self, motions: CostedMotions) -> Course:
        """The postures at rest along the reference, which are no motion."""
        mesh, scheme = motions.mesh, motions.scheme
        origin, dynamics = self.problem.mechanism.operating_point[0], motions.dynamics[0]
        tangents = np.zeros((len(mesh) + 1, dynamics.size))
        tangents[:, dynamics.state_coordinates] = self.rest.states(mesh.edges, mesh.edges)
        points = dynamics.retract(np.repeat(origin[None], len(tangents), axis=0), tangents)
        nodes = (np.polynomial.legendre.leggauss(scheme.count)[0] + 1) / 2
        times = (mesh.edges[:-1, None] + mesh.lengths[:, None] * nodes).ravel()
        u = self.rest.inputs(times, times).reshape(len(mesh), scheme.count, -1)
        coefficients = np.asarray(np.linalg.solve(legendre(scheme.count, nodes), u))
        return Course(Motion(points, coefficients), np.zeros(len(motions.states)))

    def _finer(self, motions: CostedMotions, course: Course, left: Stationarity) -> tuple[Scheme, Mesh] | None:
        """Scheme and mesh that the plan needs, None where those it has will do."""
        scheme, mesh, sizes = motions.scheme, motions.mesh, motions.sizes(course.motion)
        defect = defects_of(motions, course.motion, self.problem.stops, sizes)
        longer, parts, factor = self._longer(motions, course, sizes), np.ones(len(mesh), dtype=np.intp), 1
        if self.hold is None and np.mean(defect > self.accuracy) < WIDESPREAD:
            parts = parts_for(defect, self.accuracy, DEFECT_ORDER)
        else:
            factor = steps_for(defect, self.accuracy, scheme.method.order)
        if self.hold is not None and scheme.refinement < HELD_REFINEMENT and not left.inputs <= HELD_STATIONARY:
            factor = max(factor, 2)
        if self.hold is None and not left.inputs <= STATIONARY:
            parts = np.maximum(
                parts, parts_for(np.nan_to_num(left.elements, nan=np.inf) * len(mesh), STATIONARY, STATIONARITY_ORDER)
            )
        if factor == 1 and longer is None and np.all(parts == 1):
            return None
        finer = mesh.split(parts)
        if longer is not None:
            finer = finer.with_more(*longer)
        require_few(len(finer), float(finer.edges[-1] - finer.edges[0]), float(np.min(finer.lengths)))
        return replace(scheme, refinement=factor * scheme.refinement), finer

    def _longer(self, motions: CostedMotions, course: Course, sizes: Array) -> tuple[Array, Array] | None:
        """Lengths of further elements before and after the window; None where its tails are as good as they must be."""
        motion, lengths = course.motion, motions.mesh.lengths
        more = []
        for end, point, v, inner in (
            (self.ends[0], motion.points[0], course.v, lengths[0]),
            (self.ends[1], motion.points[-1], self.ends[1].coordinates(motion.points[-1]), lengths[-1]),
        ):
            error = end.tail_error(v, point, sizes)
            reach = np.log(error / (MARGIN * self.accuracy)) / (2 * end.slowest) if error > self.accuracy else 0.0
            more.append(self._outward(inner, reach, end) if reach > 0 else np.zeros(0))
        return (more[0], more[1]) if len(more[0]) + len(more[1]) else None

    def carried(self, motions: CostedMotions, course: Course, scheme: Scheme, mesh: Mesh) -> tuple[CostedMotions, Course]:
        """Other elements, and what is known of the motion on them."""
        finer = self.motions_on(scheme, mesh, motions.number + 1)
        last = self.ends[1].coordinates(course.motion.points[-1])
        outside = (
            self.ends[0].outside(course.v, course.motion.points[0]),
            self.ends[1].outside(last, course.motion.points[-1]),
        )
        motion = Known(motions, course.motion, outside).on(mesh, scheme.count)
        further = float(motions.mesh.edges[0] - mesh.edges[0])
        v = outside[0].tail.departure.outputs(
            np.eye(len(course.v)), course.v[None], np.zeros(1, dtype=np.intp), np.array([further])
        )
        return finer, Course(motion, v[0])


def require_few(elements: float, duration: float, length: float) -> None:
    """Raises RedesignError for more elements than are planned."""
    if elements > MOST_ELEMENTS:
        raise RedesignError(
            f"the plan takes {duration:.4g} s in elements of {length:.3g} s, {elements:.0f} in number, of which {MOST_ELEMENTS} "
            "are planned at most; take a longer hold, a shorter motion, or dearer inputs, which need not change as fast"
        )
