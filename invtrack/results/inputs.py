"""How much input a run or a plan takes, and how long it acts before and after the manoeuvre."""

from __future__ import annotations

from typing import Literal

import numpy as np

from invtrack.arrays import Array, require_share
from invtrack.errors import InvtrackError
from invtrack.plans.actuation import plan_actuation_time
from invtrack.plans.plan import Plan
from invtrack.plans.ringing import LEVEL
from invtrack.plans.tail import Side
from invtrack.results.measured import Measured, finite_rows, time_tolerance
from invtrack.results.result import RunResult, require_run


def peak_input(motion: RunResult | Plan) -> float:
    """Largest |u_i| over a run, after the actuators' limits, or over a plan, and all inputs.

    Of a run that diverged the samples before the first one that is not finite count. Raises InvtrackError where there is none.
    """
    return peak(motion, "applied").required()


def peak_commanded_input(result: RunResult) -> float:
    """Largest commanded |u_i| over the run and all inputs, before the actuators' limits. Raises as `peak_input` does."""
    return peak(result, "commanded").required()


def peak_input_above_rest(motion: RunResult | Plan) -> float:
    """What of the largest |u_i| is not spent on rest: how far an input leaves the range between its rests before and after.

    So a load that is held, and one that is picked up and held from then on, do not count, but moving it does. Raises InvtrackError
    where the plan comes to rest neither before nor after the manoeuvre, and as `peak_input` does.
    """
    return peak_above_rest(motion).required()


def preactuation_time(motion: RunResult | Plan, *, level: float = LEVEL) -> float:
    """How long [s] before the manoeuvre the input of a run or a plan acts: is, stays or returns above `level` of its peak.

    From the first time at which |u - u_rest| exceeds that until the manoeuvre starts. It is the envelope that counts: an input that
    oscillates passes through rest again and again. u_rest is the input with which the plan rests before the manoeuvre, |.| the
    Euclidean norm over the (applied) inputs, its peak that over the whole run or plan. A run whose input is above the level from
    its start on gives the whole time before the manoeuvre, a lower bound, which `metrics` says. Raises InvtrackError unless
    0 < level < 1, for a run that diverged, and where the plan is not at rest before the manoeuvre.
    """
    return actuation_time(motion, "before", level).required()


def postactuation_time(motion: RunResult | Plan, *, level: float = LEVEL) -> float:
    """How long [s] after the manoeuvre the input acts: the last time at which |u - u_rest| exceeds `level` of its peak.

    As `preactuation_time`, with the rest after the manoeuvre; infinite for a plan that never comes to rest.
    """
    return actuation_time(motion, "after", level).required()


def peak(motion: RunResult | Plan, kind: Literal["applied", "commanded"]) -> Measured:
    """Largest |u_i|, applied or commanded."""
    u, reason = _inputs(motion, kind)
    return Measured(None, reason) if reason else Measured(float(np.max(np.abs(u))))


def peak_above_rest(motion: RunResult | Plan) -> Measured:
    """How far an input leaves the range between its rests, the largest of all."""
    u, reason = _inputs(motion, "applied")
    if reason:
        return Measured(None, reason)
    low, high = np.fmin(*motion.rest_inputs), np.fmax(*motion.rest_inputs)  # of one end alone where the other has no rest
    if np.any(np.isnan(low)):
        return Measured(None, "the input comes to rest neither before nor after the manoeuvre")
    return Measured(float(np.max(np.abs(u - np.clip(u, low, high)))))


def actuation_time(motion: RunResult | Plan, side: Side, level: float = LEVEL) -> Measured:
    """How long [s] the input acts on one side of the manoeuvre."""
    require_share("level, a share of the peak input such as 0.01,", level, error=InvtrackError)
    rest = _require_motion(motion).rest_inputs[0 if side == "before" else 1]
    if np.any(np.isnan(rest)):
        return Measured(None, f"the input is not at rest {side} the manoeuvre: the plan goes on moving there")
    if isinstance(motion, Plan):
        return Measured(plan_actuation_time(motion, side, level))
    if motion.status == "diverged":
        return Measured(None, f"run {motion.name!r} diverged ({motion.message}), so its peak input is not that of the manoeuvre")
    u, reason = finite_rows(motion, motion.applied.values)
    size = np.hypot.reduce(u - rest, axis=1)  # the norm, without squares that could overflow
    return Measured(None, reason) if reason else _run_actuation_time(motion, side, level, np.abs(size))


def _run_actuation_time(result: RunResult, side: Side, level: float, size: Array) -> Measured:
    """From the sizes |u - u_rest| (N,) over the steps of a run."""
    begins, ends, tolerance = result.time[:-1], result.time[1:], time_tolerance(result)
    T_i, T_f = result.manoeuvre
    outside = ends <= T_i + tolerance if side == "before" else begins >= T_f - tolerance
    above = np.flatnonzero(outside & (size > level * np.max(size)))
    if not len(above):
        return Measured(0.0)
    if side == "before":
        note = "at least: the input is above {:g} % of its peak from the run's start on" if above[0] == 0 else ""
        return Measured(max(0.0, float(T_i - begins[above[0]])), note.format(100 * level))
    note = "at least: the input is above {:g} % of its peak until the run's end" if above[-1] == len(size) - 1 else ""
    return Measured(max(0.0, float(ends[above[-1]] - T_f)), note.format(100 * level))


def _require_motion(motion: RunResult | Plan) -> RunResult | Plan:
    if not isinstance(motion, Plan):
        require_run(motion)
    return motion


def _inputs(motion: RunResult | Plan, kind: Literal["applied", "commanded"]) -> tuple[Array, str]:
    """Finite inputs of a run (k, p), or the lowest and highest of a plan (2, p); or why there are none."""
    if isinstance(_require_motion(motion), Plan):
        return np.array(motion.input_range), ""  # type: ignore[union-attr]
    return finite_rows(motion, (motion.applied if kind == "applied" else motion.commanded).values)  # type: ignore
