"""Optimal output-trajectory redesign: a deliberate trade between following the reference and what that costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.errors import RedesignError, TrajectoryError
from invtrack.plans.plan import Plan
from invtrack.plans.problem import AT_REST, PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import Driveable, two_sided_problem
from invtrack.redesign.cost import FREE_HOLDING, ROUNDING, Weights, as_weights, without_rounding
from invtrack.redesign.optimum import TrackedSystem, optimum
from invtrack.references.signal import Generator, PiecewiseSignal


def quadratic_redesign(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
) -> Plan:
    """The trajectory of `model` that minimises what it costs to move and to miss the reference, over all of time.

    integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d), x' = A_k x + B_k (u - u0), x continuous through the jumps.
    u = -K x - R^-1 B's with K from the Riccati equation and s' = -(A - B K)'s + C'Q_y y_d from the future, so the input acts before
    the manoeuvre. The plan's y is the redesigned output; `reference` stays the wanted one, and the certificate's output error is
    what lies between the two by design. Nothing is asked of the reference's smoothness.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D.
        reference: absolute, in the units of the outputs, held still before and after the manoeuvre.
        R: weight of the inputs (p, p), positive definite, in 1 / (units squared) like all weights; a number stands for that
            multiple of the identity, here and below.
        Q_x: weight of the states (n, n), positive semidefinite.
        Q_y: weight of the output errors (p, p), positive semidefinite. Where it is zero the optimum is not to move.
        tolerance: share of each peak that counts as rest, as in `invert`.
        max_preactuation: longest preactuation [s], as in `invert`; None: as long as the tolerance asks.

    Raises TrajectoryError (wrong number of channels, a reference that does not hold still before and after), RedesignError
    (options or weights out of range; holding an end value would cost input for ever, so that the cost is infinite; a mode that
    the cost does not see or the input does not reach). Source: S. Devasia, "Optimal output-trajectory redesign for invertible
    systems", AIAA J. of Guidance, Control, and Dynamics 19(5), 1996 (frequency domain; here the same optimum in time).
    """
    free = free_optimum(model, reference, R=R, Q_x=Q_x, Q_y=Q_y, tolerance=tolerance, max_preactuation=max_preactuation)
    return free.problem.plan("quadratic redesign", free.trajectory, exact=False)


@dataclass(frozen=True, eq=False)
class FreeOptimum:
    """The optimum without limits, its weights, and the problem, whose reference is constant before and after the manoeuvre."""

    problem: PlanningProblem
    weights: Weights
    trajectory: Trajectory


def free_optimum(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike,
    Q_y: ArrayLike,
    tolerance: float,
    max_preactuation: float | None,
) -> FreeOptimum:
    """What `quadratic_redesign` makes a plan of; it raises the same errors.

    Args:
        model, reference, R, Q_x, Q_y, tolerance, max_preactuation: see `quadratic_redesign`.
    """
    problem = _held_still(PlanningProblem.of(model, reference, tolerance=tolerance, max_preactuation=max_preactuation))
    weights = as_weights(problem.plant, R=R, Q_x=Q_x, Q_y=Q_y).in_unit()  # the optimum does not depend on what cost is counted in
    if np.any(weights.Q_y):
        models: Sequence[Driveable] = problem.plant.map(lambda system: optimum(TrackedSystem.of([system]), weights))
    else:  # where nothing is asked of the output, not to move (the Riccati equation may have no stabilizing solution)
        models = [_Rest(2 * problem.plant.n_states + 2 * problem.plant.n_channels)] * len(problem.plant)
    whole = two_sided_problem(problem, models, one_unit=False).solve().trajectory()
    trajectory = whole.mapped(np.eye(problem.plant.n_states + 2 * problem.plant.n_channels, whole.rows))
    _require_free_holding(problem, trajectory, weights)
    return FreeOptimum(problem, weights, trajectory)


class _Rest:
    """A two-sided system without states in which a reference moves nothing."""

    def __init__(self, rows: int) -> None:
        none = Part.empty(rows, 0)
        self._rows, self.system = rows, TwoSidedSystem(none, none, np.zeros((0, 0)))

    def driven(self, generator: Generator) -> DrivenSystem:
        """Zero, whatever the reference."""
        nothing = np.zeros((0, len(generator.S)))
        return DrivenSystem(self.system, generator.S, nothing, nothing, np.zeros((self._rows, len(generator.S))), nothing)


def _held_still(problem: PlanningProblem) -> PlanningProblem:
    """The problem with a reference that is constant before and after the manoeuvre, with one state that stays at 1.

    Nothing then depends on the unit of the outputs, and held values that only rounding sets apart from the operating point are not
    held for ever. Raises TrajectoryError for a reference that goes on moving there.
    """
    reference, y_0 = problem.deviation, problem.plant.operating_point.y0
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
        held = without_rounding(generator.R @ w, reference, y_0)
        kind[place] = len(generators)
        generators.append(Generator(np.zeros((1, 1)), held[:, np.newaxis]))
        for states in (anchors, end_anchors):
            states[place] = np.eye(1, anchors.shape[1])[0]
    held_still = PiecewiseSignal(reference.breakpoints, tuple(generators), kind, anchors)
    return replace(problem, deviation=held_still, end_anchors=end_anchors)


def _require_free_holding(problem: PlanningProblem, trajectory: Trajectory, weights: Weights) -> None:
    """Raises RedesignError where the plan goes on costing something at rest before or after the manoeuvre."""
    plant = problem.plant
    edges = problem.deviation.breakpoints
    for tail, t, when in ((trajectory.before, edges[0] - 1.0, "before"), (trajectory.after, edges[-1] + 1.0, "after")):
        wanted = problem.deviation(t)
        staying_away = float(np.abs(wanted) @ np.abs(weights.Q_y) @ np.abs(wanted))
        x, u, y = np.split(tail.held[np.newaxis], [plant.n_states, plant.n_states + plant.n_channels], axis=1)
        rate = float(weights.rate(x, u, y - wanted)[0])
        rounding = ROUNDING * float(weights.terms(x, u, y - wanted)[0])
        if rate > FREE_HOLDING * staying_away + rounding:
            raise RedesignError(
                f"the cost is infinite: {when} the manoeuvre the outputs {list(plant.outputs.names)} are to be held at "
                f"{wanted.tolist()} (from the operating point) for ever, which costs {rate:.3g} per second even at the best "
                "compromise; let the reference return to the operating point, take the held value itself as the operating point, "
                "or give no weight to the states or inputs that holding it takes (a rigid-body motion needs none)"
            )
