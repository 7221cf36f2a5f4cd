"""The look that all figures share, and the panels that they are made of.

This room loads matplotlib, which takes as long as everything else together, when a figure is drawn and not before: a study names
its figures at its top, and reads its options and starts its first simulation without them.
"""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from contextlib import AbstractContextManager
from itertools import count, pairwise, product
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree

import numpy as np

from invtrack.arguments import file_path, instance, require_text
from invtrack.arrays import Array
from invtrack.errors import InvtrackError
from invtrack.figures.panels import window_of
from invtrack.files import replaced_when_complete
from invtrack.results.result import RunResult

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 150
PADDING = 0.06  # inches around each panel with its labels

# Okabe and Ito's palette (2008), which stays distinct under the common colour-vision deficiencies, without its yellow, which is too
# faint for a line.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
LINE_STYLES = ("-", "--", ":")
INK = "#333333"
FAINT = "#8A8A8A"
SHADES = ("#FFFFFF", "#EDF1F5")
REFERENCE = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4, 2.5))}

_STYLE: dict[Any, Any] = {
    "axes.edgecolor": FAINT,
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.linewidth": 0.7,
    "axes.prop_cycle": f"cycler(color={list(COLORS)})",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9,
    "figure.facecolor": "white",
    "figure.titlesize": 11,
    "font.family": "DejaVu Sans",  # comes with matplotlib: the same picture on every machine
    "font.size": 9,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.5,
    "legend.fontsize": 8,
    "legend.frameon": False,
    "legend.handlelength": 1.6,
    "lines.linewidth": 1.3,
    "text.color": INK,
    "xtick.color": INK,
    "xtick.labelsize": 8,
    "ytick.color": INK,
    "ytick.labelsize": 8,
}

_REFERENCE = re.compile(r"#([^)\"]+)")
_numbers = count(1)
"""Figures of one page have ids of their own."""

for _prefix, _space in (("", "http://www.w3.org/2000/svg"), ("xlink", "http://www.w3.org/1999/xlink")):
    ElementTree.register_namespace(_prefix, _space)

MAX_BINS = 1500  # about one for each pixel that a panel is wide

DECADES_SHOWN = 16  # below the peak: what is smaller than that is rounding in double precision

DIPS_HIDDEN = 0.005  # part of the samples that may lie below the axis: where an error changes sign its logarithm has no bound

INCHES_PER_CHARACTER = 0.062


def shared_style() -> AbstractContextManager[None]:
    """The context in which every figure is drawn; matplotlib's settings are as before outside it."""
    import matplotlib

    return matplotlib.rc_context({**matplotlib.rcParamsDefault, **_STYLE})


def new_figure(title: str, *, width: float = 8.0, height: float) -> Figure:
    """An empty figure of `width` x `height` inches whose panels keep clear of each other, of its title and of its edges."""
    from matplotlib.figure import Figure
    from matplotlib.layout_engine import ConstrainedLayoutEngine

    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=PADDING, h_pad=PADDING))
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    return figure


def legend_below(figure: Figure, handles: Sequence[Any], labels: Sequence[str], *, columns: int = 4) -> None:
    """A legend of all panels below them, in as many columns, up to `columns`, as fit beside each other."""
    for number in range(columns, 0, -1):
        legend = figure.legend(handles, labels, loc="outside lower left", ncols=number)
        if number == 1 or legend.get_window_extent().width <= figure.bbox.width:
            return
        legend.remove()


def line_looks(count: int) -> list[dict[str, str]]:
    """Colour and line style of each of `count` lines, distinct up to 18 of them."""
    looks = [{"color": color, "linestyle": style} for style, color in product(LINE_STYLES, COLORS)]
    return [looks[i % len(looks)] for i in range(count)]


def label(name: str, unit: str) -> str:
    """A channel's name with its unit, "tip position [m]"; the name alone where the unit is not known."""
    words = name.replace("_", " ")
    return f"{words} [{unit}]" if unit else words


def write(axes: Axes, text: str, at: tuple[float, float], coordinates: Any, offset: tuple[float, float], **look: Any) -> None:
    """Small text at a point of a panel.

    Args:
        axes, text: the panel, and what is written into it.
        at: the point, in `coordinates`.
        coordinates: a coordinate system of matplotlib's: a name such as "data", or a transform.
        offset: from the point to the text [points], (right, up).
        look: further properties of the text, or others in place of the usual ones.
    """
    look = {"color": INK, "fontsize": 8, **look}
    axes.annotate(text, at, xycoords=coordinates, xytext=offset, textcoords="offset points", **look)


def join_units(units: Sequence[str]) -> str:
    """The distinct units of several channels, in their order; "?" for one that is not known."""
    return ", ".join(dict.fromkeys(unit or "?" for unit in units))


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG in one piece, at 150 dots per inch, and return its path.

    Raises InvtrackError for what is no figure, FileError where the file cannot be written.
    """
    from matplotlib.figure import Figure

    instance("figure", figure, Figure, expected="a figure, such as tracking_figure(result)", error=InvtrackError)
    target = file_path(path)
    with shared_style(), replaced_when_complete(target) as draft:
        figure.savefig(draft, format="png", dpi=DPI)
    return target


def svg_text(figure: Figure, *, title: str) -> str:
    """A figure as an <svg> element for a page: it takes the width that it is given, and `title` is read to who does not see it.

    Raises InvtrackError for what is no figure.
    """
    from matplotlib.figure import Figure

    instance("figure", figure, Figure, expected="a figure, such as tracking_figure(result)", error=InvtrackError)
    require_text("title", title, error=InvtrackError)
    drawn = io.StringIO()
    with shared_style():
        figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    element = ElementTree.fromstring(drawn.getvalue())
    for name in ("width", "height"):
        element.attrib.pop(name, None)
    prefix = f"f{next(_numbers)}-"
    ids = {each.attrib["id"] for each in element.iter() if "id" in each.attrib}
    element.attrib |= {"role": "img", "aria-label": title}
    for each in list(element):  # what matplotlib says of itself
        if each.tag.endswith("metadata"):
            element.remove(each)
    for each in element.iter():
        for name, value in each.attrib.items():
            named = value if name == "id" else ""
            each.attrib[name] = prefix + named if named else _REFERENCE.sub(lambda found: _renamed(found[1], ids, prefix), value)
    return ElementTree.tostring(element, encoding="unicode")


def _renamed(name: str, ids: set[str], prefix: str) -> str:
    """A reference to an element of the figure, if it is one."""
    return f"#{prefix}{name}" if name in ids else f"#{name}"


def envelope(time: Array, values: Array, *, bins: int = MAX_BINS) -> tuple[Array, Array]:
    """Fewer samples of one channel, (N,) each, that draw the same picture: first, last, smallest and largest of each bin.

    Extrema are kept with their own times; samples that are not finite are left out of a bin that has others. A short signal
    comes back as it is.
    """
    if len(time) <= 4 * bins:
        return time, values
    edges = np.linspace(0, len(time), bins + 1).astype(int)
    finite = np.isfinite(values)
    low, high = np.where(finite, values, np.inf), np.where(finite, values, -np.inf)
    kept = [[a, a + int(np.argmin(low[a:b])), a + int(np.argmax(high[a:b])), b - 1] for a, b in pairwise(edges)]
    index = np.unique(kept)
    return time[index], values[index]


def draw_line(axes: Axes, time: Array, values: Array, **look: Any) -> None:
    """One channel as a line, thinned to what can be seen."""
    axes.plot(*envelope(time, values), **look)


def draw_steps(axes: Axes, time: Array, values: Array, **look: Any) -> None:
    """One channel as a staircase: each value holds from its time until the next; a last time without a value ends the last step."""
    held = np.append(values, values[-1:]) if len(values) < len(time) else values
    axes.plot(*envelope(time, held), drawstyle="steps-post", **look)


def draw_magnitudes(axes: Axes, lines: Sequence[tuple[Array, Array, dict[str, Any]]], *, peak: float | None = None) -> None:
    """Magnitudes of several channels (time, values, look) on one logarithmic axis.

    A value that is exactly zero has no place on the axis and leaves a gap; where all are zero the panel says so.
    """
    magnitudes = [np.where(values != 0, np.abs(values), np.nan) for _, values, _ in lines]
    positive = np.concatenate([m[np.isfinite(m)] for m in magnitudes])
    axes.set_yscale("log")
    if not len(positive):
        axes.set_ylim(1e-16, 1)
        axes.text(0.5, 0.5, "exactly zero", transform=axes.transAxes, ha="center", va="center", color=FAINT)
        return
    for (time, _, look), magnitude in zip(lines, magnitudes, strict=True):
        draw_line(axes, time, magnitude, **look)
    top = float(positive.max()) if peak is None else peak
    lowest = min(float(np.nanquantile(m, DIPS_HIDDEN)) for m in magnitudes if np.any(np.isfinite(m)))
    axes.set_ylim(min(max(lowest, top * 10.0**-DECADES_SHOWN), top / 10) / 3, top * 3)


def shown_window(result: RunResult, window: tuple[float, float] | None) -> tuple[float, float]:
    """The times to show: `window`, or the manoeuvre with its own length before and after it, as far as the run goes.

    Raises InvtrackError for a window that does not overlap the run.
    """
    first, last = float(result.time[0]), float(result.time[-1])
    start, end = result.manoeuvre
    low, high = window_of(window) if window is not None else (max(first, 2 * start - end), min(last, 2 * end - start))
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
    for time, name in zip(result.manoeuvre, ("$T_i$", "$T_f$"), strict=True):
        if low <= time <= high:
            axes.axvline(time, color=FAINT, linewidth=0.9, linestyle=(0, (1, 2)), zorder=1)
            if labelled:
                write(axes, name, (time, 1), axes.get_xaxis_transform(), (0, 1), ha="center", va="bottom")


def _write_above(axes: Axes, time: float, text: str, *, share: float) -> None:
    """Text above a panel and above the row of T_i and T_f; `share` is the part of the panel's width that it may take."""
    width = share * axes.figure.bbox.width / axes.figure.dpi
    if inches(text) > 0.85 * width:
        text = text.replace(" = ", "\n")
    if inches(text) > 1.2 * width:  # many short intervals: their shades alone must do
        return
    write(axes, text, (time, 1), axes.get_xaxis_transform(), (0, 13), ha="center", va="bottom", fontsize=7.5)


def inches(text: str) -> float:
    """How wide a text in small print is, about."""
    return max(len(line) for line in text.split("\n")) * INCHES_PER_CHARACTER
