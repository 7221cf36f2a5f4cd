"""Exact output tracking on the nonlinear motion of a mechanism: stable inversion by multiple shooting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from invtrack.arrays import real_number, require_duration, require_share
from invtrack.errors import NonHyperbolicError, PlanError
from invtrack.inversion.nonlinear.certificate import MotionChecks, certify_motion, input_jump
from invtrack.inversion.nonlinear.continuation import Progress
from invtrack.inversion.nonlinear.decoupling import require_hold_of_outputs
from invtrack.inversion.nonlinear.linearizations import linearizations_along
from invtrack.inversion.nonlinear.newton import Iteration
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.shooting import Motion
from invtrack.inversion.nonlinear.solver import MotionSolver, Solution
from invtrack.inversion.nonlinear.tails import tails_of
from invtrack.inversion.nonlinear.trajectory import trajectory_of
from invtrack.inversion.whole_holds import held_remark, in_whole_holds
from invtrack.linear.internal_dynamics import NOT_UNIQUE, format_zeros
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.actuation import ringing
from invtrack.plans.certificate import Certificate
from invtrack.plans.dynamics import Mechanism, ScheduledChange
from invtrack.plans.plan import Plan
from invtrack.plans.problem import actuation_times, left_out_of
from invtrack.plans.runge_kutta import legendre
from invtrack.plans.trajectory import Trajectory
from invtrack.references.signal import PiecewiseSignal

ON_AXIS = 1e-6
"""A zero is on the imaginary axis where its real part is below this share of its size: models are found by differences."""

EDGES = 9
"""Points of an element at which its inputs are compared with their ranges."""

SLACK = 10.0
"""A plan may miss its equations, replayed, by so many times the accuracy that its mesh was made for."""


@dataclass(frozen=True, eq=False, repr=False)
class MotionPlan(Plan):
    """A plan of `invert` for the nonlinear motion of a plant.

    Args:
        iterations: every step of Newton's method, refinements of the mesh among them.
        checks: what the plan was judged by, beside its certificate.
    """

    iterations: tuple[Iteration, ...] = ()
    checks: MotionChecks = field(default_factory=lambda: MotionChecks(0.0, np.inf, None, 0.0, 0))


def invert_motion(
    mechanism: Mechanism,
    reference: PiecewiseSignal,
    *,
    schedule: Sequence[ScheduledChange] = (),
    accuracy: float = 1e-8,
    hold: float | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
    progress: Progress | None = None,
) -> MotionPlan:
    """The bounded input and state with which the outputs of a mechanism follow `reference` exactly; see `invtrack.invert`.

    Args:
        mechanism: at an equilibrium in which the reference begins.
        reference: from rest to rest, absolute.
        schedule: changes of its parameters.
        accuracy: largest output error between the points where it is matched, as a share of the motion.
        hold: period of a zero-order hold that drives the mechanism [s].
        tolerance: what counts as rest, as a share of peaks.
        max_preactuation, max_postactuation: limit these [s].
        progress: called with the share of the motion that has been found.
    """
    limits = checked_limits(accuracy, tolerance, max_preactuation, max_postactuation)
    if hold is not None:
        require_duration("hold", hold, error=PlanError)
    problem = MotionProblem.of(mechanism, reference, schedule)
    solver = MotionSolver(problem, accuracy, limits, progress)
    solution = solver.refined() if hold is None else solver.held(hold)
    plan = _plan(problem, solution, accuracy=accuracy, tolerance=tolerance, limits=limits, hold=hold)
    plan = plan if hold is None else in_whole_holds(plan, hold)
    rings = ringing(plan)
    return plan if rings is None else replace(plan, ringing=rings, remarks=(*plan.remarks, rings.remark))


def checked_limits(
    accuracy: float, tolerance: float, max_preactuation: float | None, max_postactuation: float | None
) -> tuple[float | None, float | None]:
    """The longest preactuation and postactuation [s]. Raises PlanError where these or the shares are out of range."""
    for name, share in (("accuracy", accuracy), ("tolerance", tolerance)):
        require_share(name, share, error=PlanError)
    for name, limit in (("max_preactuation", max_preactuation), ("max_postactuation", max_postactuation)):
        if limit is not None and not real_number(name, limit, unit="s", error=PlanError) >= 0:
            raise PlanError(f"{name} must not be negative, got {limit}")
    return max_preactuation, max_postactuation


def _plan(
    problem: MotionProblem,
    solution: Solution,
    *,
    accuracy: float,
    tolerance: float,
    limits: tuple[float | None, float | None],
    hold: float | None,
) -> MotionPlan:
    """The plan for a motion, confirmed by the simulator.

    Args:
        problem, solution: what was asked for, and the motion that was found.
        accuracy, tolerance, hold: see `invert_motion`.
        limits: longest preactuation and postactuation [s], or None.
    """
    found = confirmed(problem, solution, problem.reference, accuracy, exact=hold is None)
    preactuation, postactuation, limited = actuation_times(found.trajectory, problem.manoeuvre, tolerance, limits)
    held = () if hold is None else (held_remark(hold, found.certificate),)
    return MotionPlan(
        method="stable inversion of the nonlinear plant",
        model=found.model,
        reference=problem.reference,
        trajectory=found.trajectory,
        manoeuvre=problem.manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=found.certificate,
        remarks=(*limited, *held, *left_out_of(found.model)),
        difference=problem.mechanism.state_difference if problem.mechanism.turns else None,
        linearizations=linearizations_along(solution.shooting, solution.motion),
        iterations=solution.log,
        checks=found.checks,
    )


@dataclass(frozen=True, eq=False)
class Confirmed:
    """What a plan says of a motion, and what the simulator says of that: models, trajectory, certificate, checks."""

    model: SwitchedSystem
    trajectory: Trajectory
    certificate: Certificate
    checks: MotionChecks


def confirmed(problem: MotionProblem, solution: Solution, outputs: PiecewiseSignal, accuracy: float, *, exact: bool) -> Confirmed:
    """The trajectory of a motion, confirmed by the simulator.

    Args:
        problem, solution: what was asked for, and the motion that was found.
        outputs: that it was found for, absolute.
        accuracy: of these, as a share of their motion.
        exact: whether they are to be kept between the matched points, too.

    Raises RelativeDegreeError, PlantError, NonHyperbolicError, PlanError for a motion that is none of the plant, or does not rest.
    """
    shooting, motion, mesh = solution.shooting, solution.motion, solution.shooting.mesh
    decoupling = require_hold_of_outputs(shooting, motion, problem.relative_degree, 1.0)
    model = problem.model(mesh.edges)
    trajectory = trajectory_of(shooting, motion, model, tails_of(problem, shooting, motion, model))
    for k, dynamics in enumerate(problem.dynamics):
        chosen = np.flatnonzero(mesh.interval == k)
        dynamics.require_free(motion.points[chosen], motion.coefficients[chosen, 0])
    certificate = certify_motion(shooting, motion, trajectory, model, outputs, accuracy)
    _require_rest(problem, certificate, SLACK * accuracy)
    require_confirmed(certificate, SLACK * accuracy, exact=exact, clamped=beyond_actuators(motion, model))
    checks = MotionChecks(
        rest_residual=max(rest.residual for rest in problem.rests),
        gap=min(end.gap for end in shooting.ends),
        decoupling=decoupling,
        input_jump=input_jump(mesh, trajectory, model, problem.stops),
        elements=len(mesh),
    )
    return Confirmed(model, trajectory, certificate, checks)


def _require_rest(problem: MotionProblem, certificate: Certificate, limit: float) -> None:
    """Raises NonHyperbolicError or PlanError for a motion that does not come to rest at its ends."""
    if certificate.rest_residual <= limit:
        return
    zeros = np.concatenate([problem.zeros[0], problem.zeros[-1]])
    on_axis = zeros[(np.abs(zeros.real) < ON_AXIS * np.abs(zeros)) & (zeros != 0)]
    left = f"{certificate.rest_residual:.1e} of the motion is left at the ends of the plan"
    if len(on_axis):
        raise NonHyperbolicError(
            f"the motion does not come to rest: {left}, in zeros on the imaginary axis ({format_zeros(on_axis)}), {NOT_UNIQUE}; "
            "damp them, track another output, or choose a reference that leaves them at rest"
        )
    raise PlanError(
        f"the motion does not come to rest: {left}, where its tails do not carry it; allow more preactuation and "
        "postactuation, or ask for less accuracy"
    )


def beyond_actuators(motion: Motion, model: SwitchedSystem) -> str:
    """Which inputs of a motion go beyond what their actuators pass on, in words; "" where none does."""
    values = np.einsum("kim,ji->kjm", motion.coefficients, legendre(motion.coefficients.shape[1], np.linspace(0.0, 1.0, EDGES)))
    lowest, highest = values.min(axis=(0, 1)), values.max(axis=(0, 1))
    ranges = zip(model.inputs.names, lowest, highest, model.systems[0].input_limits, strict=True)
    said = [
        f"{name!r} goes from {low:.4g} to {high:.4g}, of which its actuator passes on {allowed[0]:.4g} to {allowed[1]:.4g}"
        for name, low, high, allowed in ranges
        if low < allowed[0] or high > allowed[1]
    ]
    return "; ".join(said)


def require_confirmed(certificate: Certificate, limit: float, *, exact: bool, clamped: str) -> None:
    """Raises PlanError for a plan that its replay does not confirm.

    Args:
        certificate: the replay's.
        limit: largest residual.
        exact: whether y = y_d holds between the points, too.
        clamped: see `beyond_actuators`.
    """
    if certificate.worst(exact=exact) <= limit:
        return
    if clamped:
        raise PlanError(
            f"the plan asks for more than the actuators pass on: {clamped}. Ask for a smaller, slower or smoother motion, or for "
            "less input by constrained_redesign"
        )
    raise PlanError(
        f"the plan is not confirmed by the simulator: replayed from its own states it misses them or its outputs by more than "
        f"{limit:.1e} of their size ({certificate}); a limit of force, a stop or a contact may act on the way, or the plant may "
        "not be smooth there. Ask for a motion that stays clear of it, or for less accuracy"
    )
