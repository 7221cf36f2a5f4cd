"""Weights of a redesign with which it takes of the acceptable error what it may, and no more."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from invtrack.advice.program import rounded
from invtrack.advice.task import Task
from invtrack.arrays import Array
from invtrack.errors import InvtrackError, RedesignError
from invtrack.plans.plan import Plan
from invtrack.redesign import quadratic_redesign

AIM = (0.8, 0.95)
"""Shares of the acceptable error between which a plan's own error is to lie: the rest is left to the feedback."""

LEAST, MOST = -12.0, 6.0
"""Decades between which an input as large as the motion takes is made as dear as an error as large as the motion."""

STRIDE = 3.0
"""Decades by which the search moves at most."""

SAMPLES = 901
"""Instants at which a plan's error is looked at."""

STEPS = 30
"""Weights that are tried at most."""


def planned_error(task: Task, plan: Plan) -> float:
    """Largest |y - y_d| of a plan over the motion and as long before and after it, as a share of each output's motion."""
    T_i, T_f = plan.manoeuvre
    samples = plan(np.linspace(T_i - task.duration, T_f + task.duration, SAMPLES))
    return float(np.max(np.abs(samples.y - samples.y_d) / task.motion))


def redesign_weights(
    task: Task, reference: Any, known: dict[float, float], *, guess: float, aim: tuple[float, float] = AIM, **options: Any
) -> tuple[float, dict[str, Any]]:
    """The dearest input there is room for: with it the planned error lies between shares `aim` of the acceptable one.

    Each input counts by its size in such a motion, each output by its motion; looked for is the one number between the two, its
    decade, by secants of the error's logarithm within a bracket. Returned are that decade, R and Q_y.
    known: the logarithm of the error by decades, as far as earlier searches for this reference found it; grows.
    guess: the decade with which to begin where nothing is known.
    options: further ones of `quadratic_redesign`.

    Raises RedesignError where no weight brings the error below, and what `quadratic_redesign` raises.
    """
    low, high = (math.log10(share * task.error) for share in aim)
    target = (low + high) / 2
    cheap = max((decade for decade, found in known.items() if found <= high), default=LEAST)
    dear = min((decade for decade, found in known.items() if found > high), default=MOST)
    tried = sorted(known.items(), key=lambda point: -abs(point[1] - target))
    decade = _next(tried, target, cheap, dear) if tried else guess
    best = (cheap, weights(task, cheap)) if cheap in known else None
    refusal: InvtrackError | None = None
    for _ in range(STEPS):
        chosen = weights(task, decade)
        try:
            error = planned_error(task, quadratic_redesign(task.model, reference, **chosen, **options))
        except InvtrackError as refused:  # inputs so cheap that rounding hides the plan: only dearer ones are left
            refusal, cheap = refused, decade
            if decade >= min(dear, MOST) - STRIDE / 10:
                break
            decade = min(decade + STRIDE / 2, (decade + dear) / 2)
            continue
        found = math.log10(max(error, np.finfo(float).tiny))
        if found <= high:
            cheap, best = decade, (decade, chosen)
            if found >= low:
                return decade, chosen
        else:
            dear = decade
        known[decade] = found
        tried.append((decade, found))
        if dear - cheap < 1e-3 or decade in (LEAST, MOST):
            break
        decade = _next(tried, target, cheap, dear)
    if best is None and refusal is not None:
        raise refusal
    if best is None:
        raise RedesignError(
            f"no weights bring the planned error to {100 * aim[1] * task.error:.3g} % of the motion; with inputs as cheap as was "
            f"tried it is {100 * 10 ** tried[-1][1]:.3g} %; allow a larger error, or a smoother or longer motion"
        )
    return best


def _next(tried: list[tuple[float, float]], target: float, cheap: float, dear: float) -> float:
    """The next decade to try: where the secant through the last two meets the target, or the bracket's middle."""
    at, found = tried[-1]
    slope = 0.5
    if len(tried) > 1 and tried[-2][0] != at:
        slope = (found - tried[-2][1]) / (at - tried[-2][0])
    if not slope > 0.05:
        slope = 0.5
    step = float(np.clip((target - found) / slope, -STRIDE, STRIDE))
    following = at + step
    if not cheap < following < dear:
        return (cheap + dear) / 2 if cheap > LEAST and dear < MOST else float(np.clip(following, LEAST, MOST))
    return following


def weights(task: Task, decade: float) -> dict[str, Any]:
    """R and Q_y, in which an input as large as the motion takes costs 10^decade of an error as large as the motion."""
    _, u = task.sizes
    return {"R": _diagonal(10**decade / u**2), "Q_y": _diagonal(1 / task.motion**2)}


def _diagonal(values: Array) -> Any:
    values = rounded(values)
    return values[0] if len(values) == 1 else np.diag(values).tolist()
