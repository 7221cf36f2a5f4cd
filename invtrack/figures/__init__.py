"""Figures of runs, plans and computed curves, all in one look."""

from invtrack.figures.comparison import around_figure, comparison_figure
from invtrack.figures.curves import Decay, Line, decay_figure, frequency_response_figure, overlay_figure, sweep_figure
from invtrack.figures.style import save_figure
from invtrack.figures.tracking import preactuation_figure, tracking_figure
from invtrack.figures.trade_off import trade_off_figure

__all__ = [
    "Decay",
    "Line",
    "around_figure",
    "comparison_figure",
    "decay_figure",
    "frequency_response_figure",
    "overlay_figure",
    "preactuation_figure",
    "save_figure",
    "sweep_figure",
    "tracking_figure",
    "trade_off_figure",
]
