"""Times of a run on panels: what window of it is shown, its manoeuvre, the intervals between changes of its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import InvtrackError
from invtrack.figures.panels import window_of
from invtrack.figures.style import DOTTED, FAINT, SHADES, inches, write
from invtrack.results.interval import shown_interval
from invtrack.results.result import RunResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes

CLOSE = 0.04  # part of the window below which the names of the manoeuvre's ends would overlap


def shown_window(results: Sequence[RunResult], window: tuple[float, float] | None) -> tuple[float, float]:
    """The times to show: `window`, or the interval in which something happens in the runs, preactuation included.

    Raises InvtrackError for a window that does not overlap the first run.
    """
    low, high = window_of(window) if window is not None else shown_interval(results)
    first, last = float(results[0].time[0]), float(results[0].time[-1])
    if not (low < high and low < last and high > first):
        raise InvtrackError(f"cannot show the times from {low} s to {high} s of a run that lasts from {first} s to {last} s")
    return low, high


def within(time: Array, window: tuple[float, float]) -> slice:
    """The samples in `window`, with one more on either side so that lines reach the edges."""
    first, last = np.searchsorted(time, window)
    return slice(max(int(first) - 1, 0), int(last) + 1)


def parameter_intervals(result: RunResult) -> list[tuple[float, float, str]]:
    """Start, end and text of each interval between changes of the parameters; the text names those that change at all."""
    values = result.parameters.values
    if not values.size:
        return []
    # Parameters are set, not computed: any difference is a change.
    changed = np.any(values[1:] != values[:-1], axis=1)
    varying = [i for i in range(values.shape[1]) if np.any(values[:, i] != values[0, i])]
    corners = [0, *(np.flatnonzero(changed) + 1), len(values)]
    names, units = result.parameters.channels.names, result.parameters.channels.units
    intervals = []
    for first, last in pairwise(corners):
        text = "\n".join(f"{names[i]} = {values[first, i]:.4g} {units[i]}" for i in varying)
        intervals.append((float(result.time[first]), float(result.time[last]), text))
    return intervals


def mark_intervals(axes: Axes, result: RunResult, window: tuple[float, float], *, labelled: bool = False) -> None:
    """Shade every second parameter interval, mark the manoeuvre's ends, and with `labelled` write both above the panel."""
    axes.set_xlim(*window)
    low, high = window
    intervals = parameter_intervals(result)
    for i, (first, last, text) in enumerate(intervals):
        first, last = max(first, low), min(last, high)
        if len(intervals) < 2 or first >= last:
            continue
        axes.axvspan(first, last, color=SHADES[i % 2], linewidth=0, zorder=0)
        if labelled:
            _write_above(axes, (first + last) / 2, text, share=(last - first) / (high - low))
    mark_manoeuvre(axes, result.manoeuvre, window, labelled=labelled)


def mark_manoeuvre(
    axes: Axes, manoeuvre: tuple[float, float], window: tuple[float, float] | None = None, *, labelled: bool = False
) -> None:
    """Dotted lines at the manoeuvre's ends that lie in the window, with `labelled` named above the panel."""
    low, high = window or (-np.inf, np.inf)
    for time, name, side in zip(manoeuvre, ("$T_i$", "$T_f$"), ("right", "left"), strict=True):
        if low <= time <= high:
            mark_time(axes, time)
            if labelled:
                near = manoeuvre[1] - manoeuvre[0] < CLOSE * (high - low)
                write(axes, name, (time, 1), axes.get_xaxis_transform(), (0, 1), ha=side if near else "center", va="bottom")


def mark_time(axes: Axes, time: float) -> None:
    """A dotted line across the panel at a time [s]."""
    axes.axvline(time, color=FAINT, linewidth=0.9, linestyle=DOTTED, zorder=1)


def _write_above(axes: Axes, time: float, text: str, *, share: float) -> None:
    """Text above a panel and above the row of T_i and T_f; `share` is the part of the panel's width that it may take."""
    figure = axes.get_figure(root=True)
    assert figure is not None
    width = share * axes.bbox.width / figure.dpi
    if inches(text) > 0.85 * width:
        text = text.replace(" = ", "\n")
    if inches(text) > 1.2 * width:  # the neighbours say what the values are of
        text = "\n".join(line for line in text.split("\n")[1::2])
    if inches(text) > 1.2 * width:  # many short intervals: their shades alone must do
        return
    write(axes, text, (time, 1), axes.get_xaxis_transform(), (0, 13), ha="center", va="bottom", fontsize=7.5)
