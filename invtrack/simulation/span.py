"""From when to when a run lasts: all of its plan, unless that takes more steps than anybody would expect unasked."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from invtrack.errors import LongRunWarning
from invtrack.plans.plan import Plan
from invtrack.plans.trajectory import away_from_rest
from invtrack.results.vibration import window_length
from invtrack.simulation.grid import MOST_STEPS
from invtrack.simulation.preflight import STACK

UNASKED = 500_000
"""Steps that a run takes before its manoeuvre, and after it, at most, where its start or its end is not stated; or as many as the
manoeuvre itself, if these are more."""

LONG = 1_000_000
"""Steps from which on a run is announced before it begins."""

SPEED = 5e4
"""Steps per second, in order of magnitude, to say how long a run will take."""

VISIBLE = 1e-3
"""What of each peak is left of a plan that looks at rest: where the run cannot last until the plan rests, it lasts until there."""


@dataclass(frozen=True)
class Span:
    """Start and end [s] of a run, and what has been left out of the plan."""

    start: float
    end: float
    remarks: tuple[str, ...]


def span_of_run(plan: Plan, *, period: float, timestep: float, start: float | None, end: float | None) -> Span:
    """What is not stated: the plan's start; its end, or that of the window for residual vibration, if that comes later.

    Where the plan takes more than UNASKED steps to leave rest or to come back to it, the run starts or ends where it looks at
    rest, VISIBLE, or after that many steps. A LongRunWarning says so, and so does the run; another one announces a long run.

    Args:
        plan: what is followed.
        period: of the slowest flexible mode [s], NaN where there is none.
        timestep: of the run [s].
        start, end: as stated [s], or None.
    """
    remarks = []
    if start is None:
        start, remark = _start(plan, timestep)
        remarks.append(remark)
    if end is None:
        end, remark = _end(plan, timestep, window_length(plan.manoeuvre, period).value or 0.0)
        remarks.append(remark)
    span = Span(start, end, tuple(filter(None, remarks)))
    steps = (end - start) / timestep
    if steps > MOST_STEPS:
        return span  # which is refused
    texts = list(span.remarks)
    if steps > LONG:
        texts.append(
            f"a long run: {end - start:.6g} s in {steps:.2g} steps of {timestep:g} s, of the order of {_duration(steps / SPEED)}; "
            "end it earlier (end=...), or take a larger timestep"
        )
    for text in texts:
        warnings.warn(text, LongRunWarning, stacklevel=STACK)
    return span


def _start(plan: Plan, timestep: float) -> tuple[float, str]:
    longest = _unasked(plan, timestep)
    T_i, before = plan.manoeuvre[0], plan.trajectory.before
    if not np.isfinite(plan.start) or T_i - plan.start <= longest:
        return plan.start, ""
    looks_at_rest = float(plan.breakpoints[0]) - before.decay_time(plan.trajectory.peaks, VISIBLE)
    start = max(T_i - longest, min(looks_at_rest, T_i))
    share = away_from_rest(plan.trajectory, "before", start)
    return start, (
        f"the run starts at t = {start:.6g} s, where the plan is already {share:.1e} of its peak away from rest: it leaves rest "
        f"{T_i - plan.start:.6g} s before its manoeuvre, {(T_i - plan.start) / timestep:.2g} steps. Ask for all of it by "
        "start=plan.start"
    )


def _end(plan: Plan, timestep: float, window: float) -> tuple[float, str]:
    longest = _unasked(plan, timestep)
    T_f, after = plan.manoeuvre[1], plan.trajectory.after
    end = max(plan.end, T_f + window)
    if not np.isfinite(end) or end - T_f <= longest:
        return end, ""
    looks_at_rest = float(plan.breakpoints[-1]) + after.decay_time(plan.trajectory.peaks, VISIBLE)
    cut = min(T_f + longest, max(T_f + window, min(looks_at_rest, plan.end)))
    share = away_from_rest(plan.trajectory, "after", cut)
    whole, until = (
        ("plan.end", "the plan comes to rest")
        if plan.end >= T_f + window
        else (f"{end:.6g}", "the window for residual vibration ends")
    )
    return cut, (
        f"the run ends at t = {cut:.6g} s, where the plan is still {share:.1e} of its peak away from rest: until {until} it takes "
        f"{end - T_f:.6g} s after the manoeuvre, {(end - T_f) / timestep:.2g} steps. Ask for all of it by end={whole}, or "
        "plan with max_postactuation"
    )


def _unasked(plan: Plan, timestep: float) -> float:
    """The longest time [s] before and after the manoeuvre that nobody has to ask for."""
    return max(UNASKED * timestep, plan.manoeuvre[1] - plan.manoeuvre[0])


def _duration(seconds: float) -> str:
    """A length of time in words."""
    for size, unit in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds:.0f} s"
