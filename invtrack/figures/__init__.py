"""Figures of runs, plans and computed curves, all in one look."""

from invtrack.figures.comparison import around_figure, comparison_figure
from invtrack.figures.curves import Line, overlay_figure, plan_figure
from invtrack.figures.decay import Decay, decay_figure
from invtrack.figures.distributions import bands_figure, histogram_figure, tornado_figure
from invtrack.figures.frequency import frequency_response_figure
from invtrack.figures.preactuation import preactuation_figure
from invtrack.figures.saving import save_figure, svg_text
from invtrack.figures.sweep import sweep_figure
from invtrack.figures.tracking import column_figure, tracking_figure
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
