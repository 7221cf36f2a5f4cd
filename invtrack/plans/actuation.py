"""How long a plan's input acts before and after its manoeuvre, counted from rest, by its envelope."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray, require_share
from invtrack.errors import TrajectoryError
from invtrack.plans.input_tail import InputTail, input_tail
from invtrack.plans.plan import Plan, dense_times, require_plan
from invtrack.plans.preactuation import tail_bound
from invtrack.plans.ringing import LEVEL, Ringing
from invtrack.plans.tail import SIDES, Side

CLOSE_UP, SAMPLES_CLOSE_UP = 3, 4000
"""Turns of the slowest mode in which the last time above a level is looked for again, and points there."""

LIGHTLY_DAMPED = 0.1
"""Damping ratio below which a mode is said to ring."""


def plan_actuation_time(plan: Plan, side: Side, level: float = LEVEL) -> float:
    """How long [s] before or after its manoeuvre a plan's input is away from rest by more than `level` of its peak; 0 if never.

    From the first time on at which |u - u_rest| exceeds that (before), until the last (after): the envelope counts, for an input
    that oscillates passes through rest all the time. u_rest is the input at rest on that side, |.| the Euclidean norm over the
    inputs, the peak that of |u - u_rest| over the whole plan. Counted on all of time, on which the plan is defined, whatever its
    start and end; infinite where the input never comes to rest.

    Raises TrajectoryError for a level outside 0 ... 1, or a plan whose reference moves there for ever.
    """
    require_plan(plan)
    require_share("level, a share of the peak input such as 0.01,", level, error=TrajectoryError)
    tail = input_tail(plan, side)
    limit = level * peak_departure(plan, side)
    T = plan.manoeuvre[0 if side == "before" else 1]
    sign = -1.0 if side == "before" else 1.0
    reach = _reach(tail, limit)
    if reach is not None:
        return sign * (tail.edge - T) + reach
    edges = plan.breakpoints
    outside = edges < T if side == "before" else edges > T
    return _outermost(plan, np.append(edges[outside], T), limit, sign) if np.any(outside) else 0.0


def peak_departure(plan: Plan, side: Side) -> float:
    """Largest |u - u_rest| of a plan, in the Euclidean norm over the inputs, from its rest on one side."""
    times, inside = dense_times(plan.breakpoints)
    samples = [plan.inputs(times, inside=inside)]
    for end, rest, sign in zip(SIDES, plan.rest_inputs, (-1.0, 1.0), strict=True):
        tail = None if np.any(np.isnan(rest)) else input_tail(plan, end)
        if tail:
            horizon = 10.0 / tail.slowest if tail.slowest > 0 else 20 * np.pi / float(np.max(np.abs(tail.rates)))
            sigma = tail.distances(horizon)
            samples.append(plan.inputs(tail.edge + sign * sigma, inside=np.full(len(sigma), tail.edge + sign)))
    return float(np.max(np.linalg.norm(np.concatenate(samples) - plan.rest_inputs[0 if side == "before" else 1], axis=1)))


def ringing(plan: Plan) -> Ringing | None:
    """What lightly damped modes make of the input after the manoeuvre, where that is more than 1 % of its peak there."""
    after = plan.trajectory.after
    if not after.departs or not np.any(_light(after.departure.eigenvalues)) or np.any(np.isnan(plan.rest_inputs[1])):
        return None
    tail = input_tail(plan, "after")
    light = _light(tail.rates)
    if not np.any(light) or tail.slowest <= 0:
        return None
    peak = peak_departure(plan, "after")
    share = tail.amplitude(light) / peak
    if share <= LEVEL:
        return None
    heard = light & (np.linalg.norm(tail.shares, axis=0) > LEVEL * peak / np.sum(light))
    rates = tail.rates[heard]
    rate = rates[np.argmax(rates.real)]
    return Ringing(float(abs(rate)), float(-rate.real / abs(rate)), share, plan_actuation_time(plan, "after"))


def _light(rates: ComplexArray) -> NDArray[np.bool_]:
    """Which modes (k,) oscillate with little damping."""
    return np.asarray((-rates.real < LIGHTLY_DAMPED * np.abs(rates)) & (rates.imag != 0))


def _reach(tail: InputTail, limit: float) -> float | None:
    """Distance [s] from the edge beyond which the tail stays below the limit; None where it always does."""
    if not tail:
        return None
    if tail.slowest <= 0:
        return math.inf
    alpha, M, _ = tail_bound(tail)
    if limit >= M:
        return None
    horizon = math.log(M / limit) / alpha
    sigma = tail.distances(horizon)
    above = np.flatnonzero(tail.size(sigma) > limit)
    if not above.size:
        return None
    # Close up: of a slowly decaying oscillation the samples may have missed the last tips that pass the limit.
    turns = CLOSE_UP * 2 * np.pi / float(np.min(np.abs(tail.rates)))
    start = float(sigma[above[-1]])
    sigma = np.linspace(start, start + max(min(horizon - start, turns), float(sigma[1])), SAMPLES_CLOSE_UP)
    last = int(np.flatnonzero(tail.size(sigma) > limit)[-1]) if tail.size(sigma[:1])[0] > limit else 0
    if last == len(sigma) - 1:
        return float(sigma[-1])
    return _crossing(lambda s: float(tail.size(np.array([s]))[0]) - limit, float(sigma[last]), float(sigma[last + 1]))


def _outermost(plan: Plan, edges: Array, limit: float, sign: float) -> float:
    """Distance [s] from the manoeuvre at which the input was first, or last, above the limit between edges outside of it; or 0."""
    edges = np.sort(edges)
    times, inside = dense_times(edges)

    def size(t: Array, within: Array) -> Array:
        return np.asarray(np.linalg.norm(plan.inputs(t, inside=within) - plan.rest_inputs[0 if sign < 0 else 1], axis=1))

    above = np.flatnonzero(size(times, inside) > limit)
    if not above.size:
        return 0.0
    T = edges[-1] if sign < 0 else edges[0]
    at = int(above[0] if sign < 0 else above[-1])
    beyond = at + int(sign)
    if not 0 <= beyond < len(times) or inside[beyond] != inside[at]:
        return float(sign * (times[at] - T))
    within = inside[at : at + 1]
    crossing = _crossing(lambda t: float(size(np.array([t]), within)[0]) - limit, float(times[at]), float(times[beyond]))
    return float(sign * (crossing - T))


def _crossing(excess: Callable[[float], float], above: float, below: float) -> float:
    """Where the excess vanishes between two points, one above and one below the limit."""
    if excess(above) <= 0 or excess(below) >= 0:  # it lies on one of the two, to within rounding
        return min(above, below, key=lambda s: abs(excess(s)))
    return float(scipy.optimize.brentq(excess, above, below))
