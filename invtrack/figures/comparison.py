"""Several runs of the same manoeuvre on common axes: over all of it, or close up around chosen moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arguments import by_name
from invtrack.arrays import finite_number, require_duration
from invtrack.errors import InvtrackError
from invtrack.figures.panels import runs_of
from invtrack.figures.style import (
    FAINT,
    draw_magnitudes,
    draw_steps,
    join_units,
    label,
    legend_below,
    line_looks,
    mark_intervals,
    new_figure,
    shared_style,
    shown_window,
    within,
)
from invtrack.results.result import RunResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INCHES_PER_INPUT = 1.5
INCHES_PER_MOMENT = 2.3


def comparison_figure(results: Sequence[RunResult], *, window: tuple[float, float] | None = None) -> Figure:
    """Tracking error of several runs on one logarithmic axis, and below it their applied inputs, one panel per input.

    The error is the largest |y - y_d| of all outputs. Parameter intervals, the manoeuvre and the window (start, end) [s] shown
    are those of the first run.

    Raises InvtrackError where there is no run, or where the runs differ in outputs or inputs.
    """
    results = runs_of(results)
    first = _same_plant(results)
    window = shown_window(first, window)
    inputs = first.applied
    with shared_style():
        height = 3.0 + INCHES_PER_INPUT * len(inputs.channels)
        figure = new_figure(f"{first.model}: tracking error and input", width=8.5, height=height)
        heights = [1.6, *[1.0] * len(inputs.channels)]
        panels = figure.subplots(len(heights), 1, sharex=True, squeeze=False, height_ratios=heights)[:, 0].tolist()
        _draw_column(panels, results, window, labelled=True)
        _label_rows(panels, first)
        panels[-1].set_xlabel("time [s]")
        figure.align_ylabels()
        legend_below(figure, *panels[0].get_legend_handles_labels())
    return figure


def around_figure(results: Sequence[RunResult], *, times: Mapping[str, float], before: float, after: float) -> Figure:
    """One column for each named time [s], shown from `before` to `after` [s] around it: tracking error, and below it the inputs.

    The error is the largest |y - y_d| of all outputs, on a logarithmic axis that all columns share, as they share those of the
    inputs. Parameter intervals are those of the first run.

    Raises InvtrackError where there are no runs or no times, where the runs differ in outputs or inputs, or for a time outside
    the runs.
    """
    results = runs_of(results)
    first = _same_plant(results)
    named = by_name("times", times, expected="times [s] by their names", error=InvtrackError)
    times = {name: finite_number(f"time {name!r}", time, unit="s", error=InvtrackError) for name, time in named.items()}
    if not times:
        raise InvtrackError("expected at least one time to look at, got none")
    for which, span in (("before", before), ("after", after)):
        require_duration(which, span, error=InvtrackError)
    windows = {name: shown_window(first, (time - before, time + after)) for name, time in times.items()}
    inputs = first.applied
    with shared_style():
        size = {"width": 1.2 + INCHES_PER_MOMENT * len(times), "height": 3.2 + INCHES_PER_INPUT * len(inputs.channels)}
        figure = new_figure(f"{first.model}: tracking error and input around {', '.join(times)}", **size)
        heights = [1.5, *[1.0] * len(inputs.channels)]
        panels = figure.subplots(len(heights), len(times), sharex="col", sharey="row", squeeze=False, height_ratios=heights)
        limits = []
        for column, (name, window) in zip(panels.T, windows.items(), strict=True):
            _draw_column(column, results, window)
            limits.append(column[0].get_ylim())
            for axes in column:
                axes.axvline(times[name], color=FAINT, linewidth=0.9, linestyle=(0, (1, 2)), zorder=1)
            column[0].set_title(f"{name}, {times[name]:.4g} s")
            column[-1].set_xlabel("time [s]")
            column[-1].locator_params(axis="x", nbins=5)
        # An axis that is scaled to one column at a time would keep the limits of the last.
        panels[0, 0].set_ylim(min(low for low, _ in limits), max(high for _, high in limits))
        _label_rows(panels[:, 0].tolist(), first)
        figure.align_ylabels()
        legend_below(figure, *panels[0, 0].get_legend_handles_labels())
    return figure


def _draw_column(
    column: Sequence[Axes], results: Sequence[RunResult], window: tuple[float, float], *, labelled: bool = False
) -> None:
    """Errors, inputs and parameter intervals of all runs in one window."""
    errors = []
    for result, look in zip(results, line_looks(len(results)), strict=True):
        part = within(result.time, window)
        errors.append((result.time[part], np.max(np.abs(result.error[part]), axis=1), {"label": result.name, **look}))
        for i, axes in enumerate(column[1:]):
            draw_steps(axes, result.time[part], result.applied.values[part, i], **look)
    draw_magnitudes(column[0], errors)
    for i, axes in enumerate(column):
        mark_intervals(axes, results[0], window, labelled=labelled and i == 0)


def _label_rows(column: Sequence[Axes], first: RunResult) -> None:
    column[0].set_ylabel(f"$|y - y_d|$ [{join_units(first.output.channels.units)}]")
    for axes, name, unit in zip(column[1:], first.applied.channels.names, first.applied.channels.units, strict=True):
        axes.set_ylabel(label(name, unit))


def _same_plant(results: Sequence[RunResult]) -> RunResult:
    """The first of the runs, once they are known to be comparable."""
    first = results[0]
    for other in results[1:]:
        for what in ("output", "applied"):
            mine, theirs = getattr(first, what), getattr(other, what)
            if mine.channels != theirs.channels:
                raise InvtrackError(
                    f"run {other.name!r} has the {what} channels {theirs.channels}, expected those of {first.name!r}, "
                    f"{mine.channels}; compare runs of one plant"
                )
    return first
