"""One run over time: states, output, tracking error and input; and its input before the manoeuvre."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from invtrack.figures.style import (
    COLORS,
    FAINT,
    INK,
    REFERENCE,
    draw_line,
    draw_magnitudes,
    draw_steps,
    inches,
    join_units,
    label,
    line_looks,
    mark_intervals,
    new_figure,
    shared_style,
    shown_window,
    within,
    write,
)
from invtrack.results.inputs import actuation_time
from invtrack.results.result import RunResult, Signal, require_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INCHES_PER_PANEL = 1.7
COLUMN_INCHES = 4.6
LEGEND_COLUMNS, LEGEND_INCHES, ENTRY_INCHES = (
    3,
    3.7,
    0.4,
)  # entries in a row of a legend at most; its width, an entry's without text
ROW_SHARE, ROW_INCHES = (
    0.17,
    0.165,
)  # how much higher a row of a legend makes a panel, as a share of what lies below; a row's height


def tracking_figure(result: RunResult, *, window: tuple[float, float] | None = None) -> Figure:
    """States, output against reference, tracking error and input of one run, as in Figure 5 of the parameter-jump paper.

    Left column: states, one panel per unit, the wanted states dashed. Right column: outputs, |y - y_d| on a logarithmic axis,
    inputs as they were applied (dashed as they were commanded, where that differs). Parameter intervals are shaded and labelled,
    T_i and T_f dotted. `window` (start, end) [s] is what is shown: the manoeuvre with its own length before and after it unless
    given, as far as the run goes.

    Raises InvtrackError for a window outside the run. Source: Devasia, Paden and Rossi, Exact-output tracking theory for systems
    with parameter jumps (1996), Figure 5.
    """
    require_run(result)
    window = shown_window(result, window)
    state_units = list(dict.fromkeys(result.state.channels.units))
    with shared_style():
        rows = max(len(state_units), 3)
        legends = [[*_states_in(result, unit), "plan"] for unit in state_units]
        legends += [[*result.output.channels.names, "reference"], [*result.applied.channels.names, "commanded"]]
        height = max(INCHES_PER_PANEL, *(_inches_with_legend(legend) for legend in legends))
        figure = new_figure(f"{result.model}: {result.name}", width=9.5, height=0.9 + height * rows)
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
        left.align_ylabels()
        right.align_ylabels()
    return figure


def column_figure(result: RunResult, *, window: tuple[float, float] | None = None) -> Figure:
    """Output against reference, tracking error and input of one run in one narrow column, for a page or a phone.

    `window` as for `tracking_figure`. Raises InvtrackError for a window outside the run.
    """
    require_run(result)
    window = shown_window(result, window)
    with shared_style():
        figure = new_figure("", width=COLUMN_INCHES, height=2 * COLUMN_INCHES / 1.6)
        panels = figure.subplots(3, 1, sharex=True)
        for axes, draw in zip(panels, (_draw_output, _draw_error, _draw_input), strict=True):
            draw(axes, result, window)
            mark_intervals(axes, result, window, labelled=axes is panels[0])
        panels[-1].set_xlabel("time [s]")
        figure.align_ylabels()
    return figure


def preactuation_figure(result: RunResult, *, level: float = 0.01) -> Figure:
    """|u - u_rest| before the manoeuvre on a logarithmic axis, with `level` times its peak and the preactuation time marked.

    The Euclidean norm of the applied inputs, from those with which the plan rests before the manoeuvre; the time is that of
    `invtrack.results.preactuation_time` at this level, or the reason why there is none. A straight line is an exponential: its
    slope is the real part of the zero that sets the preactuation.

    Raises InvtrackError unless 0 < level < 1.
    """
    require_run(result)
    start, end = result.manoeuvre
    found = actuation_time(result, "before", level)
    lasting, rest = found.value or 0.0, result.rest_inputs[0]
    departure = result.applied.values - np.where(np.isnan(rest), 0.0, rest)
    magnitude = np.hypot.reduce(np.abs(departure), axis=1)  # no squares: they overflow in a run that diverges
    finite = magnitude[np.isfinite(magnitude)]
    peak = float(finite.max()) if len(finite) else 0.0
    middle = (result.time[:-1] + result.time[1:]) / 2
    lead = min(start - float(result.time[0]), max(3 * lasting, end - start))
    window = (start - lead, start + 0.15 * max(lead, end - start))
    shown = (middle >= window[0]) & (middle <= window[1])
    unit = join_units(result.applied.channels.units)
    size = f"{peak:.3g}" if unit == "1" else f"{peak:.3g} {unit}"
    with shared_style():
        figure = new_figure(f"{result.model}: {result.name}, input before the manoeuvre", width=8, height=3.4)
        axes = figure.add_subplot()
        draw_magnitudes(axes, [(middle[shown], magnitude[shown], {"color": COLORS[0]})], peak=peak or None)
        axes.set_xlim(*window)
        axes.set_xlabel("time [s]")
        axes.set_ylabel(rf"$|u - u_\mathrm{{rest}}|$ [{unit}]")
        axes.axvline(start, color=FAINT, linewidth=0.8, linestyle=(0, (1, 2)))
        write(axes, "$T_i$", (start, 1), axes.get_xaxis_transform(), (0, 1), ha="center", va="bottom")
        if peak > 0:
            axes.axhline(level * peak, color=COLORS[1], linewidth=1, linestyle="--")
            text = f"{100 * level:g} % of the peak {size}"
            write(axes, text, (0, level * peak), axes.get_yaxis_transform(), (4, 3), color=COLORS[1])
        if lasting > 0 and peak > 0:
            height = level * peak * 0.4
            arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", (start - lasting, height), (start, height), arrowprops=arrow)
            text = f"preactuation time {lasting:.3g} s"
            write(axes, text, (start, height), "data", (-3, -4), ha="right", va="top")
        if found.note:
            said = "no preactuation time: " if found.value is None else f"preactuation time {found.value:.3g} s, "
            write(axes, said + found.note, (0, 1), axes.transAxes, (4, -4), va="top")
    return figure


def _draw_states(axes: Axes, result: RunResult, unit: str, window: tuple[float, float]) -> None:
    part = within(result.time, window)
    names = _states_in(result, unit)
    for name, look in zip(names, line_looks(len(names)), strict=True):
        draw_line(axes, result.time[part], result.state[name][part], label=name, **look)
    for i, name in enumerate(names):
        wanted = result.state_reference[name][part]
        draw_line(axes, result.time[part], wanted, label="plan" if i == 0 else None, **REFERENCE)
    axes.set_ylabel(label(names[0], unit) if len(names) == 1 else f"states [{unit}]")
    _add_legend(axes)


def _draw_output(axes: Axes, result: RunResult, window: tuple[float, float]) -> None:
    part = within(result.time, window)
    _draw_channels(axes, result, result.output, window)
    for i, channel in enumerate(result.reference.values[part].T):
        draw_line(axes, result.time[part], channel, label="reference" if i == 0 else None, **REFERENCE)
    axes.set_ylabel(_axis_label("output", result.output))
    _add_legend(axes)


def _draw_error(axes: Axes, result: RunResult, window: tuple[float, float]) -> None:
    part = within(result.time, window)
    looks = line_looks(result.error.shape[1])
    channels = zip(result.error[part].T, looks, strict=True)
    draw_magnitudes(axes, [(result.time[part], channel, {**look}) for channel, look in channels])
    axes.set_ylabel(f"$|y - y_d|$ [{join_units(result.output.channels.units)}]")


def _draw_input(axes: Axes, result: RunResult, window: tuple[float, float]) -> None:
    part = within(result.time, window)
    names = result.applied.channels.names
    for name, look in zip(names, line_looks(len(names)), strict=True):
        draw_steps(axes, result.time[part], result.applied[name][part], label=name, **look)
    if not np.array_equal(result.applied.values[part], result.commanded.values[part]):
        for i, name in enumerate(result.commanded.channels.names):
            draw_steps(axes, result.time[part], result.commanded[name][part], label="commanded" if i == 0 else None, **REFERENCE)
    axes.set_ylabel(_axis_label("input", result.applied))
    _add_legend(axes)


def _draw_channels(axes: Axes, result: RunResult, signal: Signal, window: tuple[float, float]) -> None:
    part = within(result.time, window)
    for name, look in zip(signal.channels.names, line_looks(len(signal.channels)), strict=True):
        draw_line(axes, result.time[part], signal[name][part], label=name, **look)


def _axis_label(kind: str, signal: Signal) -> str:
    if len(signal.channels) == 1:
        return label(signal.channels.names[0], signal.channels.units[0])
    return f"{kind}s [{join_units(signal.channels.units)}]"


def _states_in(result: RunResult, unit: str) -> list[str]:
    """The states that have this unit."""
    channels = result.state.channels
    return [name for name, its_unit in zip(channels.names, channels.units, strict=True) if its_unit == unit]


def _add_legend(axes: Axes) -> None:
    """A legend in rows above the lines, for which the panel is made higher: no line lies below it."""
    handles, names = axes.get_legend_handles_labels()
    if len(handles) < 2:
        return
    columns = _legend_columns(names)
    rows = -(-len(handles) // columns)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + ROW_SHARE * rows * (high - low))
    legend = axes.legend(loc="upper left", ncols=columns, borderaxespad=0.2, columnspacing=1.2)
    legend.set_in_layout(False)  # a name wider than the panel is cut off; it does not push the panel away


def _legend_columns(names: Sequence[str]) -> int:
    """How many entries stand side by side, up to three: as many as are no wider together than a panel."""
    return min(LEGEND_COLUMNS, max(1, int(LEGEND_INCHES / (max(map(inches, names)) + ENTRY_INCHES))))


def _inches_with_legend(names: Sequence[str]) -> float:
    """The height of a panel in which a legend with these entries finds room above the lines."""
    rows = -(-len(names) // _legend_columns(names))
    return ROW_INCHES * (1 + ROW_SHARE * rows) / ROW_SHARE
