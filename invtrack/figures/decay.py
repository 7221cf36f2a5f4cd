"""Errors that should die out at a known rate, beside that rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from invtrack.errors import InvtrackError
from invtrack.figures.panels import draw_line, draw_magnitudes
from invtrack.figures.style import REFERENCE, line_looks, new_figure, shared_style

Array = NDArray[np.float64]

INCHES_PER_PANEL = 2.0


@dataclass(frozen=True, eq=False)
class Decay:
    """An error over time: values (m,) at times (m,) [s], named with its unit, and the rate [1/s] at which it should fall."""

    label: str
    time: Array
    values: Array
    rate: float

    def expected(self) -> Array:
        """exp(-rate t) through the error's largest value, so measured, in the second half of the time (m,)."""
        since = self.time - self.time[0]
        late = since >= since[-1] / 2
        height = np.max(np.abs(self.values[late]) * np.exp(self.rate * (since[late] - since[-1])))
        return np.asarray(height * np.exp(self.rate * (since[-1] - since)))


def decay_figure(title: str, decays: Sequence[Decay]) -> Figure:
    """Magnitudes on logarithmic axes, one panel each, with the exponential of the stated rate dashed.

    Raises InvtrackError for no decays, or for one of fewer than two samples or of unequal numbers of times and values.
    """
    if not decays:
        raise InvtrackError("expected at least one error to show, got none")
    for decay in decays:
        if len(decay.time) < 2 or len(decay.time) != len(decay.values):
            raise InvtrackError(
                f"{decay.label!r} has {len(decay.time)} times and {len(decay.values)} values, expected two or more of both"
            )
    with shared_style():
        figure = new_figure(title, width=8.0, height=0.9 + INCHES_PER_PANEL * len(decays))
        panels = figure.subplots(len(decays), 1, squeeze=False)[:, 0]
        for axes, decay in zip(panels, decays, strict=True):
            look = line_looks(1)[0]
            draw_magnitudes(axes, [(decay.time, decay.values, {**look, "label": "error"})])
            low, high = axes.get_ylim()
            draw_line(axes, decay.time, decay.expected(), label=f"exp(-{decay.rate:.3g} t)", **REFERENCE)
            axes.set_ylim(low, high)
            axes.set_xlim(decay.time[0], decay.time[-1])
            axes.set_ylabel(decay.label)
            axes.set_xlabel("time [s]")
            axes.legend(loc="upper right")
    return figure
