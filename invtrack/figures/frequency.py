"""Curves over frequency."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import count
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arguments import by_name, flag, require_text
from invtrack.arrays import Array, ComplexArray, complex_numbers
from invtrack.errors import InvtrackError
from invtrack.figures.panels import values_of
from invtrack.figures.sheet import sheet
from invtrack.figures.style import line_looks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

PHASE, PHASE_TICKS = "phase [degrees]", 7


def frequency_response_figure(
    title: str,
    *,
    w: Array,
    curves: Mapping[str, ComplexArray],
    magnitude: str,
    phase: bool = True,
    ax: AxesGiven | None = None,
) -> Figure:
    """Magnitude on logarithmic axes and, below it, the continuous phase of each curve.

    The phase starts between -270 and 90 degrees: a double integrator's at -180.

    Args:
        title: of the figure.
        w: frequencies (m,) [rad/s], positive and increasing.
        curves: {name: response (m,)}.
        magnitude: label of the upper axis, with its unit.
        phase: whether the phase is shown.
        ax: panels to draw on in place of a figure of its own, two, or one without the phase.

    Raises InvtrackError where frequencies are not positive or not in order, where lengths differ, and for another number of
    panels in `ax`.
    """
    flag("phase", phase, error=InvtrackError)
    for name, words in (("title", title), ("magnitude", magnitude)):
        require_text(name, words, error=InvtrackError)
    w = values_of("frequencies w [rad/s]", w)
    given = by_name("curves", curves, expected="responses by the names of curves", error=InvtrackError)
    curves = {name: complex_numbers(f"curve {name!r}", curve, error=InvtrackError) for name, curve in given.items()}
    if not curves or len(w) < 2 or not w[0] > 0 or not np.all(np.diff(w) > 0) or not np.isfinite(w[-1]):
        raise InvtrackError("expected at least one curve over two or more positive frequencies that increase")
    for name, curve in curves.items():
        if np.shape(curve) != np.shape(w):
            raise InvtrackError(f"curve {name!r} has shape {np.shape(curve)}, expected one value for each of {len(w)} frequencies")
    titles, shares = ([magnitude, PHASE], [1.5, 1.0]) if phase else ([magnitude], [1.0])
    size = (8.0, 4.8 if phase else 3.4)
    with sheet(title, titles, ax, size=size, shares=shares, along="frequency [rad/s]") as page:
        for (name, curve), look in zip(curves.items(), line_looks(len(curves)), strict=True):
            page.axes[0].loglog(w, np.abs(curve), label=name, **look)
            if phase:
                page.axes[1].semilogx(w, _phase(curve), **look)
        page.axes[0].margins(x=0.0)
        page.axes[0].set_ylabel(magnitude)
        if phase:
            from matplotlib.ticker import MultipleLocator

            page.axes[1].margins(x=0.0)
            page.axes[1].set_ylabel(PHASE)
            page.axes[1].yaxis.set_major_locator(MultipleLocator(_phase_step(page.axes[1])))
        if len(curves) > 1:
            page.legend(*page.axes[0].get_legend_handles_labels())
    return page.figure


def _phase_step(axes: Axes) -> float:
    """Degrees between ticks: the least part or multiple of a quarter turn that gives no more than PHASE_TICKS of them."""
    low, high = axes.get_ylim()
    return next(step for step in (math.ldexp(45.0, k) for k in count()) if high - low <= PHASE_TICKS * step)


def _phase(curve: ComplexArray) -> Array:
    """Continuous phase [degrees]; a lead of more than a quarter turn at the lowest frequency counts as a lag."""
    phase = np.degrees(np.unwrap(np.angle(curve)))
    return np.asarray(phase - 360.0 if phase[0] > 90.0 + 1e-6 else phase)
