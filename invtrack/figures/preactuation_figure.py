"""The input before the manoeuvre, which exact inversion of a nonminimum-phase plant cannot do without."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from invtrack.figures.panels import draw_magnitudes
from invtrack.figures.style import COLORS, FAINT, INK, join_units, new_figure, shared_style, write
from invtrack.results.result import RunResult


def preactuation_figure(result: RunResult, *, preactuation_time: float, level: float = 0.01) -> Figure:
    """|u| before the manoeuvre on a logarithmic axis, with `level` times its peak and the preactuation time marked.

    |u| is the Euclidean norm of the applied inputs. `preactuation_time` [s] is the metric of that name, taken at the same `level`.
    A straight line is an exponential: its slope is the real part of the zero that sets the preactuation.
    """
    start, end = result.manoeuvre
    magnitude = np.hypot.reduce(np.abs(result.applied.values), axis=1)  # no squares: they overflow in a run that diverges
    finite = magnitude[np.isfinite(magnitude)]
    peak = float(finite.max()) if len(finite) else 0.0
    middle = (result.time[:-1] + result.time[1:]) / 2
    lead = min(start - float(result.time[0]), max(3 * preactuation_time, end - start))
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
        axes.set_ylabel(f"$|u|$ [{unit}]")
        axes.axvline(start, color=FAINT, linewidth=0.8, linestyle=(0, (1, 2)))
        write(axes, "$T_i$", (start, 1), axes.get_xaxis_transform(), (0, 1), ha="center", va="bottom")
        if peak > 0:
            axes.axhline(level * peak, color=COLORS[1], linewidth=1, linestyle="--")
            text = f"{100 * level:g} % of the peak {size}"
            write(axes, text, (0, level * peak), axes.get_yaxis_transform(), (4, 3), color=COLORS[1])
        if preactuation_time > 0 and peak > 0:
            height = level * peak * 0.4
            arrow = {"arrowstyle": "<->", "color": INK, "linewidth": 0.9, "shrinkA": 0, "shrinkB": 0}
            axes.annotate("", (start - preactuation_time, height), (start, height), arrowprops=arrow)
            text = f"preactuation time {preactuation_time:.3g} s"
            write(axes, text, (start, height), "data", (-3, -4), ha="right", va="top")
    return figure
