"""One run over time: states, output, tracking error and input."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from invtrack.figures.panels import draw_line, draw_magnitudes, draw_steps, mark_intervals, shown_window, within
from invtrack.figures.style import REFERENCE, join_units, label, line_looks, new_figure, shared_style
from invtrack.results.result import RunResult, Signal

INCHES_PER_PANEL = 1.55
LEGEND_COLUMNS, ROW_SHARE = 3, 0.17  # entries in a row of a legend; share of a panel's height that a row takes


def tracking_figure(result: RunResult, *, window: tuple[float, float] | None = None) -> Figure:
    """States, output against reference, tracking error and input of one run, as in Figure 5 of the parameter-jump paper.

    Left column: states, one panel per unit, the wanted states dashed. Right column: outputs, |y - y_d| on a logarithmic axis,
    inputs as they were applied (dashed as they were commanded, where that differs). Parameter intervals are shaded and labelled,
    T_i and T_f dotted. `window` (start, end) [s] is what is shown: the manoeuvre with its own length before and after it unless
    given, as far as the run goes.

    Raises InvtrackError for a window outside the run. Source: Devasia, Paden and Rossi, Exact-output tracking theory for systems
    with parameter jumps (1996), Figure 5.
    """
    window = shown_window(result, window)
    state_units = list(dict.fromkeys(result.state.channels.units))
    with shared_style():
        rows = max(len(state_units), 3)
        figure = new_figure(f"{result.model}: {result.name}", width=9.5, height=0.9 + INCHES_PER_PANEL * rows)
        left, right = figure.subfigures(1, 2, wspace=0.02, squeeze=False)[0]
        left_axes = left.subplots(len(state_units), 1, sharex=True, squeeze=False)[:, 0]
        right_axes = right.subplots(3, 1, sharex=True)
        for unit, axes in zip(state_units, left_axes, strict=True):
            _draw_states(axes, result, unit, window)
        _draw_output(right_axes[0], result, window)
        _draw_error(right_axes[1], result, window)
        _draw_input(right_axes[2], result, window)
        for column in (left_axes, right_axes):
            for i, axes in enumerate(column):
                mark_intervals(axes, result, window, labelled=i == 0)
            column[-1].set_xlabel("time [s]")
    return figure


def _draw_states(axes: Axes, result: RunResult, unit: str, window: tuple[float, float]) -> None:
    part = within(result, window)
    names = [
        name for name, its_unit in zip(result.state.channels.names, result.state.channels.units, strict=True) if its_unit == unit
    ]
    for name, look in zip(names, line_looks(len(names)), strict=True):
        draw_line(axes, result.time[part], result.state[name][part], label=name, **look)
    for i, name in enumerate(names):
        wanted = result.state_reference[name][part]
        draw_line(axes, result.time[part], wanted, label="plan" if i == 0 else None, **REFERENCE)
    axes.set_ylabel(label(names[0], unit) if len(names) == 1 else f"states [{unit}]")
    _add_legend(axes)


def _draw_output(axes: Axes, result: RunResult, window: tuple[float, float]) -> None:
    part = within(result, window)
    _draw_channels(axes, result, result.output, window)
    for i, channel in enumerate(result.reference.values[part].T):
        draw_line(axes, result.time[part], channel, label="reference" if i == 0 else None, **REFERENCE)
    axes.set_ylabel(_axis_label("output", result.output))
    _add_legend(axes)


def _draw_error(axes: Axes, result: RunResult, window: tuple[float, float]) -> None:
    part = within(result, window)
    looks = line_looks(result.error.shape[1])
    channels = zip(result.error[part].T, looks, strict=True)
    draw_magnitudes(axes, [(result.time[part], channel, {**look}) for channel, look in channels])
    axes.set_ylabel(f"$|y - y_d|$ [{join_units(result.output.channels.units)}]")


def _draw_input(axes: Axes, result: RunResult, window: tuple[float, float]) -> None:
    part = within(result, window)
    steps = slice(part.start, min(part.stop, len(result.time)) - 1)
    names = result.applied.channels.names
    for name, look in zip(names, line_looks(len(names)), strict=True):
        draw_steps(axes, result.time[part], result.applied[name][steps], label=name, **look)
    if not np.array_equal(result.applied.values[steps], result.commanded.values[steps]):
        for i, name in enumerate(result.commanded.channels.names):
            draw_steps(axes, result.time[part], result.commanded[name][steps], label="commanded" if i == 0 else None, **REFERENCE)
    axes.set_ylabel(_axis_label("input", result.applied))
    _add_legend(axes)


def _draw_channels(axes: Axes, result: RunResult, signal: Signal, window: tuple[float, float]) -> None:
    part = within(result, window)
    for name, look in zip(signal.channels.names, line_looks(len(signal.channels)), strict=True):
        draw_line(axes, result.time[part], signal[name][part], label=name, **look)


def _axis_label(kind: str, signal: Signal) -> str:
    if len(signal.channels) == 1:
        return label(signal.channels.names[0], signal.channels.units[0])
    return f"{kind}s [{join_units(signal.channels.units)}]"


def _add_legend(axes: Axes) -> None:
    """A legend in rows of up to three above the lines, for which the panel is made higher: no line lies below it."""
    handles, _ = axes.get_legend_handles_labels()
    if len(handles) < 2:
        return
    rows = -(-len(handles) // LEGEND_COLUMNS)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + ROW_SHARE * rows * (high - low))
    axes.legend(loc="upper left", ncols=LEGEND_COLUMNS, borderaxespad=0.2, columnspacing=1.2)
