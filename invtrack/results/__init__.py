"""What a run leaves behind, and the metrics of it."""

from invtrack.results.metrics import (
    max_error,
    metrics,
    peak_commanded_input,
    peak_input,
    preactuation_time,
    residual_vibration,
    rms_error,
    run_cost,
    state_vibration,
)
from invtrack.results.result import Event, RunResult, Signal

__all__ = [
    "Event",
    "RunResult",
    "Signal",
    "max_error",
    "metrics",
    "peak_commanded_input",
    "peak_input",
    "preactuation_time",
    "residual_vibration",
    "rms_error",
    "run_cost",
    "state_vibration",
]
