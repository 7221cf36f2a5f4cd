"""Quadratic redesign on the nonlinear motion of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, require_duration, require_share
from invtrack.errors import PlanError, RedesignError
from invtrack.inversion.nonlinear.certificate import certify_motion
from invtrack.inversion.nonlinear.linearizations import linearizations_along
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.stable_inversion import SLACK, require_confirmed
from invtrack.inversion.nonlinear.trajectory import trajectory_of
from invtrack.inversion.whole_holds import in_whole_holds
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.actuation import ringing
from invtrack.plans.dynamics import Mechanism, ScheduledChange
from invtrack.plans.plan import Plan, Samples
from invtrack.plans.problem import actuation_times, left_out_of
from invtrack.plans.tail import Tail
from invtrack.redesign.cost import FARTHEST, Weights, as_weights
from invtrack.redesign.nonlinear.ends import RestEnd
from invtrack.redesign.nonlinear.gauss_newton import GaussNewtonStep
from invtrack.redesign.nonlinear.solver import LeastCostMotion, Optimum
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
        at, rest = self(t, inside=inside), self.steady(t, inside=inside)
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
    limits: tuple[float | None, float | None],
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
        limits: longest preactuation and postactuation [s].
    """
    for name, share in (("accuracy", accuracy), ("tolerance", tolerance)):
        require_share(name, share, error=PlanError)
    if hold is not None:
        require_duration("hold", hold, error=PlanError)
    problem = MotionProblem.of(mechanism, reference, schedule, exact=False)
    stated = _weights(problem, R=R, Q_x=Q_x, Q_y=Q_y)
    found = LeastCostMotion(problem, stated.in_unit(), stated.unit, accuracy, hold).solve()
    plan = _plan(problem, found, unit=stated.unit, accuracy=accuracy, tolerance=tolerance, limits=limits)
    plan = plan if hold is None else in_whole_holds(plan, hold)
    rings = ringing(plan)
    return plan if rings is None else replace(plan, ringing=rings, remarks=(*plan.remarks, rings.remark))


def _weights(problem: MotionProblem, *, R: ArrayLike, Q_x: ArrayLike, Q_y: ArrayLike) -> Weights:
    """Weights that fit the models at all rests. Raises RedesignError where they do not, or ask for nothing."""
    found = [as_weights(as_switched(model), R=R, Q_x=Q_x, Q_y=Q_y) for model in problem.linear_models]
    if not np.any(found[0].Q_y):
        raise RedesignError("Q_y is zero: with no weight on the outputs' errors nothing asks for a motion; weigh the output errors")
    found[0].require_within(FARTHEST)
    return found[0]


def _plan(
    problem: MotionProblem,
    found: Optimum,
    *,
    unit: float,
    accuracy: float,
    tolerance: float,
    limits: tuple[float | None, float | None],
) -> OptimalMotion:
    """The plan for a motion, confirmed by the simulator.

    Args:
        problem, found: what was asked for, and the motion of least cost.
        unit: of its cost.
        accuracy, tolerance, limits: see `redesign_motion`.
    """
    motions, motion, mesh = found.motions, found.course.motion, found.motions.mesh
    model = problem.model(mesh.edges)
    last = motions.ends[1].coordinates(motion.points[-1])
    tails = (
        _tail(model, motions.ends[0], found.course.v, motion.points[0], 0),
        _tail(model, motions.ends[1], last, motion.points[-1], -1),
    )
    trajectory = trajectory_of(motions, motion, model, tails)
    for k, dynamics in enumerate(problem.dynamics):
        chosen = np.flatnonzero(mesh.interval == k)
        dynamics.require_free(motion.points[chosen], motion.coefficients[chosen, 0])
    certificate = certify_motion(motions, motion, trajectory, model, problem.reference)
    require_confirmed(certificate, SLACK * accuracy, exact=False)
    preactuation, postactuation, limited = actuation_times(trajectory, problem.manoeuvre, tolerance, limits)
    return OptimalMotion(
        method=METHOD,
        model=model,
        reference=problem.reference,
        trajectory=trajectory,
        manoeuvre=problem.manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=certificate,
        remarks=(*limited, *left_out_of(model)),
        difference=problem.mechanism.state_difference if problem.mechanism.turns else None,
        linearizations=linearizations_along(motions, motion),
        optimality_gap=found.stationarity.total,
        cost=found.cost * unit,
        iterations=found.log,
        steady=found.steady,
    )


def _tail(model: SwitchedSystem, end: RestEnd, v: Array, point: Array, which: int) -> Tail:
    """[x; u; y] of the plan beyond the window, as deviations from the rest of the model's first or last interval."""
    rows = np.vstack([end.X, end.U, end.Y])
    held = np.zeros(len(rows))
    held[: len(end.X)] = end.dynamics.states(point[None])[0] - model.rest_states[which] - end.X @ v
    return end.tail(v, held, rows)
