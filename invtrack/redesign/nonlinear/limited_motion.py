"""The best motion within limits: sequential quadratic programming on the linearization along it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RedesignError
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.redesign.limited.optimality import Optimality, measured_optimality
from invtrack.redesign.limited.quadratic_program import Minimum, QuadraticProgram, explain
from invtrack.redesign.limited.transcription import LimitRows
from invtrack.redesign.limits import Bound
from invtrack.redesign.nonlinear.costed import CostedMotions, Course
from invtrack.redesign.nonlinear.gauss_newton import GaussNewtonStep
from invtrack.redesign.nonlinear.limited_program import LimitedStep
from invtrack.redesign.nonlinear.solver import LeastCostMotion, Optimum, require_few

STEPS = 200
"""Elements of the manoeuvre, at least, if no step is stated."""

MOST_STEPS = 40
"""Quadratic programmes on one mesh."""

SETTLED = 1e-9
"""A step that promises to take off less than this share of the cost, from a motion that misses no equation and no limit by more
than this share of its size, is the last one: the solver knows the programme's minimum no better."""

SMALL = 1e-4
"""A step that changes states and inputs by less than this share of their sizes is taken as a whole."""

SHORTEST = 2.0**-10
"""Shares of a step that are tried, at least."""

SUFFICIENT = 1e-4
"""Share of what the programme promises that a step must take off cost and violations together."""

PRICE = 1.5
"""Violations cost so many times their multipliers: more than they are worth."""


@dataclass(frozen=True, eq=False)
class LimitedOptimum:
    """The best motion within limits.

    Args:
        motions, course: the elements, and the motion.
        rows, multipliers: by which limits were imposed, and their multipliers in cost per unit of what each limits.
        optimality: how far from the best it can be, near by.
        log: of the steps that led to it, those of the motion without limits among them.
    """

    motions: CostedMotions
    course: Course
    rows: LimitRows
    multipliers: Array
    optimality: Optimality
    log: tuple[GaussNewtonStep, ...]


@dataclass(frozen=True, eq=False)
class LimitedMotion:
    """From the motion of least cost to that within limits.

    Args:
        solver: of the problem without limits.
        free: its motion.
        bounds: the limits, as deviations from the operating point.
        origin: inputs and outputs at the operating point.
        step: longest element [s], or None.
    """

    solver: LeastCostMotion
    free: Optimum
    bounds: Sequence[Bound]
    origin: tuple[Array, Array]
    step: float | None

    def solve(self, margins: tuple[float, float]) -> LimitedOptimum:
        """The motion on a window that reaches so far [s] before and after the manoeuvre. Raises RedesignError."""
        mesh = self._mesh(margins)
        scheme = Scheme(1 if self.solver.hold is not None else 2, (), self.free.motions.scheme.refinement)
        motions, course = self.solver.carried(self.free.motions, self.free.course, scheme, mesh)
        task = LimitedStep(motions, self.bounds, self.origin, self._input_unit(), self.free.motions.sizes(self.free.course.motion))
        log = list(self.free.log)
        program, rows = task.program(course)
        prices, cost = np.zeros(len(program.e) + len(program.h)), motions.cost(course)
        for _ in range(MOST_STEPS):
            minimum = self._minimum(program, rows)
            prices = np.maximum(prices, PRICE * np.abs(np.concatenate([minimum.of_equations, minimum.of_limits])))
            size = float(np.max(np.abs(minimum.z)))
            before = cost + prices @ _violations(program)
            promised = before - (cost + _change(program, minimum.z))
            share = 1.0
            while True:
                moved = task.moved(course, minimum.z, share)
                after = motions.cost(moved)
                if np.isfinite(after):
                    found = task.program(moved)
                    merit = after + prices @ _violations(found[0])
                    if merit <= before - SUFFICIENT * share * promised or size <= SMALL:
                        break
                share /= 2
                if share < SHORTEST:
                    raise self._not_found("no share of a step brings it nearer", len(log))
            settled = promised <= SETTLED * before and float(np.max(_violations(found[0]))) <= SETTLED
            course, (program, rows), cost = moved, found, after
            log.append(
                GaussNewtonStep(cost * self.solver.unit, float(promised / before), share, motions.number, len(mesh), scheme.count)
            )
            if settled:
                return self._certified(task, course, cost, log)
        raise self._not_found(f"a further one would still take {promised / before:.1e} off the cost", len(log))

    def _certified(self, task: LimitedStep, course: Course, cost: float, log: list[GaussNewtonStep]) -> LimitedOptimum:
        """The optimum, by the conditions of a programme about it that is made with central differences."""
        program, rows = task.program(course, rough=False)
        minimum = self._minimum(program, rows)
        optimality = measured_optimality(program, np.zeros(len(program.q)), minimum, cost)
        optimality.require()
        size = np.array([bound.size for bound in self.bounds])[rows.bound]
        return LimitedOptimum(task.motions, course, rows, minimum.of_limits / size, optimality, tuple(log))

    def _minimum(self, program: QuadraticProgram, rows: LimitRows) -> Minimum:
        found = program.solve()
        if found is None:
            raise RedesignError(
                "the limits cannot all be kept by a motion near the one that was found: to first order, "
                f"{explain(program, rows.bound, self.bounds)}"
            )
        return found

    def _mesh(self, margins: tuple[float, float]) -> Mesh:
        stops = self.solver.problem.stops
        duration = float(stops[-1] - stops[0])
        if self.solver.hold is not None:
            length = self.solver.hold
        else:
            length = self.step if self.step is not None else (duration if duration > 0 else sum(margins)) / STEPS
        before, after = (length * float(np.ceil(margin / length * (1 - 1e-9))) for margin in margins)
        edges = np.concatenate([[stops[0] - before], stops, [stops[-1] + after]])
        require_few(float(edges[-1] - edges[0]) / length, float(edges[-1] - edges[0]), length)
        return Mesh.even(edges, self.solver.problem.switch_times, length)

    def _input_unit(self) -> Array:
        motions = self.free.motions
        away = np.abs(motions.inputs(self.free.course.motion.coefficients) - motions.rest_inputs[:, ::2])
        peaks = np.max(away, axis=(0, 1))
        largest = float(np.max(peaks))
        return np.where(peaks > 1e-9 * largest, peaks, largest if largest > 0 else 1.0)

    def _not_found(self, why: str, steps: int) -> RedesignError:
        return RedesignError(
            f"no best motion within the limits found in {steps} steps of sequential quadratic programming: {why}; loosen the "
            "limits, or ask for a smaller or slower motion"
        )


def _violations(program: QuadraticProgram) -> Array:
    """By how much a course misses the equations and limits of the programme of its changes (equations + limits,)."""
    return np.concatenate([np.abs(program.e), np.maximum(-program.h, 0.0)])


def _change(program: QuadraticProgram, z: Array) -> float:
    return float(z @ (program.P @ z) / 2 + program.q @ z)
