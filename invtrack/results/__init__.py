"""What a run leaves behind, and the metrics of it."""

from invtrack.results.cost import run_cost
from invtrack.results.error import max_error, rms_error
from invtrack.results.inputs import peak_commanded_input, peak_input, peak_input_above_rest, postactuation_time, preactuation_time
from invtrack.results.log import read_log
from invtrack.results.metrics import Metrics, metrics
from invtrack.results.result import Event, RunResult, Signal
from invtrack.results.vibration import residual_vibration, state_vibration

__all__ = [
    "Event",
    "Metrics",
    "RunResult",
    "Signal",
    "max_error",
    "metrics",
    "peak_commanded_input",
    "peak_input",
    "peak_input_above_rest",
    "postactuation_time",
    "preactuation_time",
    "read_log",
    "residual_vibration",
    "rms_error",
    "run_cost",
    "state_vibration",
]
