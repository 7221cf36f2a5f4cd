"""Optimal output-trajectory redesign under hard limits on inputs, their rates, outputs and states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike

from invtrack.arrays import require_duration
from invtrack.errors import RedesignError
from invtrack.inversion.motion_options import checked_motion_options
from invtrack.plans.dynamics import ScheduledChange, mechanism
from invtrack.redesign.constrained_trajectory import ConstrainedTrajectory
from invtrack.redesign.cost import as_weights
from invtrack.redesign.limited.active_limits import active_limits
from invtrack.redesign.limited.limit_check import require_rest_within
from invtrack.redesign.limited.window import KEPT, LimitedProblem, free_excess, solve_limited
from invtrack.redesign.limits import Limits, bounds_of
from invtrack.redesign.nonlinear.limited_redesign import redesign_motion_within
from invtrack.redesign.quadratic import free_optimum, require_for_plants
from invtrack.references.signal import PiecewiseSignal

METHOD = "constrained redesign"


def constrained_redesign(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    limits: Limits,
    step: float | None = None,
    schedule: Sequence[ScheduledChange] = (),
    accuracy: float = 1e-8,
    hold: float | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
) -> ConstrainedTrajectory:
    """The trajectory of `model` that costs least among those that keep within `limits`, over all of time.

    minimise  integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d)
    subject to  x' = A_k x + B_k (u - u0),  low <= u, u', y, c'x <= high.

    What costs is the departure from the rest of the interval in force, as in `quadratic_redesign`; limits are absolute. With a
    limited rate the input does not jump where a jump of the plant moves its value at rest.

    Where the optimum without limits keeps within them it is returned as it is. Otherwise the input is continuous (but for the jumps
    of B and D) and linear in time over steps within a window around the manoeuvre; before and after the window the plan is the
    optimum without limits in closed form, whose exact cost is part of the programme, so no horizon is truncated. The window is
    widened until that part keeps within the limits too and none acts where it joins; then nothing is lost by leaving them out
    there. Within a step transitions and costs are exact (matrix exponentials). Inputs and rates keep their limits at every instant,
    to rounding; states and outputs to 1e-6 of them, checked between the steps' ends, where further instants are imposed as needed.
    The plan's `active` says where it touches which limit and what a unit more of it would save there (the integral of its Lagrange
    multiplier), `shadow_prices` what that is in all; `optimality` holds the plan's cost and its duality gap, from the multipliers:
    no plan with the same steps costs less by more than that. As `step` goes to zero the plan tends to the optimum among all inputs,
    its cost and its input with an error of order step^2 away from the instants at which a limit begins or ceases to act.

    A Plant is planned for as it moves, as by `quadratic_redesign`, from the motion without limits on by sequential quadratic
    programming on the linearization along the motion. The input is then continuous only where its rate is limited, and, where it is
    to be held, constant over each hold. What comes back is a ConstrainedMotion, whose `optimality` is that of motions near by.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D; or a Plant at an equilibrium.
        reference: wanted outputs, absolute, in their units, held still before and after the manoeuvre.
        R: weight of the inputs (p, p), positive definite; a number stands for that multiple of the identity, here and below.
        Q_x: weight of the states (n, n), positive semidefinite.
        Q_y: weight of the output errors (p, p), positive semidefinite.
        limits: what the plan must never exceed.
        step: longest time over which the input is linear [s]; by default such that linear interpolation of the optimal input
            without limits misses it by 1e-5 of its peak (up to 1e-3 where that takes many steps); for a Plant a 200th of the
            manoeuvre.
        schedule, accuracy, hold: for a Plant, see `quadratic_redesign`; with a hold no rates can be limited.
        tolerance: share of its peak below which what is left of the plan before its start and after its end counts as rest.
        max_preactuation, max_postactuation: longest time before the manoeuvre at which the plan may start, and after it at which it
            may end [s]; None: as long as the tolerance asks.

    Raises what `quadratic_redesign` does, and RedesignError for limits that make no sense, that the plan at rest before or after
    the manoeuvre does not keep, or that cannot be kept all at once (which conflict and how far one has to give way), and where the
    plan found has a duality gap of more than 1e-6 of its cost.
    Method: dual-mode quadratic programming (P. Scokaert, J. Rawlings, "Constrained linear quadratic regulation", IEEE Trans.
    Automatic Control 43(8), 1998), in continuous time and at both ends.
    """
    if step is not None:
        require_duration("step", step, error=RedesignError)
    schedule, moving = checked_motion_options(schedule, accuracy, error=RedesignError), mechanism(model)
    if moving is not None:
        return redesign_motion_within(
            moving,
            reference,
            R=R,
            Q_x=Q_x,
            Q_y=Q_y,
            limits=limits,
            step=step,
            schedule=schedule,
            accuracy=accuracy,
            hold=hold,
            tolerance=tolerance,
            reach=(max_preactuation, max_postactuation),
        )
    require_for_plants(schedule=schedule, hold=hold)
    free = free_optimum(
        model,
        reference,
        R=R,
        Q_x=Q_x,
        Q_y=Q_y,
        tolerance=tolerance,
        max_preactuation=max_preactuation,
        max_postactuation=max_postactuation,
    )
    problem = LimitedProblem(free, bounds_of(limits, free.problem.plant))
    require_rest_within(problem.tails, problem.bounds)
    if not free_excess(problem) > KEPT:  # what is no number is refused by the certificate
        remark = "no limit is active: this is the optimum without limits"
        return free.problem.plan(
            METHOD, free.trajectory, exact=False, remarks=(remark,), kind=ConstrainedTrajectory, limits=problem.bounds
        )
    solution = solve_limited(problem, step)
    # Found in a unit of the cost of its own, in which the weights are about one.
    unit = as_weights(free.problem.plant, R=R, Q_x=Q_x, Q_y=Q_y).size / free.weights.size
    active = active_limits(solution.trajectory, problem.bounds, solution.rows, solution.multipliers * unit)
    steps = len(solution.trajectory.breakpoints) - 1
    remarks = (
        f"the input is linear in time over {steps} steps of up to {solution.step:.4g} s",
        *map(str, active),
        *([f"a limit is exceeded by {solution.overshoot:.1e} of it between steps"] if solution.overshoot > KEPT else []),
    )
    return free.problem.plan(
        METHOD,
        solution.trajectory,
        exact=False,
        remarks=remarks,
        kind=ConstrainedTrajectory,
        limits=problem.bounds,
        active=active,
        overshoot=solution.overshoot,
        step=solution.step,
        optimality=replace(solution.optimality, cost=solution.optimality.cost * unit),
    )
