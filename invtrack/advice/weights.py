"""Weights of a redesign with which it takes of the acceptable error what it may, and no more."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from invtrack.advice.program import rounded
from invtrack.advice.task import Task
from invtrack.arrays import Array
from invtrack.errors import InvtrackError, RedesignError
from invtrack.plans.plan import Plan
from invtrack.redesign import quadratic_redesign

ROOM = 0.95
"""Share of the acceptable error that a plan's own error may take: the rest is left to the feedback."""

PER_DECADE = 10
"""Weights that are looked at in a decade, so that the same ones are found wherever a search begins."""

LEAST, MOST = -12 * PER_DECADE, 6 * PER_DECADE
"""Between which an input as large as the motion takes is made as dear as an error as large as the motion, in these steps."""

STRIDE = 3 * PER_DECADE
"""Steps by which the search moves at most."""

SLOPE = 0.5
"""What the logarithm of the error is expected to grow by with that of the weight, where no two weights have shown it."""

CLOSE = 0.25
"""Decades by which a redesign on the motion may give up less than it might before its weights are taken for others."""

SAMPLES = 901
"""Instants at which a plan's error is looked at."""


def planned_error(task: Task, plan: Plan) -> float:
    """Largest |y - y_d| of a plan over the motion and as long before and after it, as a share of each output's motion."""
    T_i, T_f = plan.manoeuvre
    samples = plan(np.linspace(T_i - task.duration, T_f + task.duration, SAMPLES))
    return float(np.max(np.abs(samples.y - samples.y_d) / task.motion))


def redesign_weights(
    task: Task, reference: Any, known: dict[int, float], *, share: float, guess: int | None = None, **options: Any
) -> tuple[int, dict[str, Any]]:
    """The dearest input there is room for: with it the planned error is at most ROOM of this share of the motion.

    Each input counts by its size in such a motion, each output by its motion; looked for is the one number between the two, on a
    grid of PER_DECADE numbers a decade, by secants of the error's logarithm within a bracket. Returned are its number on the grid,
    R and Q_y.
    known: the logarithm of the error by numbers on the grid, as far as earlier searches for this reference found it; grows.
    guess: the number with which to begin where nothing is known.
    options: further ones of `quadratic_redesign`.

    Raises RedesignError where no weight brings the error below, and what `quadratic_redesign` raises.
    """
    most = math.log10(ROOM * share)
    begin = round(PER_DECADE * (math.log10(share) - 3.0)) if guess is None else guess
    refused: dict[int, InvtrackError] = {}
    while (number := _next(known, refused, most, begin)) is not None:
        try:
            plan = quadratic_redesign(task.model, reference, **weights(task, number), **options)
            known[number] = math.log10(max(planned_error(task, plan), np.finfo(float).tiny))
        except InvtrackError as refusal:  # inputs so cheap that rounding hides the plan: only dearer ones are left
            refused[number] = refusal
    good = [number for number, error in known.items() if error <= most]
    if good:
        return max(good), weights(task, max(good))
    if refused and not known:
        raise refused[max(refused)]
    raise RedesignError(
        f"no weights bring the planned error to {100 * ROOM * share:.3g} % of the motion; with inputs as cheap as was tried it is "
        f"{100 * 10 ** known[min(known)]:.3g} %; allow a larger error, or a smoother or longer motion"
    )


def corrected(number: int, error: float, *, share: float) -> int:
    """The weights for a plan on the motion of a mechanism, where those that a linear model found make it miss by `error`.

    The error grows about as the root of the weight. The same number where the error is what may be given up, or a little less.
    """
    beyond = math.log10(max(error, np.finfo(float).tiny) / (ROOM * share))
    return number if -CLOSE < beyond <= 0 else number - math.ceil(2 * PER_DECADE * beyond)


def _next(known: Mapping[int, float], refused: Mapping[int, InvtrackError], most: float, begin: int) -> int | None:
    """The next weight to try; None where the dearest with an error of at most this logarithm is known, or is known not to be."""
    good = max((number for number, error in known.items() if error <= most), default=None)
    low = max([LEAST - 1, *refused, *([] if good is None else [good])])
    high = min((number for number, error in known.items() if error > most and number > low), default=MOST + 1)
    if high - low <= 1:
        return None
    if not known:
        return begin if low < begin < high else _between(low, high, refused)
    (at, error), *others = sorted(known.items(), key=lambda point: abs(point[1] - most))[:2]
    slope = SLOPE / PER_DECADE
    if others and others[0][0] != at:
        slope = (others[0][1] - error) / (others[0][0] - at)
    if not slope > SLOPE / PER_DECADE / 10:
        slope = SLOPE / PER_DECADE
    step = float(np.clip((most - error) / slope, -STRIDE, STRIDE))
    following = math.floor(at + step)
    return min(max(following, low + 1), high - 1)


def _between(low: int, high: int, refused: Mapping[int, InvtrackError]) -> int:
    """The middle, nearer to what was refused than to the end of what is looked at."""
    return (low + high) // 2 if not refused else min(low + STRIDE // 2, high - 1)


def weights(task: Task, number: int) -> dict[str, Any]:
    """R and Q_y: an input of the size that the motion takes costs 10^(number / PER_DECADE) times what an error of its size does."""
    _, u = task.sizes
    return {"R": _diagonal(10 ** (number / PER_DECADE) / u**2), "Q_y": _diagonal(1 / task.motion**2)}


def _diagonal(values: Array) -> Any:
    values = rounded(values)
    return values[0] if len(values) == 1 else np.diag(values).tolist()
