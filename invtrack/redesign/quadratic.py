"""Optimal output-trajectory redesign: a deliberate trade between following the reference and what that costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers, shown
from invtrack.errors import RedesignError
from invtrack.inversion.motion_options import checked_motion_options
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.dynamics import ScheduledChange, mechanism
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.cheap import certified_optimum
from invtrack.redesign.cost import Weights, as_weights
from invtrack.redesign.least_cost import LeastCost
from invtrack.redesign.nonlinear.motion_redesign import redesign_motion
from invtrack.redesign.optimal_trajectory import OptimalTrajectory
from invtrack.references.signal import PiecewiseSignal

METHOD = "quadratic redesign"


def quadratic_redesign(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    probabilities: ArrayLike | None = None,
    schedule: Sequence[ScheduledChange] = (),
    accuracy: float = 1e-8,
    hold: float | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
) -> OptimalTrajectory:
    """The trajectory of `model` that minimises what it costs to move and to miss the reference, over all of time.

    integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d), x' = A_k x + B_k (u - u0), the state continuous through the
    jumps; x and u - u0 are deviations from the rest of the interval in force, so a load that is held against gravity costs nothing.
    u = -K x - R^-1 B's with K from the Riccati equation and s' = -(A - B K)'s + C'Q_y y_d from the future, so the input acts before
    the manoeuvre. The plan's y is the redesigned output; `reference` stays the wanted one, and the certificate's output error is
    what lies between the two by design. Nothing is asked of the reference's smoothness.

    Several models, in a list, are what the plant may turn out to be (variants of its parameters): the plan is then the robust one,
    the one input whose mean cost over them is least. It is the plan of the first model, its `variants` are what that input makes of
    each. Each must come to rest by the same input: a mode that is not stable must be moved by it differently in each of them.

    The plan carries the share of its cost by which any other input could cost less at most, certified from its values alone
    (`optimality_gap`): 1e-7 or less, unless rounding hides more, as where inputs are so cheap that output errors drown in it; from
    1e-6 on a remark says so.

    A Plant is planned for as it moves, x' = f(x, u), y = h(x, u) from MuJoCo, from the equilibrium at which it stands to the one
    that the reference ends in: by Gauss-Newton's method on elements of time, each step a linear-quadratic problem along the way,
    with what lies far before and after it in closed form. Its x and u cost by how far they are from the state and the input that
    would hold the wanted outputs where they are at that time (`invtrack.inversion.steady_state_feedforward`). That is the same
    where holding takes no other input than at the operating point; where it does, holding costs nothing, before, on the way and
    after. What comes back is an OptimalMotion, whose `optimality_gap` is what inputs near by could take off the cost: a motion far
    from it may cost less.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D; or a list of them, with the same states, inputs and outputs
            about the same operating point; or a Plant at an equilibrium, with any numbers of inputs and outputs.
        reference: absolute, in the units of the outputs, held still before and after the manoeuvre.
        R: weight of the inputs (p, p), positive definite, in 1 / (units squared) like all weights; a number stands for that
            multiple of the identity, here and below.
        Q_x: weight of the states (n, n), positive semidefinite.
        Q_y: weight of the output errors (p, p), positive semidefinite. Where it is zero the optimum is not to move.
        probabilities: how likely each of several models is (k,), alike unless stated; they are scaled to add up to one.
        schedule: for a Plant, when its parameters change on the way: [Change(1.0, tip_mass=0.5)].
        accuracy: for a Plant, how well the integration and the linear tails are to follow its dynamics, as a share of the states'
            sizes.
        hold: for a Plant, the period of the zero-order hold that will drive it [s]: inputs are constant over each hold and the best
            such ones, so that what is planned is what is driven. Without it they are polynomials over elements of time.
        tolerance: share of each peak that counts as rest, as in `invert`.
        max_preactuation, max_postactuation: longest [s], as in `invert`; None: as long as the tolerance asks.

    Raises TrajectoryError (wrong number of channels, a reference that does not hold still before and after), RedesignError
    (options or weights out of range; holding an end value would cost input for ever, so that the cost is infinite; a mode that
    the cost does not see or the input does not reach; inputs so cheap that nothing can be certified; models that do not fit each
    other; for a Plant also where Gauss-Newton's method finds no motion), and for a Plant PlanError (no equilibrium for a wanted
    output, or a motion that the simulator does not confirm). Source: S. Devasia, "Optimal output-trajectory redesign for invertible
    systems", AIAA J. of Guidance, Control, and Dynamics 19(5), 1996 (frequency domain; here the same optimum in time).
    """
    schedule, moving = checked_motion_options(schedule, accuracy, error=RedesignError), mechanism(model)
    if moving is not None:
        if probabilities is not None:
            raise RedesignError("probabilities are for a list of linear models, a Plant is planned for as it moves; leave them out")
        return redesign_motion(
            moving,
            reference,
            R=R,
            Q_x=Q_x,
            Q_y=Q_y,
            schedule=schedule,
            accuracy=accuracy,
            hold=hold,
            tolerance=tolerance,
            reach=(max_preactuation, max_postactuation),
        )
    require_for_plants(schedule=schedule, hold=hold)
    plants = _plants(model)
    shares = _shares(probabilities, len(plants))
    weights = [as_weights(plant, R=R, Q_x=Q_x, Q_y=Q_y) for plant in plants]  # each checks them against its own feedthrough
    tasks = [
        PlanningProblem.of(
            plant, reference, tolerance=tolerance, max_preactuation=max_preactuation, max_postactuation=max_postactuation
        )
        for plant in plants
    ]
    problem = LeastCost.of(tasks, weights[0], shares)
    found = certified_optimum(problem)

    def plan(k: int, **variants: Any) -> OptimalTrajectory:
        return problem.problems[k].plan(
            METHOD,
            problem.of_plant(k, found.trajectory),
            exact=False,
            remarks=found.remarks,
            kind=OptimalTrajectory,
            optimality_gap=found.gap,
            **variants,
        )

    if len(plants) == 1:
        return plan(0)
    return plan(0, variants=tuple(plan(k) for k in range(len(plants))), probabilities=tuple(shares.tolist()))


def require_for_plants(*, schedule: Sequence[ScheduledChange], hold: float | None) -> None:
    """Raises RedesignError for options that only the plan for a Plant has."""
    for name, given in (("schedule", len(schedule) > 0), ("hold", hold is not None)):
        if given:
            raise RedesignError(f"{name} is for a Plant, which is planned for as it moves; leave it out for a linear model")


def _plants(model: Any) -> list[SwitchedSystem]:
    """The models with the jumps of all of them, checked to be of the same kind."""
    if not isinstance(model, Sequence):
        return [as_switched(model)]
    if not model:
        raise RedesignError("expected a model, or a list of at least one, got an empty list")
    plants = [as_switched(each) for each in model]
    first = plants[0]
    for number, plant in enumerate(plants[1:], start=1):
        alike = all(getattr(plant, kind).fits(getattr(first, kind)) for kind in ("states", "inputs", "outputs"))
        if not alike:
            raise RedesignError(
                f"model {number} of {len(plants)} differs from the first in its states, inputs or outputs; one input for several "
                "models needs the same channels, and only other parameters"
            )
    times = np.unique(np.concatenate([plant.switch_times for plant in plants]))
    inside = np.concatenate([times[:1] - 1.0, (times[:-1] + times[1:]) / 2, times[-1:] + 1.0]) if len(times) else np.zeros(1)
    together = [SwitchedSystem([plant.systems[k] for k in plant.interval(inside)], times) for plant in plants]
    for number, plant in enumerate(together[1:], start=1):
        pairs = zip(plant.systems, together[0].systems, strict=True)
        if not all(a.operating_point.agrees_with(b.operating_point) for a, b in pairs):
            raise RedesignError(
                f"model {number} of {len(plants)} is at rest with another input or output than the first; one input for several "
                "models needs the same operating point in all of them, and only other parameters"
            )
    return together


def _shares(probabilities: ArrayLike | None, count: int) -> Array:
    """Probabilities of the models (k,) that add up to one."""
    given = np.ones(count) if probabilities is None else real_numbers("probabilities", probabilities, error=RedesignError)
    if given.shape != (count,) or not np.all(np.isfinite(given)) or np.any(given <= 0):
        raise RedesignError(f"probabilities must be positive, one for each of {count} model(s), got {shown(probabilities)}")
    return np.asarray(given / np.sum(given))


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
    max_postactuation: float | None,
) -> FreeOptimum:
    """What `quadratic_redesign` makes a plan of; it raises the same errors.

    Args:
        model, reference, R, Q_x, Q_y, tolerance, max_preactuation, max_postactuation: see `quadratic_redesign`.
    """
    task = PlanningProblem.of(
        model, reference, tolerance=tolerance, max_preactuation=max_preactuation, max_postactuation=max_postactuation
    )
    problem = LeastCost.of([task], as_weights(task.plant, R=R, Q_x=Q_x, Q_y=Q_y), np.ones(1))
    found = problem.solve()
    return FreeOptimum(problem.problems[0], problem.weights, problem.of_plant(0, found.trajectory))
