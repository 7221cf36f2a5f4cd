"""The input of one run before its manoeuvre."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from invtrack.figures.lines import draw_magnitudes
from invtrack.figures.marks import mark_time
from invtrack.figures.sheet import sheet
from invtrack.figures.style import COLORS, INK, join_units, with_unit, write
from invtrack.results.inputs import actuation_time
from invtrack.results.result import RunResult, require_run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

ARROW = 0.12  # height of the arrow in the panel
BEHIND_TEXT = {"facecolor": "white", "alpha": 0.85, "edgecolor": "none", "pad": 1.5}


def preactuation_figure(result: RunResult, *, level: float = 0.01, ax: AxesGiven | None = None) -> Figure:
    """|u - u_rest| before the manoeuvre on a logarithmic axis, with `level` times its peak and the preactuation time marked.

    The Euclidean norm of the applied inputs, from those with which the plan rests before the manoeuvre; the time is that of
    `invtrack.results.preactuation_time` at this level, or the reason why there is none. A straight line is an exponential: its
    slope is the real part of the zero that sets the preactuation. ax: a panel to draw on in place of a figure of its own.

    Raises InvtrackError unless 0 < level < 1, and for several panels.
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
    lead = min(start - float(result.time[0]), max(1.6 * lasting, end - start))
    window = (start - lead, start + 0.15 * max(lead, end - start))
    shown = (middle >= window[0]) & (middle <= window[1])
    unit = join_units(result.applied.channels.units)
    size = f"{peak:.3g}" if unit in ("", "1") else f"{peak:.3g} {unit}"
    quantity = with_unit(r"$|u - u_\mathrm{rest}|$", unit)
    title = f"{result.model}: {result.name}, input before the manoeuvre"
    with sheet(title, [quantity], ax, size=(8.0, 3.4)) as page:
        (axes,) = page.axes
        draw_magnitudes(axes, [(middle[shown], magnitude[shown], {"color": COLORS[0]})], peak=peak or None)
        axes.set_xlim(*window)
        axes.set_ylabel(quantity)
        mark_time(axes, start)
        write(axes, "$T_i$", (start, 1), axes.get_xaxis_transform(), (0, 1), ha="center", va="bottom")
        if peak > 0:
            axes.axhline(level * peak, color=COLORS[1], linewidth=1, linestyle="--")
            text = f"{100 * level:g} % of the peak {size}"
            write(axes, text, (0, level * peak), axes.get_yaxis_transform(), (4, 3), color=COLORS[1], bbox=BEHIND_TEXT)
        if lasting > 0 and peak > 0:
            arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
            height = axes.get_xaxis_transform()
            axes.annotate("", (start - lasting, ARROW), (start, ARROW), xycoords=height, textcoords=height, arrowprops=arrow)
            text, middle_of = f"preactuation time {lasting:.3g} s", start - lasting / 2
            write(axes, text, (middle_of, ARROW), height, (0, 4), ha="center", va="bottom", bbox=BEHIND_TEXT)
        if found.note:
            said = "no preactuation time: " if found.value is None else f"preactuation time {found.value:.3g} s, "
            write(axes, said + found.note, (0, 1), axes.transAxes, (4, -4), va="top", bbox=BEHIND_TEXT)
    return page.figure
