"""Errors that should fall at a known rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from invtrack.arguments import instance, items, require_text
from invtrack.arrays import Array, finite_number
from invtrack.errors import InvtrackError
from invtrack.figures.lines import draw_line, draw_magnitudes
from invtrack.figures.panels import line_of
from invtrack.figures.sheet import legend_above_lines, sheet
from invtrack.figures.style import EXPECTED, line_looks

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from invtrack.figures.sheet import AxesGiven

INCHES_PER_PANEL = 2.0


@dataclass(frozen=True, eq=False)
class Decay:
    """An error over time: values (m,) at times (m,) [s], named with its unit, and the rate [1/s] at which it should fall.

    Raises InvtrackError for fewer than two samples, or unequal numbers of times and values.
    """

    label: str
    time: Array
    values: Array
    rate: float

    def __post_init__(self) -> None:
        time, values = line_of(f"error {require_text('label', self.label, error=InvtrackError)!r}", (self.time, self.values))
        if len(time) < 2:
            raise InvtrackError(f"error {self.label!r} has {len(time)} times and values, expected two or more")
        object.__setattr__(self, "time", time)
        object.__setattr__(self, "values", values)
        finite_number("rate", self.rate, unit="1/s", error=InvtrackError)

    def expected(self) -> Array:
        """The exponential of this rate that touches the error from above in the second half of the time, (m,)."""
        since = self.time - self.time[0]
        late = since >= since[-1] / 2
        height = np.max(np.abs(self.values[late]) * np.exp(self.rate * (since[late] - since[-1])))
        return np.asarray(height * np.exp(self.rate * (since[-1] - since)))


def decay_figure(title: str, decays: Sequence[Decay], *, ax: AxesGiven | None = None) -> Figure:
    """Magnitudes on logarithmic axes, one panel each, with the exponential of the stated rate dashed.

    ax: panels to draw on in place of a figure of its own, one for each.

    Raises InvtrackError for no decays, and for another number of panels in `ax`.
    """
    decays = items("decays", decays, expected="a list of Decay", error=InvtrackError)
    if not decays:
        raise InvtrackError("expected at least one error to show, got none")
    for decay in decays:
        instance("a decay", decay, Decay, expected="an invtrack.figures.Decay", error=InvtrackError)
    require_text("title", title, error=InvtrackError)
    titles = [decay.label for decay in decays]
    size = (8.0, 0.9 + INCHES_PER_PANEL * len(decays))
    with sheet(title, titles, ax, size=size, arranged=lambda figure: _apart(figure, len(decays))) as page:
        for axes, decay in zip(page.axes, decays, strict=True):
            draw_magnitudes(axes, [(decay.time, decay.values, {**line_looks(1)[0], "label": "error"})])
            low, high = axes.get_ylim()
            draw_line(axes, decay.time, decay.expected(), label=f"exp(-{decay.rate:.3g} t)", **EXPECTED)
            axes.set_ylim(low, high)
            axes.set_xlim(decay.time[0], decay.time[-1])
            axes.set_ylabel(decay.label)
            legend_above_lines(axes, *axes.get_legend_handles_labels())
    return page.figure


def _apart(figure: Figure, count: int) -> list[Axes]:
    """Panels above each other, each with times of its own."""
    return list(figure.subplots(count, 1, squeeze=False)[:, 0])
