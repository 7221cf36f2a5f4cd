"""The modified motion of a Plant that makes the best of what can be afforded, in few plans: each one takes seconds."""

from __future__ import annotations

import math
from collections.abc import Callable

from invtrack.errors import InversionError
from invtrack.inversion.modified.modified_motion import TIME_CONSTANTS
from invtrack.inversion.modified.modified_plan import ModifiedPlan
from invtrack.plans.actuation import plan_actuation_time

CLOSE = 0.01
"""An error counts as used to the full from this share of it below."""

NARROW = 1e-3
"""Width of the bracket, as a share of the time for which outputs are bent, at which the search ends."""

MOST_PLANS = 20
"""Plans that are worked out, at most."""

Planned = Callable[[float], ModifiedPlan]
"""From the real part of the moved zeros [rad/s] to the plan."""


def motion_within_preactuation(plan: Planned, limits: tuple[float, float], wish: float, level: float) -> ModifiedPlan:
    """The plan whose outputs are bent from `wish` [s] before the manoeuvre on, or from as early as the least real part says.

    Args:
        plan: from the real part to the plan.
        limits: least and largest real part [rad/s].
        wish: how long before the manoeuvre the input may be away from rest by more than `level` of its peak [s].
        level: see there.

    Raises InversionError where the input acts earlier.
    """
    found = plan(min(max(TIME_CONSTANTS / wish, limits[0]), limits[1]))
    reached = plan_actuation_time(found, "before", level)
    if reached > wish:
        raise InversionError(
            f"a preactuation [s] of {wish:.4g} cannot be reached with real parts of the moved zeros from {limits[0]:.4g} to "
            f"{limits[1]:.4g} rad/s: the input acts for {reached:.4g} s; move farther, or further zeros that act before the "
            "manoeuvre"
        )
    return found


def motion_within_error(plan: Planned, limits: tuple[float, float], wish: float) -> ModifiedPlan:
    """The plan whose outputs are bent for the shortest time with which no error is larger than `wish`.

    Errors fall with that time, most like an exponential for real zeros: false position on their logarithm, in the variant that
    does not stall (M. Dowell, P. Jarratt, "A modified regula falsi method", BIT 11, 1971), inside a bracket that is widened by
    factors of 2, 4, 16, ...

    Args:
        plan: from the real part to the plan.
        limits: least and largest real part [rad/s].
        wish: largest error, as a share of each output's scale.

    Raises InversionError where the longest time does not suffice.
    """
    shortest, longest = TIME_CONSTANTS / limits[1], TIME_CONSTANTS / limits[0]
    best: ModifiedPlan | None = None
    ends: dict[bool, tuple[float, float]] = {}  # of the bracket, by whether they keep to the wish: times and excesses
    time, last, factor = math.sqrt(shortest * longest), None, 2.0
    for _ in range(MOST_PLANS):
        found = plan(TIME_CONSTANTS / time)
        excess = math.log(max(found.relative_error, math.ulp(0.0)) / wish) + CLOSE / 2
        kept = found.relative_error <= wish
        if not kept and time >= longest:
            raise InversionError(
                f"an error of {wish:.4g} cannot be reached with real parts of the moved zeros from {limits[0]:.4g} to "
                f"{limits[1]:.4g} rad/s: the best is {found.relative_error:.4g}, at {limits[0]:.4g} rad/s; ask for that, or for "
                "a slower reference"
            )
        if kept:
            best = found
            if excess >= -CLOSE / 2 or time <= shortest:
                break
        ends[kept] = (time, excess)
        if len(ends) < 2:
            time, factor = max(shortest, time / factor) if kept else min(longest, factor * time), factor**2
            continue
        if last == kept:  # the other end has stayed: its excess counts half
            ends[not kept] = (ends[not kept][0], ends[not kept][1] / 2)
        last = kept
        (a, f_a), (b, f_b) = ends[True], ends[False]
        if a - b <= NARROW * a:
            break
        time = a - f_a * (a - b) / (f_a - f_b)
    assert best is not None  # some factors of the bracket are beyond all numbers
    return best
