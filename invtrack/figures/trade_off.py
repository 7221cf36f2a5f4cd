"""What one quantity costs in others: panels that share their horizontal axis, one per quantity that is traded."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from invtrack.arguments import flag, require_text, texts
from invtrack.arrays import Array, shown
from invtrack.errors import InvtrackError
from invtrack.figures.panels import panels_of, values_of
from invtrack.figures.sheet import sheet
from invtrack.figures.style import INK, channel_looks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

Curves = Mapping[str, Sequence[float]]

INCHES_PER_PANEL = 1.9
MARKERS = ("o", "s", "^", "D", "v", "P")
DECADES_DIVIDED = 2.5  # a logarithmic axis over no more than these has labels at 2 and 5, too
NOTE_OFFSET = 5.0  # points between a point and its note


def trade_off_figure(
    title: str,
    *,
    horizontal: tuple[str, Sequence[float]],
    panels: Sequence[tuple[str, Curves]],
    notes: Sequence[str] = (),
    horizontal_log: bool = False,
    vertical_log: bool = False,
    ax: AxesGiven | None = None,
) -> Figure:
    """Panels above each other, one per quantity, over one quantity that is given up; the points of a curve joined in their order.

    A curve has the same look in every panel. NaN leaves a point out of a curve and interrupts its line, so that families of points
    can share the horizontal axis.

    Args:
        title: of the figure.
        horizontal: (label with unit, value of each point).
        panels: (label with unit, {curve: value of each point}), from top to bottom.
        notes: a text for each point, "" for those without, written beside the point's first curve of the top panel and marked in
            all panels.
        horizontal_log, vertical_log: whether the axes are logarithmic; on these a value that is not positive has no place.
        ax: panels to draw on in place of a figure of its own, as many.

    Raises InvtrackError where lengths differ, where there is nothing to draw, and for another number of panels in `ax`.
    """
    if not isinstance(horizontal, (tuple, list)) or len(horizontal) != 2:
        raise InvtrackError(f"horizontal must be (label, value of each point), got {shown(horizontal)}")
    label, values = (
        require_text("the horizontal label", horizontal[0], error=InvtrackError),
        values_of("horizontal values", horizontal[1]),
    )
    panels = [
        (quantity, {name: values_of(f"curve {name!r}", curve).tolist() for name, curve in curves.items()})
        for quantity, curves in panels_of(panels)
    ]
    notes = texts("notes", notes, expected="a list of texts, one for each point", error=InvtrackError)
    for which, value in (("horizontal_log", horizontal_log), ("vertical_log", vertical_log)):
        flag(which, value, error=InvtrackError)
    require_text("title", title, error=InvtrackError)
    _require_fit(label, len(values), panels, notes)
    names = list(dict.fromkeys(name for _, curves in panels for name in curves))
    looks = {
        name: {**look, "marker": MARKERS[i % len(MARKERS)]}
        for i, (name, look) in enumerate(zip(names, channel_looks(len(names)), strict=True))
    }
    from matplotlib.ticker import LogFormatterSciNotation, LogLocator

    titles = [quantity for quantity, _ in panels]
    with sheet(title, titles, ax, size=(8.0, 1.1 + INCHES_PER_PANEL * len(panels)), along=label) as page:
        for axes, (quantity, curves) in zip(page.axes, panels, strict=True):
            if horizontal_log:
                axes.set_xscale("log")
                axes.xaxis.set_minor_locator(LogLocator(subs=(2.0, 5.0)))
                axes.xaxis.set_minor_formatter(
                    LogFormatterSciNotation(labelOnlyBase=False, minor_thresholds=(DECADES_DIVIDED,) * 2)
                )
            if vertical_log:
                axes.set_yscale("log")
            for name, curve in curves.items():
                axes.plot(values, np.asarray(curve, dtype=float), label=name, markersize=3.5, **looks[name])
            axes.set_ylabel(quantity)
            axes.margins(x=0.06, y=0.12)
            _mark_notes(axes, values, curves, notes, written=axes is page.axes[0])
        if len(names) > 1:
            handles = {text: handle for axes in page.axes for handle, text in zip(*axes.get_legend_handles_labels(), strict=True)}
            page.legend(list(handles.values()), list(handles))
    return page.figure


def _require_fit(label: str, count: int, panels: Sequence[tuple[str, Curves]], notes: Sequence[str]) -> None:
    if count == 0 or not panels or not all(curves for _, curves in panels):
        raise InvtrackError(f"expected at least one point and one curve in every panel, got {count} values of {label}")
    for quantity, curves in panels:
        for name, curve in curves.items():
            if len(curve) != count:
                raise InvtrackError(f"curve {name!r} of {quantity} has {len(curve)} points for {count} values of {label}")
    if notes and len(notes) != count:
        raise InvtrackError(f'expected a note for each of {count} points ("" for none), got {len(notes)} notes')


def _mark_notes(axes: Axes, values: Array, curves: Curves, notes: Sequence[str], *, written: bool) -> None:
    """A ring around every noted point of every curve, and with `written` the note beside the first curve that has the point."""
    ring: dict[str, Any] = {
        "linestyle": "none",
        "marker": "o",
        "markersize": 8.0,
        "markerfacecolor": "none",
        "markeredgecolor": INK,
    }
    table = np.array([np.asarray(curve, dtype=float) for curve in curves.values()])  # (curves, points)
    for i, note in enumerate(notes):
        shown = table[np.isfinite(table[:, i]), i]
        if not note or not shown.size:
            continue
        axes.plot(np.full(len(shown), values[i]), shown, **ring)
        if written:
            first = next(row for row in table if np.isfinite(row[i]))
            _write_note(
                axes, note, (values[i], first[i]), ascending=_ascends(values, first), right=values[i] <= np.nanmedian(values)
            )


def _ascends(values: Array, curve: Array) -> bool:
    """Whether a curve tends upward to the right."""
    known = np.flatnonzero(np.isfinite(curve))
    first, last = known[np.argmin(values[known])], known[np.argmax(values[known])]
    return bool(curve[last] > curve[first])


def _write_note(axes: Axes, note: str, point: tuple[float, float], *, ascending: bool, right: bool) -> None:
    """Beside the point, towards the middle of the panel and where a curve with this slope leaves room."""
    above = right != ascending
    axes.annotate(
        note,
        point,
        xytext=(NOTE_OFFSET if right else -NOTE_OFFSET, NOTE_OFFSET if above else -NOTE_OFFSET),
        textcoords="offset points",
        ha="left" if right else "right",
        va="bottom" if above else "top",
        fontsize=7.5,
        color=INK,
    )
