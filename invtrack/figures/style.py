"""The look that all figures share.

This room loads matplotlib, which takes as long as everything else together, when a figure is drawn and not before: a study names
its figures at its top, and reads its options and starts its first simulation without them.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Okabe and Ito's palette (2008), which stays distinct under the common colour-vision deficiencies, without its yellow, which is too
# faint for a line.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#56B4E9", "#E69F00")
DASHES: tuple[Any, ...] = (
    "-",
    (0, (5.0, 2.0)),
    (0, (1.2, 1.2)),
    (0, (7.0, 1.5, 1.2, 1.5)),
    (0, (2.6, 1.4)),
    (0, (9.0, 1.5, 1.2, 1.5, 1.2, 1.5)),
)
WIDEST, NARROWEST = 2.2, 1.2  # points, of the first and the last of several lines
INK = "#333333"
FAINT = "#8A8A8A"
SHADES = ("#FFFFFF", "#EDF1F5")
DOTTED = (0, (1.0, 2.0))
EXPECTED = {"color": INK, "linewidth": 0.9, "linestyle": (0, (4.0, 2.5))}
"""Look of what a line should be like, drawn over it."""

WANTED: dict[str, Any] = {"color": INK, "linewidth": 4.5, "alpha": 0.28, "solid_capstyle": "butt", "zorder": 1.5}
"""Look of what is wanted: wide and pale beneath the line that should follow it, in the same colour where there are several."""

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
    "legend.handlelength": 2.6,  # long enough for every pattern of dashes to be known by
    "lines.linewidth": 1.3,
    "text.color": INK,
    "xtick.color": INK,
    "xtick.labelsize": 8,
    "ytick.color": INK,
    "ytick.labelsize": 8,
}

INCHES_PER_CHARACTER = 0.062


def shared_style() -> AbstractContextManager[None]:
    """The context in which every figure is drawn; matplotlib's settings are as before outside it."""
    import matplotlib

    settings = {**matplotlib.rcParamsDefault, **_STYLE}
    del settings["backend"]  # it is no matter of style, and to choose one loads pyplot
    return matplotlib.rc_context(settings)


def line_looks(count: int) -> list[dict[str, Any]]:
    """Looks of `count` lines that may lie on top of each other, to be drawn in this order: all are to be seen there.

    Each is narrower than the one beneath it and has other gaps; distinct up to 36 of them.
    """
    step = (WIDEST - NARROWEST) / max(count - 1, 1)
    return [
        {
            "color": COLORS[i % len(COLORS)],
            "linestyle": DASHES[(i + i // len(COLORS)) % len(DASHES)],
            "linewidth": WIDEST - i * step if count > 1 else 1.3,
        }
        for i in range(count)
    ]


def channel_looks(count: int) -> list[dict[str, Any]]:
    """Looks of the `count` channels of one signal, which seldom coincide: by colour first; distinct up to 36 of them."""
    return [{"color": COLORS[i % len(COLORS)], "linestyle": DASHES[i // len(COLORS) % len(DASHES)]} for i in range(count)]


def label(name: str, unit: str) -> str:
    """A channel's name with its unit, "tip position [m]"; the name alone where the unit is not known."""
    return with_unit(name.replace("_", " "), unit)


def with_unit(text: str, unit: str) -> str:
    """A text with a unit behind it, if that is known and no plain number: "states [m]"."""
    return text if unit in ("", "1") else f"{text} [{unit}]"


def join_units(units: Sequence[str]) -> str:
    """The distinct units of several channels, in their order; "?" for one that is not known beside others, "" where none is."""
    return ", ".join(dict.fromkeys(unit or "?" for unit in units)) if any(units) else ""


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


def inches(text: str) -> float:
    """How wide a text in small print is, about."""
    return max(len(line) for line in text.split("\n")) * INCHES_PER_CHARACTER
