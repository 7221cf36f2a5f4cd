"""Figures of runs, plans and computed curves, all in one look."""

from invtrack.figures.comparison import around_figure, comparison_figure
from invtrack.figures.curves import Decay, Line, decay_figure, frequency_response_figure, overlay_figure, plan_figure, sweep_figure
from invtrack.figures.distributions import bands_figure, histogram_figure, tornado_figure
from invtrack.figures.style import save_figure, svg_text
from invtrack.figures.tracking import column_figure, preactuation_figure, tracking_figure
from invtrack.figures.trade_off import trade_off_figure

__all__ = [
    "Decay",
    "Line",
    "around_figure",
    "bands_figure",
    "column_figure",
    "comparison_figure",
    "decay_figure",
    "frequency_response_figure",
    "histogram_figure",
    "overlay_figure",
    "plan_figure",
    "preactuation_figure",
    "save_figure",
    "svg_text",
    "sweep_figure",
    "tornado_figure",
    "tracking_figure",
    "trade_off_figure",
]
