"""Optima that can hardly be told in working precision, such as those of inputs so cheap that they all but invert the plant."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from invtrack.errors import InvtrackError, RedesignError
from invtrack.inversion.bounded_solution import bounded_solution
from invtrack.inversion.inverse_system import hyperbolic_splits, inverse_systems
from invtrack.inversion.smoothness import require_smooth
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.least_cost import LeastCost, Optimal
from invtrack.redesign.riccati import PrecisionError

SETTLED = 1e-7
"""An optimum whose cost is certified to within this share of it is handed out as it is."""

REMARKABLE = 1e-6
"""A larger such share is worth a remark."""

OPTIMAL = 1e-3
"""Largest share of its cost by which a plan may be too dear, for all that can be certified, and still be handed out."""

DEARER = 1e2
"""Steps in which inputs are made dearer for a bound from below."""

UNSOLVED = 3
"""So many steps at once where there is no optimum in working precision."""


@dataclass(frozen=True, eq=False)
class Certified:
    """[x; u; y] of the plants side by side, the share of its cost that it can be too dear by, and what a user should know."""

    trajectory: Trajectory
    gap: float
    remarks: tuple[str, ...] = ()


def certified_optimum(problem: LeastCost) -> Certified:
    """The optimum; where working precision is not enough for it, the best that is known, and how good that is for certain.

    With cheap inputs the output errors of the optimum lie below the rounding of the outputs. Exact inversion, where there is one,
    then costs at most a little more. How little follows from the optimum for dearer inputs, theta R, which can be told from it: no
    input costs less here than 1 / theta of what that one costs at its own weights.

    Raises RedesignError where what is known may cost more than the share OPTIMAL too much.
    """
    direct, refusal = _solved(problem)
    if direct is not None and direct.gap <= SETTLED:
        return Certified(direct.trajectory, direct.gap)
    candidates: list[tuple[float, Trajectory, tuple[str, ...]]] = []
    bound = 0.0
    exact = _exact_inverse(problem)
    if direct is not None and (exact is None or direct.gap <= OPTIMAL):
        candidates.append((problem.cost(direct.trajectory), direct.trajectory, ()))
        bound = candidates[0][0] * (1 - direct.gap)
    if exact is not None:
        candidates.append((problem.cost(exact, exact=True), exact, ("the plan is that of exact inversion",)))
    if not candidates:
        raise refusal
    cost, best, remarks = min(candidates, key=lambda candidate: candidate[0])
    for other in _bounds(problem, direct):
        if other <= bound:
            break
        bound = other
    gap = max(0.0, 1 - bound / cost) if cost > 0 else 0.0
    if not gap <= OPTIMAL and bound == 0.0 and direct is None:
        raise refusal
    if not gap <= OPTIMAL:
        raise RedesignError(
            f"the optimum cannot be told in working precision: the best input found may cost up to {gap:.1e} of its cost too much, "
            f"expected {OPTIMAL:g} or less; where inputs are so cheap that the output errors drown in rounding, raise R or take a "
            "smoother reference, so that invtrack.invert can follow it exactly; otherwise bring the units of the states closer to "
            "each other"
        )
    if gap > REMARKABLE or remarks:
        remarks = (f"rounding allows to certify no more than that the plan costs at most {gap:.1e} of its cost too much", *remarks)
    return Certified(best, gap, remarks)


def _solved(problem: LeastCost) -> tuple[Optimal | None, PrecisionError]:
    """The optimum, or why it cannot be found in working precision."""
    try:
        return problem.solve(), PrecisionError()
    except PrecisionError as reason:
        return None, reason


def _bounds(problem: LeastCost, direct: Optimal | None) -> Iterator[float]:
    """Bounds from below on the cost, from optima for dearer inputs, the cheapest first that can be told to within OPTIMAL."""
    times = UNSOLVED if direct is None else max(1, _steps_to_tell(direct.gap))
    largest = float(np.max(np.abs(problem.weights.R)))
    while times * math.log(DEARER) + math.log(largest) < -math.log(SETTLED):
        theta = DEARER**times
        dearer = replace(problem, weights=replace(problem.weights, R=theta * problem.weights.R))
        found, _ = _solved(dearer)
        if found is not None and found.gap <= OPTIMAL:
            yield dearer.cost(found.trajectory) * (1 - found.gap) / theta
            if found.gap <= SETTLED:  # the least cost divided by theta falls as theta grows: no other bound is higher
                return
        times += UNSOLVED if found is None else max(1, _steps_to_tell(found.gap))


def _steps_to_tell(gap: float) -> int:
    """How many steps dearer inputs must be for the gap, which falls at least as inputs become dearer, to come below OPTIMAL."""
    return math.ceil(math.log(gap / OPTIMAL, DEARER)) if gap > 0 else 0


def _exact_inverse(problem: LeastCost) -> Trajectory | None:
    """[x; u; y] that follow the reference exactly, of a single plant that allows it."""
    if len(problem.problems) > 1:
        return None
    task: PlanningProblem = problem.problems[0]
    try:
        with np.errstate(over="raise", invalid="raise"):
            splits = hyperbolic_splits(task.plant)
            require_smooth(task.plant, [split.internal for split in splits], task.deviation)
            return bounded_solution(task, inverse_systems(task.plant, splits)).trajectory
    except (InvtrackError, FloatingPointError, np.linalg.LinAlgError):
        return None
