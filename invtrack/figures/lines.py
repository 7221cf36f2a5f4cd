"""Signals as lines: thinned to what can be seen, held from step to step, or by their size on a logarithmic axis."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from invtrack.arrays import Array
from invtrack.figures.style import FAINT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MAX_BINS = 1500  # about one for each pixel that a panel is wide

DECADES_SHOWN = 16  # below the peak: what is smaller than that is rounding in double precision

DIPS_HIDDEN = 0.005  # part of the samples that may lie below the axis: where an error changes sign its logarithm has no bound


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
