"""Several runs of the same manoeuvre on common axes: over all of it, or close up around chosen moments."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arguments import by_name
from invtrack.arrays import Array, finite_number, require_duration
from invtrack.errors import InvtrackError
from invtrack.figures.lines import draw_line, draw_magnitudes, draw_steps
from invtrack.figures.marks import mark_intervals, mark_time, shown_window, within
from invtrack.figures.panels import runs_of
from invtrack.figures.sheet import sheet, stacked
from invtrack.figures.style import WANTED, label, line_looks, with_unit
from invtrack.results.result import RunResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

INCHES_PER_PANEL = 1.5
INCHES_PER_MOMENT = 2.3
WIDTH, WIDTH_OF_TWO = 8.5, 11.0
IN_ONE_COLUMN = 5  # panels; more stand in two columns
ERROR_SHARE = 1.4  # height of the errors' panel relative to the others
AWAY = 0.75  # of what the reference spans: how far beyond it outputs are shown
SAME_REFERENCE = 1e-3  # of its span: what nobody sees


def comparison_figure(
    results: Sequence[RunResult], *, window: tuple[float, float] | None = None, ax: AxesGiven | None = None
) -> Figure:
    """Outputs of several runs with the reference, the sizes of their errors on a logarithmic axis, and their applied inputs.

    One panel for each output, one for the errors of each unit, one for each input. The error is the largest |y - y_d| of the
    outputs of that unit. The reference is wide and pale beneath the runs; a run that has another one has it in its own colour.
    Parameter intervals and the manoeuvre are those of the first run.

    Args:
        results: the runs; lines that coincide are all to be seen.
        window: (start, end) [s] that is shown; unless given the preactuation of all runs, the manoeuvre, and what follows it.
        ax: panels to draw on in place of a figure of its own, one for each output, unit of outputs and input, in this order.

    Raises InvtrackError where there is no run, where the runs differ in outputs or inputs, and for another number of panels.
    """
    results = runs_of(results)
    first = _same_plant(results)
    window = shown_window(results, window)
    outputs, errors, inputs = first.output.channels.labels, _error_labels(first), _input_labels(first)
    titles = [*(text.replace("_", " ") for text in outputs), *errors, *inputs]
    first_column = [*[1.0] * len(outputs), *[ERROR_SHARE] * len(errors)]
    narrow = len(titles) <= IN_ONE_COLUMN
    columns = [[*first_column, *[1.0] * len(inputs)]] if narrow else [first_column, [1.0] * len(inputs)]

    def arranged(figure: Figure) -> list[Axes]:
        if narrow:
            return stacked(figure, len(titles), columns[0])
        parts = figure.subfigures(1, 2, wspace=0.02, squeeze=False)[0]
        return [axes for part, shares in zip(parts, columns, strict=True) for axes in stacked(part, len(shares), shares)]

    size = (WIDTH if narrow else WIDTH_OF_TWO, 1.0 + INCHES_PER_PANEL * max(map(sum, columns)))
    with sheet(f"{first.model}: outputs, errors and inputs", titles, ax, size=size, arranged=arranged) as page:
        tracked, rest = page.axes[: len(outputs)], page.axes[len(outputs) :]
        _draw_outputs(tracked, results, window)
        _draw_column(rest, results, window)
        for axes, title in zip(page.axes, titles, strict=True):
            axes.set_ylabel(title)
        for i, axes in enumerate(page.axes):
            mark_intervals(axes, first, window, labelled=i == 0 or (not narrow and i == len(first_column)))
        page.legend(*tracked[0].get_legend_handles_labels())
    return page.figure


def around_figure(
    results: Sequence[RunResult], *, times: Mapping[str, float], before: float, after: float, ax: AxesGiven | None = None
) -> Figure:
    """One column for each named time [s], shown from `before` to `after` [s] around it: sizes of errors, and below them the inputs.

    The error is the largest |y - y_d| of the outputs of one unit, on a logarithmic axis that all columns share, as they share those
    of the inputs. Parameter intervals are those of the first run.

    Args:
        results: the runs.
        times: by their names [s].
        before, after: what is shown around each [s].
        ax: panels to draw on in place of a figure of its own: rows, one for each unit of outputs and one for each input, of a panel
            for each time.

    Raises InvtrackError where there are no runs or no times, where the runs differ in outputs or inputs, for a time outside the
    runs, and for another number of panels.
    """
    results = runs_of(results)
    first = _same_plant(results)
    named = by_name("times", times, expected="times [s] by their names", error=InvtrackError)
    times = {name: finite_number(f"time {name!r}", time, unit="s", error=InvtrackError) for name, time in named.items()}
    if not times:
        raise InvtrackError("expected at least one time to look at, got none")
    for which, span in (("before", before), ("after", after)):
        require_duration(which, span, error=InvtrackError)
    windows = {name: shown_window(results, (time - before, time + after)) for name, time in times.items()}
    errors, inputs = _error_labels(first), _input_labels(first)
    rows, shares = [*errors, *inputs], [*[ERROR_SHARE] * len(errors), *[1.0] * len(inputs)]

    def arranged(figure: Figure) -> list[Axes]:
        grid = figure.subplots(len(rows), len(times), sharex="col", sharey="row", squeeze=False, height_ratios=shares)
        return list(grid.ravel())

    title = f"{first.model}: tracking error and input around {', '.join(times)}"
    size = (1.2 + INCHES_PER_MOMENT * len(times), 1.0 + INCHES_PER_PANEL * sum(shares))
    titles = [f"{row} around {name}" for row in rows for name in times]
    with sheet(title, titles, ax, size=size, arranged=arranged) as page:
        panels = np.array(page.axes, dtype=object).reshape(len(rows), len(times))
        limits: list[list[tuple[float, float]]] = []
        for column, (name, window) in zip(panels.T, windows.items(), strict=True):
            _draw_column(list(column), results, window)
            limits.append([axes.get_ylim() for axes in column[: len(errors)]])
            for axes in column:
                mark_intervals(axes, first, window)
                mark_time(axes, times[name])
            column[0].set_title(f"{name}, {times[name]:.4g} s")
            column[-1].locator_params(axis="x", nbins=5)
        for row, of_columns in enumerate(zip(*limits, strict=True)):
            # An axis that is scaled to one column at a time would keep the limits of the last.
            for axes in panels[row]:
                axes.set_ylim(min(low for low, _ in of_columns), max(high for _, high in of_columns))
        for axes, text in zip(panels[:, 0], rows, strict=True):
            axes.set_ylabel(text)
        page.legend(*panels[0, 0].get_legend_handles_labels())
    return page.figure


def _draw_outputs(panels: Sequence[Axes], results: Sequence[RunResult], window: tuple[float, float]) -> None:
    first = results[0]
    for i, axes in enumerate(panels):
        part = within(first.time, window)
        for result, look in zip(results, line_looks(len(results)), strict=True):
            shown = within(result.time, window)
            draw_line(axes, result.time[shown], result.output.values[shown, i], label=result.name, **look)
            if result is not first and not _same_reference(result, first, i):
                wanted = {**WANTED, "color": look["color"]}
                draw_line(axes, result.time[shown], result.reference.values[shown, i], **wanted)
        draw_line(axes, first.time[part], first.reference.values[part, i], label="reference", **WANTED)
        _keep_near(axes, first.reference.values[:, i])


def _keep_near(axes: Axes, wanted: Array) -> None:
    """Keep the axis within `AWAY` times what the reference spans, on either side of it: a run that fails leaves the panel."""
    low, high = float(np.min(wanted)), float(np.max(wanted))
    bottom, top = axes.get_ylim()
    if high > low:
        axes.set_ylim(max(bottom, low - AWAY * (high - low)), min(top, high + AWAY * (high - low)))


def _same_reference(one: RunResult, other: RunResult, output: int) -> bool:
    """Whether two runs want the same of an output, as far as can be seen, where both go on."""
    theirs = other.reference.values[:, output]
    shown = (one.time >= other.time[0]) & (one.time <= other.time[-1])
    wanted = np.interp(one.time[shown], other.time, theirs)
    difference = np.abs(one.reference.values[shown, output] - wanted)
    return bool(np.max(difference, initial=0.0) <= SAME_REFERENCE * (np.max(theirs) - np.min(theirs)))


def _draw_column(column: Sequence[Axes], results: Sequence[RunResult], window: tuple[float, float]) -> None:
    """Sizes of errors, unit by unit, and inputs of all runs in one window."""
    units = results[0].output.channels.units
    groups = [[i for i, its_unit in enumerate(units) if its_unit == unit] for unit in dict.fromkeys(units)]
    errors: list[list[tuple[Array, Array, dict[str, object]]]] = [[] for _ in groups]
    for result, look in zip(results, line_looks(len(results)), strict=True):
        part = within(result.time, window)
        for lines, group in zip(errors, groups, strict=True):
            size = np.max(np.abs(result.error[part][:, group]), axis=1)
            lines.append((result.time[part], size, {"label": result.name, **look}))
        for i, axes in enumerate(column[len(groups) :]):
            draw_steps(axes, result.time[part], result.applied.values[part, i], **look)
    for axes, lines in zip(column, errors, strict=False):
        draw_magnitudes(axes, lines)


def _error_labels(run: RunResult) -> list[str]:
    return [with_unit("$|y - y_d|$", unit) for unit in dict.fromkeys(run.output.channels.units)]


def _input_labels(run: RunResult) -> list[str]:
    channels = run.applied.channels
    return [label(name, unit) for name, unit in zip(channels.names, channels.units, strict=True)]


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
