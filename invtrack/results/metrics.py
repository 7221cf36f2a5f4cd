"""A run in numbers: each metric is defined here and nowhere else.

All functions take a RunResult and return values in the run's units. Of several outputs or inputs the one with the largest value
counts. Of a run that diverged the samples before the first one that is not finite count.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.arguments import one_of, texts
from invtrack.arrays import Array, finite_number, real_number, real_numbers, real_weight, require_share
from invtrack.errors import InvtrackError
from invtrack.plans.plan import Plan
from invtrack.plans.preactuation import plan_preactuation_time
from invtrack.results.result import RunResult, require_run

# Times on a run's grid are sums and quotients of floats: two that are meant to be equal differ by some units in the last place.
TIME_TOLERANCE = 1e-9


def max_error(result: RunResult, *, wanted: Literal["reference", "planned_output"] = "reference") -> float:
    """Largest |y - y_d| over the whole run and all outputs; with wanted="planned_output" the largest |y - planned y|."""
    return float(np.max(np.abs(_error(result, wanted))))


def rms_error(result: RunResult, *, wanted: Literal["reference", "planned_output"] = "reference") -> float:
    """Root of the mean over time of (y - y_d)^2, the largest of all outputs.

    sqrt(1/T integral e(t)^2 dt), by the trapezoidal rule because steps are not all equal; a run of a single sample gives |e|.
    """
    error = _error(result, wanted)
    peak = np.max(np.abs(error))
    if len(error) < 2 or not peak > 0:
        return float(peak)
    time = result.time[: len(error)]
    # Divided by the peak before squaring: a run that diverges reaches values whose squares overflow.
    mean_square = np.trapezoid((error / peak) ** 2, time, axis=0) / (time[-1] - time[0])
    return float(peak * np.sqrt(np.max(mean_square)))


def residual_vibration(result: RunResult, *, periods: float = 5, duration: float | None = None) -> float:
    """Peak-to-peak of y - y_d from T_f to T_f + periods * (period of the slowest flexible mode), the largest of all outputs.

    `duration` [s] sets the window's length directly, for plants without a flexible mode. Raises InvtrackError where the run ends
    before the window does, or where there is neither a period nor a duration.
    """
    window = _window_after(result, periods, duration)
    return float(np.max(np.ptp(result.error[window], axis=0)))


def state_vibration(
    result: RunResult, names: Sequence[str], *, periods: float = 5, duration: float | None = None
) -> dict[str, float]:
    """Peak-to-peak of x - x_ref over the window of `residual_vibration`, for each of the named flexible coordinates.

    Where the controller wants no state (x_ref is NaN) it is the peak-to-peak of the coordinate itself. Raises InvtrackError for a
    name that is no state, and as `residual_vibration` does.
    """
    require_run(result)
    names = texts("names", names, expected="a list of names of states", error=InvtrackError)
    unknown = [name for name in names if name not in result.state.channels.names]
    if unknown:
        raise InvtrackError(f"no state named {', '.join(unknown)}; there are: {', '.join(result.state.channels.names)}")
    window = _window_after(result, periods, duration)
    vibration = {}
    for name in names:
        reference = result.state_reference[name][window]
        unreferenced = bool(np.any(np.isnan(reference)))
        vibration[name] = float(np.ptp(result.state[name][window] - (0.0 if unreferenced else reference)))
    return vibration


def preactuation_time(motion: RunResult | Plan, *, level: float = 0.01) -> float:
    """How long [s] before the manoeuvre the input of a run or a plan is above `level` of its peak.

    Of a run: from the last moment before the manoeuvre at which the applied |u| is below that until the manoeuvre starts; an input
    that is above the level from the start of the run on gives the whole time before the manoeuvre, a lower bound. Of a plan: see
    `invtrack.plans.preactuation`. |u| is the Euclidean norm over the inputs. Raises InvtrackError unless 0 < level < 1.
    """
    if isinstance(motion, Plan):
        return plan_preactuation_time(motion, level)
    require_run(motion)
    return _run_preactuation_time(motion, level)


def _run_preactuation_time(result: RunResult, level: float) -> float:
    require_share("level, a share of the peak input such as 0.01,", level, error=InvtrackError)
    inputs = _finite(result, result.applied.values)
    magnitude = np.hypot.reduce(np.abs(inputs), axis=1)  # the norm, without squares that overflow in a run that diverges
    start = result.manoeuvre[0]
    # Steps that end by the start of the manoeuvre; step k lasts from time[k] to time[k + 1].
    step_ends = result.time[1 : len(magnitude) + 1]
    before = step_ends <= start + _tolerance(result)
    if not np.any(before) or not np.any(magnitude > 0):
        return 0.0
    quiet = np.flatnonzero(before & (magnitude < level * np.max(magnitude)))
    since = step_ends[quiet[-1]] if len(quiet) else result.time[0]
    return max(0.0, float(start - since))


def peak_input(result: RunResult) -> float:
    """Largest applied |u_i| over the run and all inputs, after the actuators' limits."""
    require_run(result)
    return _peak(_finite(result, result.applied.values))


def peak_commanded_input(result: RunResult) -> float:
    """Largest commanded |u_i| over the run and all inputs, before the actuators' limits."""
    require_run(result)
    return _peak(_finite(result, result.commanded.values))


def metrics(result: RunResult, *, periods: float = 5, duration: float | None = None) -> dict[str, float | None]:
    """All metrics of one run, by the names that summary.json uses.

    `periods` and `duration` set the window of residual_vibration, which is None for a run that diverged. Raises as
    `residual_vibration` does for a run that was completed.
    """
    require_run(result)
    completed = result.status == "completed"
    return {
        "max_error": max_error(result),
        "rms_error": rms_error(result),
        "residual_vibration": residual_vibration(result, periods=periods, duration=duration) if completed else None,
        "peak_input": peak_input(result),
        "peak_commanded_input": peak_commanded_input(result),
        "preactuation_time": preactuation_time(result),
    }


def _error(result: RunResult, wanted: str) -> Array:
    require_run(result)
    one_of("wanted", wanted, ("reference", "planned_output"), error=InvtrackError)
    return _finite(result, result.output.values - getattr(result, wanted).values)


def _finite(result: RunResult, values: Array) -> Array:
    """The rows of `values` before the first that is not finite; a completed run must have no such row."""
    bad = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
    count = int(bad[0]) if len(bad) else len(values)
    if len(bad) and result.status == "completed":
        raise InvtrackError(f"run {result.name!r} was completed, but is not finite at t = {result.time[count]:.9g} s")
    if count == 0:
        raise InvtrackError(f"run {result.name!r} has no finite sample to evaluate; {result.message or 'it holds no steps'}")
    return values[:count]


def _window_after(result: RunResult, periods: float, duration: float | None) -> NDArray[np.bool_]:
    """Which samples lie in the window after the manoeuvre, (N + 1,)."""
    require_run(result)
    periods = finite_number("periods", periods, error=InvtrackError)
    duration = None if duration is None else real_number("duration", duration, unit="s", error=InvtrackError)
    if result.status == "diverged":
        raise InvtrackError(f"run {result.name!r} diverged ({result.message}), so its residual vibration is not defined")
    if duration is None and not math.isfinite(result.vibration_period):
        raise InvtrackError(
            f"run {result.name!r} has no flexible mode whose periods could be counted; state the window instead: duration=... [s]"
        )
    length = periods * result.vibration_period if duration is None else duration
    if not (math.isfinite(length) and length > 0):
        raise InvtrackError(f"the window after the manoeuvre is {length} s long, expected a positive, finite length")
    start = result.manoeuvre[1]
    tolerance = _tolerance(result)
    if result.time[-1] < start + length - tolerance:
        raise InvtrackError(
            f"run {result.name!r} ends at t = {result.time[-1]:.6g} s, before the window for residual vibration, {start:.6g} s to "
            f"{start + length:.6g} s, does; simulate until {start + length:.6g} s, or ask for fewer periods or a shorter duration"
        )
    return (result.time >= start - tolerance) & (result.time <= start + length + tolerance)


def _tolerance(result: RunResult) -> float:
    return TIME_TOLERANCE * max(1.0, float(np.max(np.abs(result.time))))


def _peak(values: Array) -> float:
    return float(np.max(np.abs(values)))


def run_cost(
    result: RunResult,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    u_0: ArrayLike = 0.0,
    wanted: ArrayLike | None = None,
) -> float:
    """Integral over the run of (u - u_0)'R (u - u_0) + x'Q_x x + (y - y_d)'Q_y (y - y_d), of what was recorded.

    u is the input applied, which holds over each step, and x the deviation from the operating point; both of them and y are as
    recorded, so feedback and disturbances count. Trapezoidal rule: an error of the order of the step squared.

    Args:
        result: the run.
        R, Q_x, Q_y: weights (p, p), (n, n) and (p, p); a number stands for that multiple of the identity.
        u_0: input at the operating point (p,).
        wanted: y_d at the run's times (N + 1, p), where it is not the reference that the controller was given (a plan for another
            reference still has to answer for the one that is wanted).

    Raises InvtrackError for weights or a reference of the wrong shape, and for a run that diverged.
    """
    require_run(result)
    if result.status == "diverged":
        raise InvtrackError(f"run {result.name!r} diverged ({result.message}): its cost is not defined; take a smaller timestep")
    output = result.output.values
    y_d = result.reference.values if wanted is None else real_numbers("wanted", wanted, error=InvtrackError)
    if y_d.shape != output.shape or not np.all(np.isfinite(y_d)):
        raise InvtrackError(
            f"wanted has shape {y_d.shape}, expected {output.shape}: a finite value per sample and output of {result.name!r}"
        )
    rest = real_numbers("u_0", u_0, error=InvtrackError)
    if rest.shape not in ((), result.applied.values.shape[1:]) or not np.all(np.isfinite(rest)):
        raise InvtrackError(f"u_0 must be a finite number for each of the inputs {result.applied.channels}, got {rest.tolist()}")
    u = result.applied.values - rest
    step = np.diff(result.time)
    moving = _quadratic("Q_x", Q_x, result.state.values) + _quadratic("Q_y", Q_y, output - y_d)
    return float(step @ (_quadratic("R", R, u) + (moving[:-1] + moving[1:]) / 2))


def _quadratic(name: str, weight: ArrayLike, values: Array) -> Array:
    """values' weight values of each sample, (m,)."""
    channels = values.shape[1]
    matrix = real_weight(name, weight, channels, error=InvtrackError)
    return np.asarray(np.einsum("mi,ij,mj->m", values, matrix, values))
