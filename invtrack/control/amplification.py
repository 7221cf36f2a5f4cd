"""By how much feedback lets departures from a plan grow on the way."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy.linalg

from invtrack.arguments import instance
from invtrack.arrays import Array
from invtrack.control.gains import GainSchedule
from invtrack.errors import ControlError
from invtrack.linear.state_sizes import comparable_size, unit_ratios
from invtrack.plans.linearizations import Linearizations
from invtrack.plans.plan import Plan, require_plan

PARTS = 200
"""Times between which departures are followed: from each to each later one."""


def amplification(plan: Plan, gains: GainSchedule) -> float:
    """Largest norm of Phi(t, s), s <= t, along a plan: d(t) = Phi(t, s) d(s) for d' = (A(t) - B(t) K(t)) d.

    States count as shares of their peaks along the plan, so that the norm has no unit; s and t are the ends of some 200 parts of
    equally many stretches of the plan. Feedback designed about one end of a long motion may stabilize the plant at every
    instant, and yet let a departure grow by orders of magnitude on the way: small errors of the model become as much larger.

    plan: of any method. gains: of its shape, such as `lqr(plan, ...)`.

    Raises PlanError and ControlError for what is neither.
    """
    require_plan(plan)
    instance("gains", gains, GainSchedule, expected="a GainSchedule, such as invtrack.lqr(plan, Q=1.0, R=1.0)", error=ControlError)
    shape = (plan.model.n_inputs, plan.model.n_states)
    if gains.gains[0].shape != shape:
        raise ControlError(f"gains have shape {gains.gains[0].shape}, expected {shape} for this plan's inputs and states")
    along = plan.linearizations or _of_the_model(plan)
    size = comparable_size(plan.trajectory.peaks[: plan.model.n_states], unit_ratios(plan.model))
    size = np.where(size > 0, size, 1.0)
    K = np.stack(gains.gains)[gains.interval(along.middles)]
    rates = (along.A - along.B @ K) * size / size[:, None]
    edges = np.unique(np.linspace(0, len(along), min(PARTS, len(along)) + 1).astype(int))
    parts = [_product(scipy.linalg.expm(rates[a:b] * along.lengths[a:b, None, None])) for a, b in pairwise(edges.tolist())]
    largest, begun = 1.0, np.empty((0, shape[1], shape[1]))
    with np.errstate(over="ignore", invalid="ignore"):
        for part in parts:
            begun = part @ np.concatenate([begun, np.eye(shape[1])[None]])
            if not np.all(np.isfinite(begun)):
                return float("inf")
            largest = max(largest, float(np.max(np.linalg.norm(begun, ord=2, axis=(1, 2)))))
    return largest


def _product(transitions: Array) -> Array:
    """The transition through all of these (k, n, n), the first one first."""
    result = np.eye(transitions.shape[1])
    with np.errstate(over="ignore", invalid="ignore"):
        for transition in transitions:
            result = transition @ result
    return result


def _of_the_model(plan: Plan) -> Linearizations:
    """The plan's own model on even parts of each interval, from the start to the end of the plan."""
    stops = np.unique(np.concatenate([[plan.start], plan.model.switch_times, [plan.end]]))
    stops = stops[(stops >= plan.start) & (stops <= plan.end)]
    span = stops[-1] - stops[0]
    pieces = [np.linspace(a, b, int(np.ceil(PARTS * (b - a) / span)) + 1)[:-1] for a, b in pairwise(stops.tolist())]
    edges = np.append(np.concatenate(pieces), stops[-1])
    systems = [plan.model.systems[k] for k in plan.model.interval((edges[:-1] + edges[1:]) / 2)]
    return Linearizations(edges, np.stack([system.A for system in systems]), np.stack([system.B for system in systems]))
