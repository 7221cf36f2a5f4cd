"""Quadratic redesign on the nonlinear motion of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, require_duration, require_share
from invtrack.errors import PlanError, RedesignError
from invtrack.inversion.nonlinear.certificate import certify_motion
from invtrack.inversion.nonlinear.linearizations import linearizations_along
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.stable_inversion import SLACK, beyond_actuators, require_confirmed
from invtrack.inversion.nonlinear.trajectory import trajectory_of
from invtrack.inversion.whole_holds import in_whole_holds
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.actuation import ringing
from invtrack.plans.dynamics import Mechanism, ScheduledChange
from invtrack.plans.plan import Plan, Samples
from invtrack.plans.problem import PlanType, actuation_times, left_out_of
from invtrack.plans.tail import Tail
from invtrack.redesign.cost import FARTHEST, Weights, as_weights
from invtrack.redesign.nonlinear.costed import CostedMotions, Course
from invtrack.redesign.nonlinear.ends import RestEnd
from invtrack.redesign.nonlinear.gauss_newton import GaussNewtonStep
from invtrack.redesign.nonlinear.solver import LeastCostMotion
from invtrack.redesign.optimal_trajectory import OptimalTrajectory
from invtrack.references.signal import PiecewiseSignal

METHOD = "quadratic redesign of the nonlinear plant"


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class OptimalMotion(OptimalTrajectory):
    """A plan of `quadratic_redesign` for the nonlinear motion of a plant.

    Its `optimality_gap` is what other inputs near by could take off the cost, to second order, as a share of it: by the costate
    along the motion, worked out anew. There may be motions far from it that cost less.

    Args:
        cost: over all of time.
        iterations: every step of Gauss-Newton's method, refinements of the mesh among them.
        steady: x_rest(t) and u_rest(t), from which departures cost.
    """

    cost: float
    iterations: tuple[GaussNewtonStep, ...]
    steady: Plan

    def departures(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Samples:
        """Values at times t (m,) [s] as what costs: x - x_rest, u - u_rest, and outputs, planned and wanted, from those at rest."""
        return departures_from(self.steady, self(t, inside=inside), inside)


def departures_from(steady: Plan, at: Samples, inside: ArrayLike | None) -> Samples:
    """Values of a plan as departures from a steady motion; inside: times within the pieces meant, where a side matters."""
    rest = steady(at.time, inside=inside)
    return Samples(at.time, at.x - rest.x, at.u - rest.u, at.y - rest.y, at.y_d - rest.y)


def redesign_motion(
    mechanism: Mechanism,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike,
    Q_y: ArrayLike,
    schedule: Sequence[ScheduledChange],
    accuracy: float,
    hold: float | None,
    tolerance: float,
    reach: tuple[float | None, float | None],
) -> OptimalMotion:
    """The motion of a mechanism that costs least; see `invtrack.quadratic_redesign`.

    Args:
        mechanism: at an equilibrium in which the reference begins.
        reference: from rest to rest, absolute.
        R, Q_x, Q_y: weights.
        schedule: changes of its parameters.
        accuracy: of the integration and of the tails, as a share of the states' sizes.
        hold: period of a zero-order hold that drives the mechanism [s].
        tolerance: what counts as rest, as a share of peaks.
        reach: longest preactuation and postactuation [s].
    """
    solver, unit = least_cost_motion(
        mechanism, reference, R=R, Q_x=Q_x, Q_y=Q_y, schedule=schedule, accuracy=accuracy, hold=hold, tolerance=tolerance
    )
    found = solver.solve()
    details = {
        "optimality_gap": found.stationarity.total,
        "cost": found.cost * unit,
        "iterations": found.log,
        "steady": solver.rest.steady,
    }
    return plan_of(
        OptimalMotion, METHOD, solver, found.motions, found.course, tolerance=tolerance, reach=reach, remarks=(), **details
    )


def least_cost_motion(
    mechanism: Mechanism,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike,
    Q_y: ArrayLike,
    schedule: Sequence[ScheduledChange],
    accuracy: float,
    hold: float | None,
    tolerance: float,
) -> tuple[LeastCostMotion, float]:
    """The problem of a redesign, checked, and the unit of its cost.

    Args:
        mechanism, reference, R, Q_x, Q_y, schedule, accuracy, hold, tolerance: see `redesign_motion`.
    """
    require_share("tolerance", tolerance, error=PlanError)
    if hold is not None:
        require_duration("hold", hold, error=PlanError)
    problem = MotionProblem.of(mechanism, reference, schedule, exact=False)
    stated = _weights(problem, R=R, Q_x=Q_x, Q_y=Q_y)
    return LeastCostMotion(problem, stated.in_unit(), stated.unit, accuracy, hold), stated.unit


def _weights(problem: MotionProblem, *, R: ArrayLike, Q_x: ArrayLike, Q_y: ArrayLike) -> Weights:
    """Weights that fit the models at all rests. Raises RedesignError where they do not, or ask for nothing."""
    found = [as_weights(as_switched(model), R=R, Q_x=Q_x, Q_y=Q_y) for model in problem.linear_models]
    if not np.any(found[0].Q_y):
        raise RedesignError("Q_y is zero: with no weight on the outputs' errors nothing asks for a motion; weigh the output errors")
    found[0].require_within(FARTHEST)
    return found[0]


def plan_of(
    kind: type[PlanType],
    method: str,
    solver: LeastCostMotion,
    motions: CostedMotions,
    course: Course,
    *,
    tolerance: float,
    reach: tuple[float | None, float | None],
    remarks: Sequence[str],
    **details: Any,
) -> PlanType:
    """The plan for a motion, confirmed by the simulator.

    Args:
        kind, method: of the plan.
        solver: of the problem.
        motions, course: the motion.
        tolerance: see `redesign_motion`.
        reach: longest preactuation and postactuation [s].
        remarks: what a user should know.
        details: further fields of the kind.
    """
    problem, motion, mesh = solver.problem, course.motion, motions.mesh
    model = problem.model(mesh.edges)
    trajectory = trajectory_of(motions, motion, model, tails_of(motions, course, model))
    for k, dynamics in enumerate(problem.dynamics):
        chosen = np.flatnonzero(mesh.interval == k)
        dynamics.require_free(motion.points[chosen], motion.coefficients[chosen, 0])
    certificate = certify_motion(motions, motion, trajectory, model, problem.reference, solver.accuracy)
    require_confirmed(certificate, SLACK * solver.accuracy, exact=False, clamped=beyond_actuators(motion, model))
    preactuation, postactuation, limited = actuation_times(trajectory, problem.manoeuvre, tolerance, reach)
    plan = kind(
        method=method,
        model=model,
        reference=problem.reference,
        trajectory=trajectory,
        manoeuvre=problem.manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=certificate,
        remarks=(*limited, *remarks, *left_out_of(model)),
        difference=problem.mechanism.state_difference if problem.mechanism.turns else None,
        linearizations=linearizations_along(motions, motion),
        **details,
    )
    plan = plan if solver.hold is None else in_whole_holds(plan, solver.hold)
    rings = ringing(plan)
    return plan if rings is None else replace(plan, ringing=rings, remarks=(*plan.remarks, rings.remark))


def tails_of(motions: CostedMotions, course: Course, model: SwitchedSystem) -> tuple[Tail, Tail]:
    """[x; u; y] of a plan before and after the window, as deviations from the rests of the model."""
    last = motions.ends[1].coordinates(course.motion.points[-1])
    before = _tail(model, motions.ends[0], course.v, course.motion.points[0], 0)
    return before, _tail(model, motions.ends[1], last, course.motion.points[-1], -1)


def _tail(model: SwitchedSystem, end: RestEnd, v: Array, point: Array, which: int) -> Tail:
    """[x; u; y] of the plan beyond the window, as deviations from the rest of the model's first or last interval."""
    rows = np.vstack([end.X, end.U, end.Y])
    held = np.zeros(len(rows))
    held[: len(end.X)] = end.dynamics.states(point[None])[0] - model.rest_states[which] - end.X @ v
    return end.tail(v, held, rows)
