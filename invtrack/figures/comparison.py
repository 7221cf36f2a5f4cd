"""Several runs of the same manoeuvre on common axes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from invtrack.errors import InvtrackError
from invtrack.figures.panels import draw_magnitudes, draw_steps, mark_intervals, shown_window, within
from invtrack.figures.style import join_units, label, line_looks, new_figure, shared_style
from invtrack.runs.result import RunResult

INCHES_PER_INPUT = 1.5


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
        height = 3.0 + INCHES_PER_INPUT * len(inputs.names)
        figure = new_figure(f"{first.model}: tracking error and input", width=8.5, height=height)
        heights = [1.6, *[1.0] * len(inputs.names)]
        panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        errors = []
        for result, look in zip(results, looks, strict=True):
            part = within(result, window)
            errors.append((result.time[part], np.max(np.abs(result.error[part]), axis=1), {"label": result.name, **look}))
        draw_magnitudes(panels[0], errors)
        panels[0].set_ylabel(f"$|y - y_d|$ [{join_units(first.output.units)}]")
        for i, axes in enumerate(panels[1:]):
            for result, look in zip(results, looks, strict=True):
                part = within(result, window)
                steps = slice(part.start, min(part.stop, len(result.time)) - 1)
                draw_steps(axes, result.time[part], result.applied.values[steps, i], **look)
            axes.set_ylabel(label(inputs.names[i], inputs.units[i]))
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
            if (mine.names, mine.units) != (theirs.names, theirs.units):
                raise InvtrackError(
                    f"run {other.name!r} has the {what} channels {', '.join(theirs.names)} [{join_units(theirs.units)}], expected "
                    f"those of {first.name!r}, {', '.join(mine.names)} [{join_units(mine.units)}]; compare runs of one plant"
                )
    return first
