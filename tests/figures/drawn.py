"""What a figure shows, read back from it."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

from invtrack.results import RunResult

Array = NDArray[np.float64]


def texts(figure: Figure) -> list[str]:
    """Every text in the figure: titles, labels, legends, marks."""
    return [artist.get_text() for artist in figure.findobj(Text)]


def legend_entries(where: Axes | Figure) -> list[str]:
    """The entries of a panel's own legend, or of the figure's."""
    legends = where.legends if isinstance(where, Figure) else [where.get_legend()]
    return [text.get_text() for legend in legends if legend is not None for text in legend.get_texts()]


def points(line: Line2D) -> tuple[Array, Array]:
    """Horizontal and vertical values of a line."""
    return np.asarray(line.get_xdata(), dtype=float), np.asarray(line.get_ydata(), dtype=float)


def line_named(axes: Axes, name: str) -> Line2D:
    """The panel's line with this label."""
    (line,) = [line for line in axes.get_lines() if line.get_label() == name]
    return line


def error_sizes(run: RunResult, times: Array) -> Array:
    """|y - y_d| of a run with one output at some of its times, NaN where it is zero: a logarithmic axis has no place for that."""
    sizes = np.abs(run.error[np.searchsorted(run.time, times), 0])
    return np.where(sizes > 0, sizes, np.nan)
