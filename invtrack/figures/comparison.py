"""Several runs of the same manoeuvre on common axes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from numpy.typing import NDArray

from invtrack.errors import InvtrackError
from invtrack.figures.panels import draw_line, draw_magnitudes, draw_steps, mark_intervals, shown_window, within
from invtrack.figures.style import FAINT, REFERENCE, join_units, label, line_looks, new_figure, shared_style
from invtrack.results.result import RunResult

INCHES_PER_INPUT = 1.5

Array = NDArray[np.float64]

Line = tuple[Array, Array]

INCHES_PER_PANEL = 2.0


def comparison_figure(results: Sequence[RunResult], *, window: tuple[float, float] | None = None) -> Figure:
    """Tracking error of several runs on one logarithmic axis, and below it their applied inputs, one panel per input.

    The error is the largest |y - y_d| of all outputs. Parameter intervals, the manoeuvre and the window shown are those of the
    first run. Raises InvtrackError where there is no run, or where the runs differ in outputs or inputs.
    """
    first = same_plant(results)
    window = shown_window(first, window)
    inputs = first.applied
    looks = line_looks(len(results))
    with shared_style():
        height = 3.0 + INCHES_PER_INPUT * len(inputs.channels)
        figure = new_figure(f"{first.model}: tracking error and input", width=8.5, height=height)
        heights = [1.6, *[1.0] * len(inputs.channels)]
        panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        errors = []
        for result, look in zip(results, looks, strict=True):
            part = within(result, window)
            errors.append((result.time[part], np.max(np.abs(result.error[part]), axis=1), {"label": result.name, **look}))
        draw_magnitudes(panels[0], errors)
        panels[0].set_ylabel(f"$|y - y_d|$ [{join_units(first.output.channels.units)}]")
        for i, axes in enumerate(panels[1:]):
            for result, look in zip(results, looks, strict=True):
                part = within(result, window)
                steps = slice(part.start, min(part.stop, len(result.time)) - 1)
                draw_steps(axes, result.time[part], result.applied.values[steps, i], **look)
            axes.set_ylabel(label(inputs.channels.names[i], inputs.channels.units[i]))
        for i, axes in enumerate(panels):
            mark_intervals(axes, first, window, labelled=i == 0)
        panels[-1].set_xlabel("time [s]")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower left", ncols=4)
    return figure


def same_plant(results: Sequence[RunResult]) -> RunResult:
    """The first of the runs, once they are known to be comparable."""
    if not results:
        raise InvtrackError("expected at least one run to compare, got none")
    first = results[0]
    for other in results[1:]:
        for what in ("output", "applied"):
            mine, theirs = getattr(first, what), getattr(other, what)
            if mine.channels != theirs.channels:
                raise InvtrackError(
                    f"run {other.name!r} has the {what} channels {theirs.channels}, expected "
                    f"those of {first.name!r}, {mine.channels}; compare runs of one plant"
                )
    return first


def overlay_figure(
    title: str,
    *,
    panels: Sequence[tuple[str, Mapping[str, Line]]],
    wanted: str | None = None,
    window: tuple[float, float] | None = None,
    limits: Mapping[str, tuple[float, float]] | None = None,
) -> Figure:
    """Panels above each other over time, each with curves of one quantity; a curve has the same look in every panel.

    panels: (label with unit, {curve: (times (m,) [s], values (m,))}). wanted: name of the curve that is drawn dashed and on top, as
    what the others are to follow. window (start, end) [s]: what is shown, all unless given.
    limits: for a panel's label, the (lowest, highest) value that its quantity may take, drawn as dotted lines.

    Raises InvtrackError for a panel without curves, a curve whose times and values differ in number, limits of an unknown panel.
    """
    limits = limits or {}
    unknown = set(limits) - {quantity for quantity, _ in panels}
    if not panels or unknown:
        raise InvtrackError(f"expected limits of the panels {[quantity for quantity, _ in panels]}, got {sorted(unknown)}")
    for quantity, curves in panels:
        _require_curves(quantity, curves)
    names = list(dict.fromkeys(name for _, curves in panels for name in curves))
    others = [name for name in names if name != wanted]
    looks: dict[str, dict[str, Any]] = {name: {**look} for name, look in zip(others, line_looks(len(others)), strict=True)}
    if wanted is not None:
        looks[wanted] = {**REFERENCE, "zorder": 3}
    with shared_style():
        figure = new_figure(title, width=8.0, height=1.1 + INCHES_PER_PANEL * len(panels))
        all_axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        handles: dict[str, Artist] = {}
        for axes, (quantity, curves) in zip(all_axes, panels, strict=True):
            for name, (time, values) in curves.items():
                shown = slice(None) if window is None else _within(time, window)
                draw_line(axes, time[shown], values[shown], label=name, **looks[name])
            for level in limits.get(quantity, ()):
                axes.axhline(level, color=FAINT, linewidth=0.9, linestyle=(0, (1, 2)), label="limit")
            axes.set_ylabel(quantity)
            axes.margins(x=0.0, y=0.1)
            for handle, text in zip(*axes.get_legend_handles_labels(), strict=True):
                handles.setdefault(text, handle)
        all_axes[-1].set_xlabel("time [s]")
        if len(handles) > 1:
            figure.legend(list(handles.values()), list(handles), loc="outside lower left", ncols=5)
    return figure


def _require_curves(quantity: str, curves: Mapping[str, Line]) -> None:
    if not curves:
        raise InvtrackError(f"panel {quantity!r} has no curve; give it at least one, or leave it out")
    for name, (time, values) in curves.items():
        if len(time) != len(values):
            raise InvtrackError(f"curve {name!r} of {quantity} has {len(values)} values at {len(time)} times")


def _within(time: Array, window: tuple[float, float]) -> slice:
    """The samples in the window, with one more on either side so that lines reach the edges."""
    first, last = np.searchsorted(time, window)
    return slice(max(int(first) - 1, 0), int(last) + 1)
