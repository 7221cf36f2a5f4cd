"""A run in numbers: all its metrics, and the reasons of those that are not defined.

Values are in the run's units. Of several outputs or inputs the one with the largest value counts.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields
from typing import Any

from invtrack.results.error import errors
from invtrack.results.inputs import actuation_time, peak, peak_above_rest
from invtrack.results.measured import Measured
from invtrack.results.result import RunResult, require_run
from invtrack.results.vibration import PERIODS, vibration, vibration_window


@dataclass(frozen=True)
class Metrics(Mapping[str, Any]):
    """The metrics of a run, by the names that summary.json uses: as attributes, and as a mapping.

    What is not defined is None, and does not keep the others from being there.

    Args:
        max_error, rms_error: of y - y_d, see the functions of these names.
        residual_vibration: peak to peak of y - y_d over the window after the manoeuvre.
        vibration_window: how long that window is [s].
        peak_input, peak_commanded_input: largest |u|, after and before the actuators' limits.
        peak_input_above_rest: what of it does not hold the mechanism at rest.
        preactuation_time, postactuation_time: how long before and after the manoeuvre the input acts [s].
        notes: by the name of a metric, why it is None, or what its value stands for.
    """

    max_error: float | None
    rms_error: float | None
    residual_vibration: float | None
    vibration_window: float | None
    peak_input: float | None
    peak_commanded_input: float | None
    peak_input_above_rest: float | None
    preactuation_time: float | None
    postactuation_time: float | None
    notes: Mapping[str, str]

    def __getitem__(self, name: str) -> Any:
        if name not in self:
            raise KeyError(name)
        return getattr(self, name)

    def __contains__(self, name: object) -> bool:
        return name in self.__dataclass_fields__

    def __iter__(self) -> Iterator[str]:
        return (field.name for field in fields(self))

    def __len__(self) -> int:
        return len(self.__dataclass_fields__)


def metrics(result: RunResult, *, periods: float = PERIODS, duration: float | None = None) -> Metrics:
    """All metrics of one run.

    `periods` and `duration` set the window of residual_vibration, see there. Raises InvtrackError for arguments out of range, and
    for a run that says it was completed and is not finite.
    """
    require_run(result)
    window = vibration_window(result, periods=periods, duration=duration)
    max_error, rms_error = errors(result)
    measured = {
        "max_error": max_error,
        "rms_error": rms_error,
        "residual_vibration": vibration(result, window),
        "vibration_window": Measured(window.value),
        "peak_input": peak(result, "applied"),
        "peak_commanded_input": peak(result, "commanded"),
        "peak_input_above_rest": peak_above_rest(result),
        "preactuation_time": actuation_time(result, "before"),
        "postactuation_time": actuation_time(result, "after"),
    }
    notes = {name: figure.note for name, figure in measured.items() if figure.note}
    return Metrics(**{name: figure.value for name, figure in measured.items()}, notes=notes)
