"""Redesign within limits on the nonlinear motion of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from invtrack.errors import RedesignError
from invtrack.inversion.nonlinear.trajectory import trajectory_of
from invtrack.plans.dynamics import Mechanism, ScheduledChange
from invtrack.plans.plan import Plan, Samples
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.constrained_trajectory import ConstrainedTrajectory
from invtrack.redesign.limited.active_limits import active_limits
from invtrack.redesign.limited.limit_check import require_rest_within, tail_excess, values_between, worst_within_steps
from invtrack.redesign.limits import Bound, Limits, bounds_of
from invtrack.redesign.nonlinear.gauss_newton import GaussNewtonStep
from invtrack.redesign.nonlinear.limited_motion import LimitedMotion, LimitedOptimum
from invtrack.redesign.nonlinear.motion_redesign import departures_from, least_cost_motion, plan_of, tails_of
from invtrack.references.signal import PiecewiseSignal

METHOD = "constrained redesign of the nonlinear plant"

KEPT = 1e-9
"""A limit counts as kept where it is exceeded by no more than this share of its size."""

SNAP = 1e-7
"""A value within this share of a limit's size of the limit counts as on it."""

OVERSHOOT = 1e-4
"""Share of its size by which a limit on states and outputs may be exceeded between the instants at which it is imposed."""

MOST_WIDENINGS = 6
"""How often the window may be doubled on a side."""

EDGE_SHARES = np.array([0.0, 0.5, 1.0])
"""Shares of the window's first and last element at which no limit may act."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ConstrainedMotion(ConstrainedTrajectory):
    """A plan of `constrained_redesign` for the nonlinear motion of a plant.

    Its `optimality` holds for motions near by: by the conditions of Karush, Kuhn and Tucker along the motion.

    Args:
        iterations: every step, those of Gauss-Newton's method without the limits first.
        steady: x_rest(t) and u_rest(t), from which departures cost.
    """

    iterations: tuple[GaussNewtonStep, ...]
    steady: Plan

    def departures(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Samples:
        """Values at times t (m,) [s] as what costs: x - x_rest, u - u_rest, and outputs, planned and wanted, from those at rest."""
        return departures_from(self.steady, self(t, inside=inside), inside)


def redesign_motion_within(
    mechanism: Mechanism,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike,
    Q_y: ArrayLike,
    limits: Limits,
    step: float | None,
    schedule: Sequence[ScheduledChange],
    accuracy: float,
    hold: float | None,
    tolerance: float,
    reach: tuple[float | None, float | None],
) -> ConstrainedMotion:
    """The motion of a mechanism that costs least within limits; see `invtrack.constrained_redesign`.

    Args:
        mechanism, reference, R, Q_x, Q_y, schedule, accuracy, hold, tolerance: see `redesign_motion`.
        limits: what the plan must never exceed.
        step: longest time over which the input is linear [s], or None.
        reach: longest preactuation and postactuation [s].
    """
    solver, unit = least_cost_motion(
        mechanism, reference, R=R, Q_x=Q_x, Q_y=Q_y, schedule=schedule, accuracy=accuracy, hold=hold, tolerance=tolerance
    )
    bounds = bounds_of(limits, solver.problem.model(solver.problem.stops))
    limited_rates = any(bound.kind == "input rate" for bound in bounds)
    if hold is not None and limited_rates:
        raise RedesignError(
            "a limit on an input's rate cannot be kept by inputs that jump from hold to hold; leave out hold, or the limit"
        )
    free = solver.solve()
    edges, (begin, end) = free.motions.mesh.edges, solver.problem.manoeuvre
    model = solver.problem.model(edges)
    bounds = bounds_of(limits, model)
    trajectory = trajectory_of(free.motions, free.course.motion, model, tails_of(free.motions, free.course, model))
    require_rest_within((trajectory.before, trajectory.after), bounds)
    if not limited_rates and _excess(trajectory, bounds) <= KEPT:
        remark = "no limit is active: this is the optimum without limits"
        return plan_of(
            ConstrainedMotion,
            METHOD,
            solver,
            free.motions,
            free.course,
            tolerance=tolerance,
            reach=reach,
            remarks=(remark,),
            limits=bounds,
            iterations=free.log,
            steady=solver.rest.steady,
        )
    point = model.operating_point
    task = LimitedMotion(solver, free, bounds, (np.asarray(point.u0), np.asarray(point.y0)), step)
    margins = (begin - float(edges[0]), float(edges[-1]) - end)
    for _ in range(MOST_WIDENINGS):
        found = task.solve(margins)
        model = solver.problem.model(found.motions.mesh.edges)
        task = replace(task, bounds=bounds_of(limits, model))  # the rest in force changes at an edge of the mesh
        trajectory = trajectory_of(found.motions, found.course.motion, model, tails_of(found.motions, found.course, model))
        wider = _widened(margins, trajectory, task.bounds)
        if wider == margins:
            return _plan(task, found, trajectory, unit=unit, tolerance=tolerance, reach=reach)
        margins = wider
    raise RedesignError(
        f"limits act further and further from the manoeuvre: with {margins[0]:.4g} s before it and {margins[1]:.4g} s after it one "
        "still acts at the window's end; loosen it, or ask for a smaller or slower motion"
    )


def _plan(
    task: LimitedMotion,
    found: LimitedOptimum,
    trajectory: Trajectory,
    *,
    unit: float,
    tolerance: float,
    reach: tuple[float | None, float | None],
) -> ConstrainedMotion:
    """The plan for the motion within limits.

    Args:
        task, found, trajectory: what was asked for, and the motion that was found.
        unit: of its cost.
        tolerance, reach: see `redesign_motion_within`.
    """
    overshoot = max(0.0, float(np.max(worst_within_steps(trajectory, task.bounds)[0])))
    if overshoot > OVERSHOOT:
        raise RedesignError(
            f"a limit is exceeded by {overshoot:.1e} of its size between the instants at which it is imposed, more than "
            f"{OVERSHOOT:.0e}; take a smaller step, or a shorter hold"
        )
    step = float(np.max(found.motions.mesh.lengths))
    active = active_limits(trajectory, task.bounds, found.rows, found.multipliers * unit)
    what = "linear in time over" if task.solver.hold is None else "constant over"
    remarks = (
        f"the input is {what} {len(found.motions.mesh)} steps of up to {step:.4g} s",
        *map(str, active),
        *([f"a limit is exceeded by {overshoot:.1e} of it between steps"] if overshoot > KEPT else []),
    )
    return plan_of(
        ConstrainedMotion,
        METHOD,
        task.solver,
        found.motions,
        found.course,
        tolerance=tolerance,
        reach=reach,
        remarks=remarks,
        limits=tuple(task.bounds),
        active=active,
        overshoot=overshoot,
        step=step,
        optimality=replace(found.optimality, cost=found.optimality.cost * unit),
        iterations=found.log,
        steady=task.solver.rest.steady,
    )


def _excess(trajectory: Trajectory, bounds: Sequence[Bound]) -> float:
    """Largest excess of a limit by a trajectory, as a share of the limit's size."""
    tails = (float(np.max(tail_excess(tail, bounds))) for tail in (trajectory.before, trajectory.after))
    return max(float(np.max(worst_within_steps(trajectory, bounds)[0])), *tails)


def _widened(margins: tuple[float, float], trajectory: Trajectory, bounds: Sequence[Bound]) -> tuple[float, float]:
    """Twice the time [s] on each side on which a limit is exceeded in the tail, or acts in the window's element beside it."""
    inner, wider = values_between(trajectory, bounds, EDGE_SHARES)[:, [0, -1]], []
    for side, (margin, tail) in enumerate(zip(margins, (trajectory.before, trajectory.after), strict=True)):
        beyond = float(np.max(tail_excess(tail, bounds)))
        beside = max(float(np.max(bound.excess(value[side]))) for bound, value in zip(bounds, inner, strict=True))
        wider.append(2 * margin if beyond > KEPT or beside > -SNAP else margin)
    return wider[0], wider[1]
