"""The trajectory of least cost: of one plant, or of several that share one input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import RedesignError, TrajectoryError
from invtrack.plans.problem import AT_REST, PlanningProblem
from invtrack.plans.quadrature import reach
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import Driveable, two_sided_problem
from invtrack.redesign.cost import FARTHEST, FREE_HOLDING, HELD, ROUNDING, Weights, graded_edges, quadrature, without_rounding
from invtrack.redesign.optimality import Conditions
from invtrack.redesign.optimum import TrackedSystem, optimum
from invtrack.redesign.riccati import ADVICE, PrecisionError
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal

COUNTED = 1e-10
"""Share of a cost to which it is worked out where plans are compared: with cheap inputs more is rounding."""


@dataclass(frozen=True, eq=False)
class Optimal:
    """Values [x; u; y; costate] over all of time, models side by side, and the largest share of their cost that is too much."""

    trajectory: Trajectory
    gap: float


@dataclass(frozen=True, eq=False)
class LeastCost:
    """One input for one or several plants, x' = A x + B u and y = C x + D u each, at the least cost.

    Args:
        problems: of each plant (k,), with the same reference and breakpoints, held still before and after.
        weights: of the input (p, p), and of all plants' states and outputs side by side (k n, k n) and (k p, k p).
    """

    problems: Sequence[PlanningProblem]
    weights: Weights

    @classmethod
    def of(cls, problems: Sequence[PlanningProblem], weights: Weights, shares: Array) -> LeastCost:
        """Plants whose states and outputs weigh as `weights` says, each by its share (k,)."""
        weights.require_within(HELD)
        Q_x, Q_y = (scipy.linalg.block_diag(*(share * Q for share in shares)) for Q in (weights.Q_x, weights.Q_y))
        return cls([held_still(problem) for problem in problems], Weights(weights.R, Q_x, Q_y).in_unit())

    @property
    def n_states(self) -> int:
        """Number of states of all plants."""
        return sum(problem.plant.n_states for problem in self.problems)

    def solve(self) -> Optimal:
        """The optimum, with what it can be too dear by.

        Raises RedesignError where it does not exist, or its equations are too far out of working precision.
        """
        self.weights.require_within(FARTHEST, error=PrecisionError)
        first, m = self.problems[0], self.problems[0].plant.n_inputs
        systems = self._systems()
        shifts = np.hstack([problem.plant.shifts for problem in self.problems])
        if np.any(self.weights.Q_y) or np.any(shifts):
            distinct = {id(system): system for system in systems}
            optima = {key: optimum(system, self.weights) for key, system in distinct.items()}
            models: Sequence[Driveable] = [optima[id(system)] for system in systems]
            fastest = max(each.system.propagators[0].pace for each in optima.values())
            latest = float(np.max(np.abs(first.deviation.breakpoints)))
            if fastest * latest * np.finfo(float).eps > 1:
                raise PrecisionError(
                    f"the optimum changes within {1 / fastest:.1e} s, less than rounding leaves of a time of {latest:.3g} "
                    f"s; {ADVICE}"
                )
        else:  # where nothing is asked of the output, not to move (the Riccati equation may have no stabilizing solution)
            models = [_Rest(2 * self.n_states + m + len(self.weights.Q_y))] * len(systems)
        moved = shifts if np.any(shifts) else None
        trajectory = two_sided_problem(first, models, shifts=moved, one_unit=False).solve().trajectory()
        self._require_free_holding(trajectory)
        gap = Conditions(systems, first.owner, self.weights, first.deviation, self._allowed(shifts)).gap(trajectory)
        return Optimal(trajectory, gap.total)

    def split(self, values: Array) -> tuple[Array, Array, Array]:
        """x, u and y of values [x; u; y; ...] (k, r), all plants' side by side."""
        x, u, y, _ = np.split(values, np.cumsum([self.n_states, len(self.weights.R), len(self.weights.Q_y)]), axis=1)
        return x, u, y

    def cost(self, trajectory: Trajectory, *, exact: bool = False) -> float:
        """The integral over all of time; `exact` where the outputs' errors are rounding only, and cost nothing."""
        problem = self.problems[0]

        def rate(times: Array, inside: Array) -> Array:
            x, u, y = self.split(trajectory(times, trajectory.locate(inside)))
            wanted = np.tile(problem.deviation(times, inside=inside), (1, len(self.problems)))
            return self.weights.rate(x, u, np.zeros_like(y) if exact else y - wanted)

        return quadrature(rate, graded_edges(trajectory.breakpoints, reach(trajectory.before), reach(trajectory.after)), COUNTED)

    def of_plant(self, k: int, trajectory: Trajectory) -> Trajectory:
        """[x; u; y] of one plant."""
        plant, N = self.problems[k].plant, self.n_states
        n, m, p = plant.n_states, plant.n_inputs, plant.n_outputs
        rows = np.concatenate([np.arange(k * n, (k + 1) * n), N + np.arange(m), N + m + np.arange(k * p, (k + 1) * p)])
        return trajectory.mapped(np.eye(trajectory.rows)[rows])

    def _systems(self) -> list[TrackedSystem]:
        """All plants side by side, of each interval; those that recur are the same object."""
        found: dict[tuple[int, ...], TrackedSystem] = {}
        together = list(zip(*(problem.plant.systems for problem in self.problems), strict=True))
        for models in together:
            key = tuple(map(id, models))
            if key not in found:
                found[key] = TrackedSystem.of(models)
        return [found[tuple(map(id, models))] for models in together]

    def _allowed(self, shifts: Array) -> Array:
        """By how much the states may jump at each breakpoint (m + 1, k n), of what they do at each switch."""
        problem = self.problems[0]
        edges = problem.deviation.breakpoints
        allowed = np.zeros((len(edges), self.n_states))
        allowed[np.searchsorted(edges, problem.plant.switch_times)] = shifts
        return allowed

    def _require_free_holding(self, trajectory: Trajectory) -> None:
        """Raises RedesignError where the plan goes on costing something at rest before or after the manoeuvre."""
        problem, weights = self.problems[0], self.weights
        edges = problem.deviation.breakpoints
        for tail, t, when in ((trajectory.before, edges[0] - 1.0, "before"), (trajectory.after, edges[-1] + 1.0, "after")):
            held = problem.deviation(t)
            wanted = np.tile(held, len(self.problems))
            staying_away = float(np.abs(wanted) @ np.abs(weights.Q_y) @ np.abs(wanted))
            x, u, y = self.split(tail.held[np.newaxis])
            rate = float(weights.rate(x, u, y - wanted)[0])
            rounding = ROUNDING * float(weights.terms(x, u, y - wanted)[0])
            if rate > FREE_HOLDING * staying_away + rounding:
                raise RedesignError(
                    f"the cost is infinite: {when} the manoeuvre the outputs {list(problem.plant.outputs.names)} are to be held at "
                    f"{held.tolist()} (from the operating point) for ever, which costs {rate:.3g} per second even at the best "
                    "compromise; let the reference return to the operating point, take the held value itself as the operating "
                    "point, or give no weight to the states or inputs that holding it takes (a rigid-body motion needs none)"
                )


class _Rest:
    """A two-sided system without states in which a reference moves nothing."""

    def __init__(self, rows: int) -> None:
        none = Part.empty(rows, 0)
        self._rows, self.system = rows, TwoSidedSystem(none, none, np.zeros((0, 0)))

    def driven(self, generator: Generator) -> DrivenSystem:
        """Zero, whatever the reference."""
        nothing = np.zeros((0, len(generator.S)))
        return DrivenSystem(self.system, generator.S, nothing, nothing, np.zeros((self._rows, len(generator.S))), nothing)


def held_still(problem: PlanningProblem) -> PlanningProblem:
    """The problem with a reference that is constant before and after the manoeuvre, with one state that stays at 1.

    Nothing then depends on the unit of the outputs, and held values that only rounding sets apart from the operating point are not
    held for ever. Raises TrajectoryError for a reference that goes on moving there.
    """
    reference = problem.deviation
    kind, anchors, end_anchors = reference.kind.copy(), reference.anchors.copy(), problem.end_anchors.copy()
    generators = list(reference.generators)
    for place, when in ((0, "before"), (-1, "after")):
        generator = generators[kind[place]]
        w = anchors[place, : len(generator.S)]
        if np.any(np.abs(generator.S @ w) > AT_REST * np.abs(generator.S) @ np.abs(w)):
            raise TrajectoryError(
                f"the reference goes on moving {when} its first and last breakpoint ({reference.manoeuvre}), for ever, so the cost "
                "over all of time is infinite; hold it still there, for instance with "
                "invtrack.references.autonomous(..., start=, end=)"
            )
        held = without_rounding(generator.R @ w, reference, problem.plant.rest_outputs[place])
        kind[place] = len(generators)
        generators.append(Generator(np.zeros((1, 1)), held[:, np.newaxis]))
        for states in (anchors, end_anchors):
            states[place] = np.eye(1, anchors.shape[1])[0]
    held_still = PiecewiseSignal(reference.breakpoints, tuple(generators), kind, anchors)
    return replace(problem, deviation=held_still, end_anchors=end_anchors)
