"""The look that all figures share, and how they reach the disk."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from itertools import product
from pathlib import Path
from typing import Any

import matplotlib
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from invtrack.files import replaced_when_complete

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
    "axes.prop_cycle": cycler(color=COLORS),
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


def shared_style() -> AbstractContextManager[None]:
    """The context in which every figure is drawn; matplotlib's settings are as before outside it."""
    return matplotlib.rc_context({**matplotlib.rcParamsDefault, **_STYLE})


def new_figure(title: str, *, width: float = 8.0, height: float) -> Figure:
    """An empty figure of `width` x `height` inches whose panels keep clear of each other, of its title and of its edges."""
    figure = Figure(figsize=(width, height), layout=ConstrainedLayoutEngine(w_pad=PADDING, h_pad=PADDING))
    figure.suptitle(title, x=0.01, ha="left", fontweight="bold")
    return figure


def line_looks(count: int) -> list[dict[str, str]]:
    """Colour and line style of each of `count` lines, distinct up to 18 of them."""
    looks = [{"color": color, "linestyle": style} for style, color in product(LINE_STYLES, COLORS)]
    return [looks[i % len(looks)] for i in range(count)]


def label(name: str, unit: str) -> str:
    """A channel's name with its unit, "tip position [m]"; the name alone where the unit is not known."""
    words = name.replace("_", " ")
    return f"{words} [{unit}]" if unit else words


def write(axes: Axes, text: str, at: tuple[float, float], coordinates: Any, offset: tuple[float, float], **look: Any) -> None:
    """Small text at a point of a panel's `coordinates`, moved by `offset` points."""
    look = {"color": INK, "fontsize": 8, **look}
    axes.annotate(text, at, xycoords=coordinates, xytext=offset, textcoords="offset points", **look)


def join_units(units: Sequence[str]) -> str:
    """The distinct units of several channels, in their order; "?" for one that is not known."""
    return ", ".join(dict.fromkeys(unit or "?" for unit in units))


def save_figure(figure: Figure, path: str | Path) -> Path:
    """Write a figure as PNG in one piece, at 150 dots per inch, and return its path.

    Raises FileError where the file cannot be written.
    """
    with shared_style(), replaced_when_complete(path) as draft:
        figure.savefig(draft, format="png", dpi=DPI)
    return Path(path)
