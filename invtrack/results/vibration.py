"""What is left to vibrate after a run's manoeuvre."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from invtrack.arguments import texts
from invtrack.arrays import finite_number, real_number
from invtrack.errors import InvtrackError
from invtrack.results.measured import Measured, finite_rows, time_tolerance
from invtrack.results.result import RunResult, require_run

PERIODS = 5.0
"""Periods of the slowest flexible mode over which residual vibration is looked at, unless told otherwise."""


def residual_vibration(result: RunResult, *, periods: float = PERIODS, duration: float | None = None) -> float:
    """Peak-to-peak of y - y_d from T_f to T_f + periods * (period of the slowest flexible mode), the largest of all outputs.

    Without a flexible mode the window is as long as the manoeuvre. `duration` [s] sets its length directly. Raises InvtrackError
    where the run ends before the window does, or diverged, or where there is neither a period nor a manoeuvre of any length.
    """
    return vibration(result, vibration_window(result, periods=periods, duration=duration)).required()


def state_vibration(
    result: RunResult, names: Sequence[str], *, periods: float = PERIODS, duration: float | None = None
) -> dict[str, float]:
    """Peak-to-peak of x - x_ref over the window of `residual_vibration`, for each of the named flexible coordinates.

    Where the controller wants no state (x_ref is NaN) it is the peak-to-peak of the coordinate itself. Raises InvtrackError for a
    name that is no state, and as `residual_vibration` does.
    """
    length = vibration_window(result, periods=periods, duration=duration)
    names = texts("names", names, expected="a list of names of states", error=InvtrackError)
    unknown = [name for name in names if name not in result.state.channels.names]
    if unknown:
        raise InvtrackError(f"no state named {', '.join(unknown)}; there are: {', '.join(result.state.channels.names)}")
    window, reason = _samples(result, length)
    if window is None:
        raise InvtrackError(reason)
    found = {}
    for name in names:
        reference = result.state_reference[name][window]
        unreferenced = bool(np.any(np.isnan(reference)))
        found[name] = float(np.ptp(result.state[name][window] - (0.0 if unreferenced else reference)))
    return found


def vibration_window(result: RunResult, *, periods: float = PERIODS, duration: float | None = None) -> Measured:
    """Length [s] of the window after a run's manoeuvre. Raises InvtrackError for one that is not positive and finite."""
    require_run(result)
    count = finite_number("periods", periods, error=InvtrackError)
    if duration is None:
        return window_length(result.manoeuvre, result.vibration_period, count)
    return Measured(_length(real_number("duration", duration, unit="s", error=InvtrackError)))


def window_length(manoeuvre: tuple[float, float], period: float, periods: float = PERIODS) -> Measured:
    """Length [s] of the window: so many periods [s] of the slowest flexible mode (NaN: there is none), or the manoeuvre's."""
    length = _length(periods * period if math.isfinite(period) else periods)
    if math.isfinite(period):
        return Measured(length)
    lasting = manoeuvre[1] - manoeuvre[0]
    if lasting > 0:
        return Measured(lasting, f"no flexible mode: window of the manoeuvre's length, {lasting:.4g} s")
    return Measured(None, "there is no flexible mode and no manoeuvre of any length: state the window, duration=... [s]")


def vibration(result: RunResult, length: Measured) -> Measured:
    """Peak-to-peak of y - y_d over a window after the manoeuvre; length: as `vibration_window` gives it."""
    window, reason = _samples(result, length)
    if window is None:
        return Measured(None, reason)
    error, reason = finite_rows(result, result.error)
    return Measured(None, reason) if reason else Measured(float(np.max(np.ptp(error[window], axis=0))), length.note)


def _length(length: float) -> float:
    if not (math.isfinite(length) and length > 0):
        raise InvtrackError(f"the window after the manoeuvre is {length} s long, expected a positive, finite length")
    return length


def _samples(result: RunResult, length: Measured) -> tuple[NDArray[np.bool_] | None, str]:
    """Which samples lie in the window (N + 1,), or None and why there are none."""
    if result.status == "diverged":
        return None, f"run {result.name!r} diverged ({result.message}), so its residual vibration is not defined"
    if length.value is None:
        return None, f"run {result.name!r}: {length.note}"
    start, tolerance = result.manoeuvre[1], time_tolerance(result)
    end = start + length.value
    if not len(result.time) or result.time[-1] < end - tolerance:
        until = f"t = {result.time[-1]:.6g} s" if len(result.time) else "its start"
        return None, (
            f"run {result.name!r} ends at {until}, before the window for residual vibration, {start:.6g} s to {end:.6g} s, does; "
            f"simulate until {end:.6g} s, or ask for fewer periods or a shorter duration"
        )
    window = (result.time >= start - tolerance) & (result.time <= end + tolerance)
    return (window, "") if np.any(window) else (None, f"run {result.name!r} has no sample from {start:.6g} s to {end:.6g} s")
