"""The time series of a run as a viewer shows them: every signal, the tracking error, and the events."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.recording.header import HELD, SAMPLED
from invtrack.recording.stream import Stream
from invtrack.recording.thinning import Thinning
from invtrack.results.result import RunResult, Signal

Color = tuple[int, int, int]

PALETTE: tuple[Color, ...] = (
    (78, 150, 235), (240, 140, 50), (90, 185, 100), (225, 90, 90), (165, 125, 215), (60, 190, 195), (225, 120, 185), (190, 165, 70),
)  # fmt: skip

REFERENCE_COLOR: Color = (205, 205, 205)

EVENT_COLOR: Color = (150, 150, 150)

LABELS = {
    "state": "{}",
    "state_reference": "{} reference",
    "output": "{}",
    "reference": "{} reference",
    "planned_output": "{} planned",
    "commanded": "{} commanded",
    "applied": "{}",
    "parameters": "{}",
    "measured": "{} measured",
    "estimate": "{} estimate",
    "error": "{}",
    "log10_error": "{}",
}


def entity_path(case: str, *parts: str) -> str:
    """Path of an entity of one case, with every character that Rerun treats specially escaped.

    Rerun does not read its own escape of a backslash back, so that one is written as in a URL: %5C.
    """
    return str(rr.new_entity_path([re.sub(r"%(?=5C|25)", "%25", part).replace("\\", "%5C") for part in (case, *parts)]))


def unit_path(case: str, signal: str, unit: str) -> str:
    """Path of the channels of a signal that have this unit."""
    return entity_path(case, signal, f"[{unit}]")


def channels_by_unit(signal: Signal) -> dict[str, list[int]]:
    """Column numbers of a signal grouped by unit, in order of appearance: an axis of a plot can carry one unit only."""
    groups: dict[str, list[int]] = {}
    for column, unit in enumerate(signal.channels.units):
        groups.setdefault(unit, []).append(column)
    return groups


def step_at(result: RunResult, times: Array) -> NDArray[np.int64]:
    """Number of the sample nearest to each of `times` [s]."""
    return np.searchsorted((result.time[1:] + result.time[:-1]) / 2, times)


@dataclass(frozen=True)
class Legend:
    """How the series of a case are called and coloured.

    number: which case of the recording it is; it chooses the colour. prefix: what their names begin with, where the recording has
    several cases. spelled: names of channels in other words.
    """

    number: int = 0
    prefix: str = ""
    spelled: Mapping[str, str] = field(default_factory=dict)

    def name(self, signal: str, channel: str, unit: str) -> str:
        """Of a channel of a signal, short: the title of its plot says what kind it is."""
        words = f"{self.prefix}{LABELS[signal].format(self.spelled.get(channel, channel))}"
        return f"{words} [{'log10 ' if signal == 'log10_error' else ''}{unit}]" if unit else words


def send_series(stream: Stream, result: RunResult, thinning: Thinning, legend: Legend) -> None:
    """Send all time series of one case. thinning: what of them is shown."""
    for name in SAMPLED:
        _send_signal(stream, result, thinning, name, getattr(result, name), result.time, legend)
    middle = result.time[:-1] + np.diff(result.time) / 2
    for name in HELD:
        at_middle = result.evaluate == "stages" and name != "parameters"  # then the sample is the value at mid-step
        times = middle if at_middle else result.time[:-1]
        _send_signal(stream, result, thinning, name, getattr(result, name), times, legend)
    errors = {
        "error": Signal(tracking_error(result), result.output.channels),
        "log10_error": Signal(log10_error(result), result.output.channels),
    }
    for name, error in errors.items():
        _send_signal(stream, result, thinning, name, error, result.time, legend)
    send_events(stream, result, errors, prefix=legend.prefix)


def _send_signal(
    stream: Stream, result: RunResult, thinning: Thinning, name: str, signal: Signal, times: Array, legend: Legend
) -> None:
    """Send the channels of a signal, those of one unit together.

    Args:
        stream: to which they are sent.
        result: the run, placed where it stands in the recording.
        thinning: what of them is shown.
        name: of the signal.
        signal: the signal.
        times: at which its rows stand [s].
        legend: how they are called and coloured.
    """
    if len(signal.values) == 0:
        return
    holds = name in HELD and (result.evaluate != "stages" or name == "parameters")
    for unit, channels in channels_by_unit(signal).items():
        path = unit_path(result.name, name, unit)
        values = signal.values[:, channels]
        rows = thinning.rows(values)
        stream.send_numbers(path, rows, times[rows], values[rows], held=holds)
        labels = [legend.name(name, signal.channels.names[channel], unit) for channel in channels]
        _label(stream, path, labels, _colors(name, legend.number, len(channels)), width=_width(name), holds=holds)


def tracking_error(result: RunResult) -> Array:
    """y - y_d, (N + 1, p), NaN or infinite without a warning where a diverged run makes it so."""
    with np.errstate(invalid="ignore", over="ignore"):
        return result.error


def log10_error(result: RunResult) -> Array:
    """log10 |y - y_d|, (N + 1, p), cut off below at the rounding error of the channel's largest finite output or reference."""
    both = np.vstack([result.output.values, result.reference.values])
    peak = np.max(np.abs(both), axis=0, where=np.isfinite(both), initial=0.0)
    floor = np.finfo(float).eps * np.where(peak > 0, peak, 1.0)
    return np.log10(np.maximum(np.abs(tracking_error(result)), np.maximum(floor, np.finfo(float).tiny)))


def send_events(stream: Stream, result: RunResult, errors: Mapping[str, Signal], *, prefix: str = "") -> None:
    """Send the events as a text log, and, with their ends, as vertical lines for the plots of output, `errors` and input."""
    if not result.events:
        return
    times = np.array([event.time for event in result.events])
    steps = step_at(result, times)
    rows = rr.TextLog.columns(
        text=[f"{prefix}{event.kind}: {event.text} (t = {event.time:.6g} s)" for event in result.events],
        level=["ERROR" if event.kind == "end" and result.status == "diverged" else "INFO" for event in result.events],
    )
    stream.send(entity_path(result.name, "events"), steps, times, rows)
    ends = [event.until for event in result.events if event.until is not None and event.until < result.time[-1]]
    marks = np.sort(np.concatenate([times, ends]))
    for name, signals in (
        ("output", (result.output, result.reference)),
        *((name, (error,)) for name, error in errors.items()),
        ("applied", (result.applied, result.commanded)),
    ):
        for unit in channels_by_unit(signals[0]):
            path = entity_path(result.name, "event_lines", name, f"[{unit}]")
            _send_vertical_lines(stream, path, result, marks, _finite_range(signals, unit))


def _send_vertical_lines(stream: Stream, path: str, result: RunResult, times: Array, span: tuple[float, float]) -> None:
    # Rows at one and the same time are merged by the viewer, so the upper end and the gap after it stand 1 and 2 ns later.
    later = (times[:, np.newaxis] + [0.0, 1e-9, 2e-9]).ravel()
    rows = np.tile([span[0], span[1], np.nan], times.size)[:, np.newaxis]
    stream.send_numbers(path, np.repeat(step_at(result, times), 3), later, rows)
    style = rr.SeriesLines(names=["events"], colors=[EVENT_COLOR], widths=[1.0], aggregation_policy="Off")
    stream.log(path, style)


def _finite_range(signals: Sequence[Signal], unit: str) -> tuple[float, float]:
    values = np.concatenate([signal.values[:, channels_by_unit(signal).get(unit, [])].ravel() for signal in signals])
    finite = values[np.isfinite(values)]
    return (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)


def _label(stream: Stream, path: str, names: list[str], colors: list[Color], *, width: float = 2.5, holds: bool = False) -> None:
    # Where a pixel covers many samples the viewer's default, their mean, would hide short peaks.
    style = rr.SeriesLines(
        names=names,
        colors=colors,
        widths=[width] * len(names),
        interpolation_mode=rr.components.InterpolationMode.StepAfter if holds else rr.components.InterpolationMode.Linear,
        aggregation_policy=rr.components.AggregationPolicy.MinMax if holds else rr.components.AggregationPolicy.MinMaxAverage,
    )
    stream.log(path, style)


def _width(name: str) -> float:
    # What is wanted is drawn over what came of it: the thinner line leaves both to be seen where they agree.
    return 1.0 if name in ("reference", "state_reference", "planned_output", "commanded") else 2.5


def _colors(name: str, number: int, count: int) -> list[Color]:
    """Colours of the channels: by case where cases are compared in one plot, by channel for states and parameters."""
    if name == "reference":
        return [REFERENCE_COLOR] * count
    first = 0 if name in ("state", "state_reference", "parameters") else number
    colors = [PALETTE[(first + channel) % len(PALETTE)] for channel in range(count)]
    paler = name in ("state_reference", "planned_output", "commanded")
    return [_mixed(color, (255, 255, 255), 0.55) for color in colors] if paler else colors


def _mixed(color: Color, other: Color, share: float) -> Color:
    red, green, blue = (round((1 - share) * mine + share * theirs) for mine, theirs in zip(color, other, strict=True))
    return red, green, blue
