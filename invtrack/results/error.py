"""How far a run strays from what was wanted."""

from __future__ import annotations

from typing import Literal

import numpy as np

from invtrack.arguments import one_of
from invtrack.errors import InvtrackError
from invtrack.results.measured import Measured, finite_rows
from invtrack.results.result import RunResult, require_run

Wanted = Literal["reference", "planned_output"]


def max_error(result: RunResult, *, wanted: Wanted = "reference") -> float:
    """Largest |y - y_d| over the whole run and all outputs; with wanted="planned_output" the largest |y - planned y|.

    Of a run that diverged the samples before the first one that is not finite count. Raises InvtrackError where there is none, or
    where a completed run is not finite.
    """
    return errors(result, wanted)[0].required()


def rms_error(result: RunResult, *, wanted: Wanted = "reference") -> float:
    """Root of the mean over time of (y - y_d)^2, the largest of all outputs.

    sqrt(1/T integral e(t)^2 dt), by the trapezoidal rule because steps are not all equal; a run of a single sample gives |e|.
    Raises as `max_error` does.
    """
    return errors(result, wanted)[1].required()


def errors(result: RunResult, wanted: Wanted = "reference") -> tuple[Measured, Measured]:
    """Both figures, max_error and rms_error."""
    require_run(result)
    one_of("wanted", wanted, ("reference", "planned_output"), error=InvtrackError)
    error, reason = finite_rows(result, result.output.values - getattr(result, wanted).values)
    if reason:
        return Measured(None, reason), Measured(None, reason)
    peak = float(np.max(np.abs(error)))
    if len(error) < 2 or not peak > 0:
        return Measured(peak), Measured(peak)
    time = result.time[: len(error)]
    # Divided by the peak before squaring: a run that diverges reaches values whose squares overflow.
    mean_square = np.trapezoid((error / peak) ** 2, time, axis=0) / (time[-1] - time[0])
    return Measured(peak), Measured(peak * float(np.sqrt(np.max(mean_square))))
