"""The trade between preactuation and tracking error of a modified inverse: as a table, and solved for what can be afforded."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from invtrack.arrays import Array, ComplexArray, complex_numbers, real_number, real_numbers, shown
from invtrack.errors import InversionError
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.modified.modified_motion import ModifiedMotion
from invtrack.inversion.modified.modified_plan import ModifiedPlan
from invtrack.inversion.modified.motion_planner import motion_planner
from invtrack.inversion.modified.moved_zeros import Wish, intervals_named
from invtrack.inversion.modified.trade_off import TradeOff, TradeOffPoint
from invtrack.inversion.modified.tuned_motion import motion_within_error, motion_within_preactuation
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.switched import as_switched
from invtrack.linear.zeros import zeros
from invtrack.plans.actuation import plan_actuation_time
from invtrack.plans.dynamics import mechanism
from invtrack.references.signal import PiecewiseSignal

SCAN = 9
"""Real parts, evenly spaced in the logarithm, among which a bracket is looked for."""

BISECTIONS = 12
"""Halvings of the bracket at most."""

CLOSE = 0.005
"""A wish counts as met to the point where what is reached is within this share of it."""

NARROW = 1e-3
"""Width of the bracket, in the logarithm of the real part, at which the search ends."""

NEAREST = 1e-3
"""Nearest to the axis, as a share of its magnitude, that a zero on the axis is put."""

FARTHEST = 10.0
"""Farthest that zeros are moved, in units of the magnitude of the largest of them."""

LONGER = 5.0
"""A Plant's outputs are bent for as long as its own zeros take to die out to 1 %, times this, at most: what is left is 1e-10."""


def preactuation_trade_off(
    model: Any,
    reference: PiecewiseSignal,
    *,
    real_parts: Sequence[float],
    error_poles: Sequence[complex] | None = None,
    axis_distance: float | None = None,
    zeros: Sequence[complex] | None = None,
    level: float = 0.01,
    **options: Any,
) -> TradeOff:
    """What each of `real_parts` [rad/s] for the offending zeros costs in tracking error and gains in preactuation.

    Args:
        model, reference, error_poles, options: as for `modified_inversion`, which is worked out once per real part.
        real_parts: where the zeros are moved, one real part after another; their imaginary parts stay.
        axis_distance: the zeros moved are those with |Re| up to this [rad/s].
        zeros: or they are the ones named here [rad/s], conjugates implied; their imaginary parts are then those written here.
        level: share of the peak input from which on the preactuation counts.

    Raises InversionError for neither or both of axis_distance and zeros, without real parts, and as `modified_inversion` does.
    """
    values = np.ravel(real_numbers("real_parts [rad/s]", real_parts, error=InversionError))
    if not values.size:
        raise InversionError("expected at least one entry in real_parts [rad/s], got none")
    plan, moved = _planner(model, reference, axis_distance, zeros, error_poles=error_poles, **options)
    return TradeOff(tuple(_point(float(a), plan(float(a)), level) for a in values), level, tuple(complex(z) for z in moved))


def tune_modified_inversion(
    model: Any,
    reference: PiecewiseSignal,
    *,
    error_poles: Sequence[complex] | None = None,
    preactuation: float | None = None,
    error: float | None = None,
    axis_distance: float | None = None,
    zeros: Sequence[complex] | None = None,
    real_parts: tuple[float, float] | None = None,
    level: float = 0.01,
    **options: Any,
) -> ModifiedPlan:
    """The modified inverse that makes the best of what can be afforded, by a bracketed search on the real part of the moved zeros.

    What can be afforded is either a preactuation or an error. A Plant's outputs are bent from as long before the manoeuvre as the
    preactuation says, or for the shortest time that the error allows, in as few plans as need be.

    Args:
        model, reference, error_poles, options: as for `modified_inversion`.
        preactuation: how long before the manoeuvre the input may be above `level` of its peak [s]. The least real part that keeps
            to it is taken, so the least error (an input that oscillates gets above the level half a period earlier or later, so
            part of the time may be left unused).
        error: largest error, as a share of each output's scale. The largest real part that keeps to it is taken, so the shortest
            preactuation.
        axis_distance, zeros, level: as for `preactuation_trade_off`.
        real_parts: least and largest real part tried [rad/s]; by default from where the zeros are (or 1e-3 of their magnitude) to
            ten times their magnitude, for a Plant from a fifth of that.

    Raises InversionError for not exactly one wish, and for one that cannot be met, with the best that can be reached.
    """
    wishes = [wish for wish in (preactuation, error) if wish is not None]
    if len(wishes) != 1 or not real_number("what can be afforded", wishes[0], error=InversionError) > 0:
        raise InversionError(
            f"expected a positive preactuation [s] or error, got preactuation={shown(preactuation)}, error={shown(error)}"
        )
    plan, moved = _planner(model, reference, axis_distance, zeros, error_poles=error_poles, **options)
    bent = mechanism(model) is not None
    given = _range(moved, LONGER if bent else 1.0) if real_parts is None else real_parts
    limits = real_numbers("real_parts [rad/s]", given, error=InversionError)
    if limits.shape != (2,) or not 0 < limits[0] < limits[1] < np.inf:
        raise InversionError(f"real_parts must be two positive numbers that increase, got {real_parts}")
    low, high = (float(limit) for limit in limits)
    if bent:
        if preactuation is not None:
            return motion_within_preactuation(plan, (low, high), preactuation, level)
        return motion_within_error(plan, (low, high), float(error or 0.0))
    scan = np.geomspace(low, high, SCAN)
    if preactuation is not None:
        return _first_within(plan, scan, partial(plan_actuation_time, side="before", level=level), preactuation, "preactuation [s]")
    return _first_within(plan, scan, lambda plan: plan.relative_error, float(error or 0.0), "error", rising=True)


def _first_within(
    plan: Callable[[float], ModifiedPlan],
    scan: Array,
    measure: Callable[[ModifiedPlan], float],
    wish: float,
    name: str,
    *,
    rising: bool = False,
) -> ModifiedPlan:
    """Along `scan`, the first plan whose measure is within the wish; or if it is `rising`, the last before it is not."""
    tried: list[tuple[float, float, ModifiedPlan]] = []
    for real_part in scan:
        found = plan(float(real_part))
        tried.append((float(real_part), measure(found), found))
        if (tried[-1][1] <= wish) != rising:
            break
    met = [entry for entry in tried if entry[1] <= wish]
    if not met:
        best = min(tried, key=lambda entry: entry[1])
        raise InversionError(
            f"a {name} of {wish:.4g} cannot be reached with real parts of the moved zeros from {scan[0]:.4g} to {scan[-1]:.4g} "
            f"rad/s: the best is {best[1]:.4g}, at {best[0]:.4g} rad/s; ask for that, choose faster error_poles, or a slower "
            "reference"
        )
    missed = [entry for entry in tried if entry[1] > wish]
    good, bad = met[-1], missed[-1] if missed else None
    for _ in range(BISECTIONS if bad else 0):
        # Where an input oscillates, its preactuation jumps by half a period: no plan may lie any closer to the wish.
        if bad is None or good[1] >= (1 - CLOSE) * wish or abs(np.log(good[0] / bad[0])) <= NARROW:
            break
        real_part = float(np.sqrt(good[0] * bad[0]))
        found = plan(real_part)
        entry = (real_part, measure(found), found)
        good, bad = (entry, bad) if entry[1] <= wish else (good, entry)
    return good[2]


def _planner(
    model: Any, reference: PiecewiseSignal, axis_distance: float | None, named: Sequence[complex] | None, **options: Any
) -> tuple[Callable[[float], ModifiedPlan], ComplexArray]:
    """The modified inverse as a function of the real part, and the zeros that it moves."""
    names = np.zeros(0, dtype=complex) if named is None else np.ravel(complex_numbers("zeros", named, error=InversionError))
    if (axis_distance is None) == (not names.size):
        raise InversionError(f"expected either axis_distance=... or zeros=[...], got axis_distance={axis_distance}, zeros={named}")
    searched = sorted({"move", "real_part"} & options.keys())
    if searched:
        raise InversionError(
            f"{' and '.join(searched)} cannot be given: where the zeros go is what is varied; say which they are by "
            "axis_distance or zeros"
        )
    present, planned = _of_motions(model, reference, **options) if mechanism(model) else _of_models(model, reference, **options)

    def wish(real_part: float) -> Wish:
        return Wish(_moves(names, real_part), None, None) if names.size else Wish(None, axis_distance, real_part)

    elsewhere = wish(1.0 + 2 * float(np.max(np.abs(present), initial=0.0)))
    elsewhere.require_known(present)
    moved = present[elsewhere.targets(present)[0]]
    if not moved.size:
        raise InversionError(
            f"no zeros within {axis_distance} rad/s of the imaginary axis; the zeros are {format_zeros(present) or 'none'}"
        )
    return lambda real_part: planned(wish(real_part)), moved


Planned = Callable[[Wish], ModifiedPlan]


def _of_models(model: Any, reference: PiecewiseSignal, **options: Any) -> tuple[ComplexArray, Planned]:
    """The zeros of a linear model in all intervals in which they are moved, and the plan as a function of the wish."""
    plant = as_switched(model)
    present = np.unique(np.concatenate([zeros(plant.systems[k]) for k in intervals_named(options.get("interval"), len(plant))]))

    def planned(wish: Wish) -> ModifiedPlan:
        return modified_inversion(
            plant, reference, move=wish.move, axis_distance=wish.axis_distance, real_part=wish.real_part, **options
        )

    return present, planned


def _of_motions(model: Any, reference: PiecewiseSignal, **options: Any) -> tuple[ComplexArray, Planned]:
    """The same for a Plant, whose zeros are those of the start; what its plans have in common is worked out once."""
    moving = mechanism(model)
    assert moving is not None  # as the caller knows
    problem, planned = motion_planner(moving, reference, **options)
    return problem.internals[0].zeros, planned


def _moves(names: ComplexArray, real_part: float) -> dict[complex, complex]:
    return {complex(z): complex(real_part, z.imag) for z in names}


def _range(moved: ComplexArray, longer: float) -> tuple[float, float]:
    return float(np.max(np.maximum(moved.real, NEAREST * np.abs(moved)))) / longer, FARTHEST * float(np.max(np.abs(moved)))


def _point(real_part: float, plan: ModifiedPlan, level: float) -> TradeOffPoint:
    preactuation = plan_actuation_time(plan, "before", level)
    at_rest = plan.manoeuvre[0] - max(preactuation, 0.0)
    bound = plan.error_bound_from(min(at_rest, plan.window[0]) if isinstance(plan, ModifiedMotion) else at_rest)
    return TradeOffPoint(
        real_part=real_part,
        alpha=plan.alpha,
        preactuation=preactuation,
        max_error=plan.relative_error,
        error_bound=np.nan if bound is None else bound,
        error_after=float(np.max(plan.max_error_after / plan.output_scale)),
        peak_input=float(np.max(np.abs(plan.input_range))),
    )
