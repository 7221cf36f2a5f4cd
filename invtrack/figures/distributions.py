"""What many runs have in common: bands of an error over time, what it goes with, how it is distributed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import by_name, items, require_text
from invtrack.arrays import Array, finite_number, increasing_times, real_numbers, whole_number
from invtrack.errors import InvtrackError
from invtrack.figures.marks import mark_manoeuvre
from invtrack.figures.panels import ends_of, values_of
from invtrack.figures.sheet import sheet
from invtrack.figures.style import COLORS, DOTTED, FAINT, INK, label, write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

BANDS = (50.0, 90.0)  # share [%] of the runs that a band holds, in its middle
BINS = 40
DECADES = 3.0  # of a positive quantity, from which on its histogram has a logarithmic axis
INCHES_PER_BAR = 0.34


def bands_figure(
    title: str,
    *,
    time: ArrayLike,
    values: ArrayLike,
    quantity: str,
    bands: Sequence[float] = BANDS,
    manoeuvre: tuple[float, float] | None = None,
    ax: AxesGiven | None = None,
) -> Figure:
    """Median of many runs over time, bands around it that hold so many per cent of them, and the lowest and highest of all.

    Args:
        title: of the figure.
        time: (m,) [s], increasing.
        values: (runs, m); where one is NaN the run is not counted at that time.
        quantity: label of the vertical axis, with its unit.
        bands: per cent of the runs in each band, half of the others above and half below it.
        manoeuvre: its start and end [s], marked.
        ax: a panel to draw on in place of a figure of its own.

    Raises InvtrackError for shapes that do not fit, bands outside 0 to 100 %, where no run has a value, and for several panels.
    """
    for name, text in (("title", title), ("quantity", quantity)):
        require_text(name, text, error=InvtrackError)
    times = increasing_times("time", time, error=InvtrackError)
    runs = real_numbers("values", values, error=InvtrackError)
    if runs.ndim != 2 or runs.shape[1] != len(times):
        raise InvtrackError(f"expected values (runs, {len(times)}), one for each time, got shape {runs.shape}")
    given = items("bands", bands, expected="a list of per cent, such as [50, 90]", error=InvtrackError)
    shares = sorted((finite_number("a band", band, unit="%", error=InvtrackError) for band in given), reverse=True)
    if not all(0 < share < 100 for share in shares):
        raise InvtrackError(f"expected bands that hold between 0 and 100 % of the runs, got {shares}")
    counted = np.any(np.isfinite(runs), axis=0)
    if not np.any(counted):
        raise InvtrackError("expected at least one run with values, got none")
    t, shown = times[counted], np.where(np.isfinite(runs), runs, np.nan)[:, counted]
    ends = None if manoeuvre is None else ends_of(manoeuvre)
    with sheet(title, [quantity], ax, size=(8.0, 3.6)) as page:
        (axes,) = page.axes
        axes.plot(t, np.nanmin(shown, axis=0), color=FAINT, linewidth=0.7, label=f"lowest and highest of {len(runs)} runs")
        axes.plot(t, np.nanmax(shown, axis=0), color=FAINT, linewidth=0.7)
        for share, shade in zip(shares, np.linspace(0.2, 0.45, len(shares)), strict=True):
            low, high = np.nanpercentile(shown, [50 - share / 2, 50 + share / 2], axis=0)
            axes.fill_between(t, low, high, color=COLORS[0], alpha=shade, linewidth=0, label=f"{share:g} % of the runs")
        axes.plot(t, np.nanmedian(shown, axis=0), color=COLORS[1], label="median")
        if ends is not None:
            mark_manoeuvre(axes, ends, labelled=True)
        axes.set_xlim(t[0], t[-1])
        axes.set_ylabel(quantity)
        page.legend(*axes.get_legend_handles_labels())
    return page.figure


def tornado_figure(
    title: str, *, correlations: Mapping[str, float], samples: int, quantity: str, ax: AxesGiven | None = None
) -> Figure:
    """Rank correlations of parameters with a quantity as bars, the strongest on top, and what chance alone would give.

    Args:
        title: of the figure.
        correlations: Spearman's rank correlation by the names of parameters, from -1 to 1, as `invtrack.sweeps.rank_correlations`
            gives it.
        samples: how many runs they are of: 95 % of the correlations of what does not matter lie in the shaded part,
            +-1.96/sqrt(samples - 1).
        quantity: its name.
        ax: a panel to draw on in place of a figure of its own.

    Raises InvtrackError for no correlations, one outside -1 to 1, and for several panels.
    """
    for name, text in (("title", title), ("quantity", quantity)):
        require_text(name, text, error=InvtrackError)
    given = by_name("correlations", correlations, expected="rank correlations by the names of parameters", error=InvtrackError)
    found = {name: finite_number(f"correlation of {name!r}", value, error=InvtrackError) for name, value in given.items()}
    count = whole_number("samples", samples, lowest=2, error=InvtrackError)
    if not found or not all(-1.000001 < value < 1.000001 for value in found.values()):
        raise InvtrackError(f"expected at least one correlation, all from -1 to 1, got {found}")
    names = sorted(found, key=lambda name: abs(found[name]))
    along = f"rank correlation (Spearman) with {quantity}, {count} runs"
    with sheet(title, [quantity], ax, size=(7.0, 1.5 + INCHES_PER_BAR * len(names)), along=along) as page:
        (axes,) = page.axes
        chance = min(1.96 / np.sqrt(count - 1), 1.0)
        axes.axvspan(-chance, chance, color="#EDF1F5", linewidth=0, zorder=0, label="95 % of what does not matter")
        values = [found[name] for name in names]
        axes.barh(range(len(names)), values, height=0.6, color=[COLORS[0] if value >= 0 else COLORS[1] for value in values])
        for place, value in enumerate(values):
            look = {"ha": "left" if value >= 0 else "right", "va": "center"}
            write(axes, f"{value:+.2f}", (value, place), "data", (3 if value >= 0 else -3, 0), **look)
        axes.axvline(0.0, color=INK, linewidth=0.8)
        axes.set_yticks(range(len(names)), [label(name, "") for name in names])
        axes.set_xlim(-1.15, 1.15)
        axes.grid(visible=False, axis="y")
        axes.set_axisbelow(True)
        page.legend(*axes.get_legend_handles_labels())
    return page.figure


def histogram_figure(
    title: str, *, values: ArrayLike, quantity: str, limit: float | None = None, ax: AxesGiven | None = None
) -> Figure:
    """How often a quantity takes which values, with its median, the value that 95 % of the runs stay below, and a limit.

    Where all values are positive and span three decades or more, the axis is logarithmic.

    Args:
        title: of the figure.
        values: (runs,); NaN where it is not defined, which the title of the axis counts.
        quantity: label of the horizontal axis, with its unit.
        limit: the largest value that is allowed; the share of the runs above it is stated.
        ax: a panel to draw on in place of a figure of its own.

    Raises InvtrackError where no value is finite, and for several panels.
    """
    for name, text in (("title", title), ("quantity", quantity)):
        require_text(name, text, error=InvtrackError)
    given = values_of("values", values)
    shown = given[np.isfinite(given)]
    if not len(shown):
        raise InvtrackError(f"expected at least one value of {quantity} to count, got {len(given)} that are not finite")
    from matplotlib.ticker import MaxNLocator

    with sheet(title, [quantity], ax, size=(7.0, 3.4), along=quantity) as page:
        (axes,) = page.axes
        edges = _edges(shown)
        axes.set_axisbelow(True)
        axes.yaxis.set_major_locator(MaxNLocator(integer=True))
        axes.hist(shown, bins=edges.tolist(), color=COLORS[0], alpha=0.75)
        if _is_logarithmic(shown):
            axes.set_xscale("log")
        marks = {"median": float(np.median(shown)), "95 % stay below": float(np.percentile(shown, 95))}
        for (text, at), style in zip(marks.items(), ("-", "--"), strict=True):
            axes.axvline(at, color=COLORS[1], linestyle=style, linewidth=1.1, label=f"{text}: {at:.3g}")
        if limit is not None:
            level = finite_number("limit", limit, error=InvtrackError)
            above = np.count_nonzero(shown > level) / len(shown)
            axes.axvline(level, color=INK, linestyle=DOTTED, label=f"limit {level:.3g}: {above:.1%} above it")
        left_out = len(given) - len(shown)
        axes.set_ylabel(f"of {len(shown)} runs" + (f" ({left_out} without a value)" if left_out else ""))
        page.legend(*axes.get_legend_handles_labels())
    return page.figure


def _is_logarithmic(values: Array) -> bool:
    return bool(np.min(values) > 0 and np.max(values) / np.min(values) >= 10**DECADES)


def _edges(values: Array) -> Array:
    """Edges of bins, even on the axis that the values get."""
    low, high = float(np.min(values)), float(np.max(values))
    count = min(BINS, max(8, int(np.sqrt(len(values)))))
    if _is_logarithmic(values):
        return np.geomspace(low, high, count + 1)
    return np.histogram_bin_edges(values, bins=count)
