"""Several curves of the same kind over time on common axes: wanted against redesigned output, inputs, internal motion."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from numpy.typing import NDArray

from invtrack.errors import InvtrackError
from invtrack.figures.panels import draw_line
from invtrack.figures.style import FAINT, REFERENCE, line_looks, new_figure, shared_style

Array = NDArray[np.float64]
Line = tuple[Array, Array]

INCHES_PER_PANEL = 2.0


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
