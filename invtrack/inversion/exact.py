"""Exact output tracking with bounded input and state: stable inversion, through parameter jumps at known times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from numpy.typing import ArrayLike

from invtrack.errors import PlanError, RelativeDegreeError
from invtrack.inversion.allocated import AllocatedDynamics, require_same_unpriced, require_unpriced_rest
from invtrack.inversion.axis_zeros import require_rest_held, require_rest_left, split_through_axis
from invtrack.inversion.bounded_solution import bounded_solution
from invtrack.inversion.held import held_inverse
from invtrack.inversion.input_measure import InputMeasure, input_measure
from invtrack.inversion.inverse_system import inverse_systems
from invtrack.inversion.motion_options import checked_motion_options, require_no_schedule
from invtrack.inversion.nonlinear.stable_inversion import invert_motion
from invtrack.inversion.redesign_call import REDESIGN_ERROR, call_for
from invtrack.inversion.smoothness import require_smooth
from invtrack.linear.invertibility import why_not_invertible
from invtrack.plans.dynamics import ScheduledChange, mechanism
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.references.signal import PiecewiseSignal


def invert(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike | None = None,
    schedule: Sequence[ScheduledChange] = (),
    accuracy: float = 1e-8,
    hold: float | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
    progress: Callable[[float], None] | None = None,
) -> Plan:
    """The bounded input and state with which the outputs of `model` follow `reference` exactly.

    x' = A_k (x - rest_k) + B_k (u - u0_k), y = y_d on all of time, x continuous through the jumps. Internal dynamics: stable part
    forward from rest, antistable part backward from rest, so the input acts before the manoeuvre (preactuation) and rings down
    after it. What belongs to zeros on the imaginary axis runs forward, from rest; a reference that leaves it at rest is served.

    With more inputs than outputs many inputs do it. Taken are those with the least integral of (u - u_rest)'R (u - u_rest), where
    u_rest is the least u'R u (from the operating point's input) that would hold the wanted outputs where they are.

    A Plant is planned for as it moves, not as it is linearized: x' = f(x, u), y = h(x, u) from MuJoCo, from the equilibrium at
    which it stands to the one that the reference ends in, by multiple shooting on elements of time; the end conditions are those of
    the linear models at the two equilibria. What comes back is a MotionPlan with the steps of Newton's method.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D, with at least as many inputs as outputs; or a Plant at an
            equilibrium, with as many inputs as outputs.
        reference: absolute, in the units of the outputs; for a Plant from rest, where it stands, to rest.
        R: how dear inputs are where there is a choice (m, m), in 1 / (units squared); by default each input by its range
            (`input_limits`), without limits all alike.
        schedule: for a Plant, when its parameters change on the way: [Change(1.0, tip_mass=0.5)].
        accuracy: for a Plant, the largest output error anywhere, as a share of the motion, that the mesh is made for.
        hold: the period of the zero-order hold that will drive the plant [s]: inputs are constant over each hold and the outputs
            exact once in it, so that holding costs nothing. Without it inputs are continuous on each stretch of time. It takes as
            many inputs as outputs, and a reference from rest to rest.
        tolerance: what counts as rest at the two ends, as a share of each state's and input's peak; it sets how early the plan
            starts and how late it ends.
        max_preactuation, max_postactuation: limit these [s], at the price of a start, or an end, that is not quite at rest; the
            plan's `remarks` say how far from it.
        progress: for a Plant, called with the share of the motion that has been found.

    Raises TrajectoryError (reference not smooth enough, wrong number of channels), PlanError (options out of range; too
    ill-conditioned; for a Plant no equilibrium, no motion found, or one that the simulator does not confirm), RelativeDegreeError
    (also where a Plant's inputs lose hold of the outputs on the way), NonHyperbolicError (the reference leaves motion in zeros on
    the imaginary axis of the last interval, or holds outputs that drive a zero at the origin), CompatibilityError (a jump at which
    no continuous state keeps the output exact), BoundednessError (no bounded solution).
    Sources: Devasia, Chen, Paden 1996; Devasia, Paden, Rossi 1996, Lemma 1.
    """
    schedule = checked_motion_options(schedule, accuracy, progress)
    moving = mechanism(model)
    if moving is not None:
        if R is not None:
            raise PlanError("R chooses among inputs that are left over, which a plan for a Plant cannot have; leave R out")
        return invert_motion(
            moving,
            reference,
            schedule=schedule,
            accuracy=accuracy,
            hold=hold,
            tolerance=tolerance,
            max_preactuation=max_preactuation,
            max_postactuation=max_postactuation,
            progress=progress,
        )
    require_no_schedule(schedule)
    problem = PlanningProblem.of(
        model, reference, tolerance=tolerance, max_preactuation=max_preactuation, max_postactuation=max_postactuation
    )
    if hold is not None:
        if R is not None:
            raise PlanError("R chooses among inputs that are left over, which a plan for a hold cannot have; leave R out")
        return held_inverse(problem, hold)
    plant, measure = problem.plant, input_measure(problem.plant, R)
    if plant.n_inputs > plant.n_outputs:
        return _allocated(problem, measure)
    if plant.n_inputs < plant.n_outputs:
        raise RelativeDegreeError(
            f"{why_not_invertible(plant.systems[0])}, for instance {call_for(plant, problem.deviation)} where an error of "
            f"{REDESIGN_ERROR:g} of an output's motion counts as much as the input that the motion takes"
        )
    splits = split_through_axis(plant)
    require_rest_held(problem, splits)
    require_smooth(plant, [split.internal for split in splits], problem.deviation)
    solution = bounded_solution(problem, inverse_systems(plant, splits), measure)
    remarks = solution.remarks + require_rest_left(problem, splits, solution.equations)
    return problem.plan("stable inversion", solution.trajectory, exact=True, remarks=remarks)


def _allocated(problem: PlanningProblem, measure: InputMeasure) -> Plan:
    """The plan for more inputs than outputs."""
    plant = problem.plant
    inverses = plant.map(lambda system: AllocatedDynamics.of(system, measure.R).inverse(endless=plant.is_endless(system)))
    require_same_unpriced(inverses)
    require_smooth(plant, [inverse.internal for inverse in inverses], problem.deviation)
    solution = bounded_solution(problem, inverses, measure)
    remark = (
        f"{plant.n_inputs} inputs for {plant.n_outputs} output(s): of those that follow the reference exactly the least, "
        f"{measure.wording}, was taken"
    )
    remarks = (remark, *solution.remarks, *require_unpriced_rest(problem, inverses, solution.equations))
    return problem.plan("stable inversion", solution.trajectory, exact=True, remarks=remarks)
