"""Figures of many runs: bands hold the share that they state, bars and marks stand where the numbers are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure

from invtrack.errors import InvtrackError
from invtrack.figures import bands_figure, histogram_figure, tornado_figure
from tests.figures.drawn import legend_entries, line_named, points, texts

TIME = np.linspace(0.0, 4.0, 41)


def scattered(runs: int = 2000) -> np.ndarray:
    """Runs whose error at time t is uniform from -t to t."""
    return np.random.default_rng(0).uniform(-1.0, 1.0, runs)[:, None] * TIME


def edges(band: FillBetweenPolyCollection, t: float) -> tuple[float, float]:
    """Lower and upper edge of a band at a time."""
    corners = band.get_paths()[0].vertices
    at = corners[np.isclose(corners[:, 0], t), 1]
    return float(at.min()), float(at.max())


def test_bands_hold_the_share_of_the_runs_that_they_state() -> None:
    figure = bands_figure("t", time=TIME, values=scattered(), quantity="$y - y_d$ [m]", manoeuvre=(1.0, 3.0))
    (axes,) = figure.axes
    wide, narrow = (band for band in axes.collections if isinstance(band, FillBetweenPolyCollection))
    for band, share in ((wide, 0.9), (narrow, 0.5)):
        low, high = edges(band, 2.0)
        assert (low, high) == pytest.approx((-2.0 * share, 2.0 * share), abs=0.12)  # of a uniform distribution from -2 to 2
    assert legend_entries(figure) == ["lowest and highest of 2000 runs", "90 % of the runs", "50 % of the runs", "median"]
    assert {"$T_i$", "$T_f$"} <= set(texts(figure))
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("time [s]", "$y - y_d$ [m]")


def test_runs_that_end_early_count_as_long_as_they_last() -> None:
    values = np.array([[1.0, 1.0, np.nan], [3.0, np.inf, np.nan]])
    time, median = points(line_named(bands_figure("t", time=[0.0, 1.0, 2.0], values=values, quantity="e").axes[0], "median"))
    assert (time.tolist(), median.tolist()) == ([0.0, 1.0], [2.0, 1.0])


def test_a_tornado_has_the_strongest_on_top_and_what_chance_gives() -> None:
    figure = tornado_figure("t", correlations={"tip_mass": 0.2, "instant": -0.8, "noise": 0.01}, samples=101, quantity="max error")
    (axes,) = figure.axes
    assert [label.get_text() for label in axes.get_yticklabels()] == ["noise", "tip mass", "instant"]
    chance, *bars = axes.patches
    assert [bar.get_width() for bar in bars] == [0.01, 0.2, -0.8]  # type: ignore[attr-defined]
    assert chance.get_width() == pytest.approx(2 * 0.196)  # type: ignore[attr-defined]
    assert "rank correlation (Spearman) with max error, 101 runs" in texts(figure)


def test_a_histogram_counts_all_runs_and_says_how_many_are_above_the_limit() -> None:
    values = np.append(np.arange(1.0, 101.0), [np.nan, np.nan])
    figure = histogram_figure("t", values=values, quantity="residual vibration [m]", limit=90.0)
    (axes,) = figure.axes
    assert sum(patch.get_height() for patch in axes.patches) == 100  # type: ignore[attr-defined]
    assert legend_entries(figure) == ["median: 50.5", "95 % stay below: 95", "limit 90: 10.0% above it"]
    assert axes.get_ylabel() == "of 100 runs (2 without a value)"
    assert axes.get_xscale() == "linear"
    assert histogram_figure("t", values=np.geomspace(1e-6, 1e-2, 50), quantity="q").axes[0].get_xscale() == "log"
    assert isinstance(histogram_figure("t", values=[2.0, 2.0], quantity="q"), Figure)


@pytest.mark.parametrize(
    ("draw", "message"),
    [
        (lambda: bands_figure("t", time=TIME, values=np.zeros((3, 4)), quantity="q"), r"expected values \(runs, 41\)"),
        (
            lambda: bands_figure("t", time=TIME, values=np.full((3, 41), np.nan), quantity="q"),
            "expected at least one run with values",
        ),
        (lambda: bands_figure("t", time=TIME, values=scattered(3), quantity="q", bands=[100.0]), "between 0 and 100 %"),
        (lambda: tornado_figure("t", correlations={}, samples=9, quantity="q"), "expected at least one correlation"),
        (lambda: tornado_figure("t", correlations={"a": 1.5}, samples=9, quantity="q"), "all from -1 to 1"),
        (lambda: histogram_figure("t", values=[np.nan], quantity="q"), "expected at least one value of q to count"),
    ],
)
def test_what_cannot_be_drawn_is_refused(draw: Callable[[], Figure], message: str) -> None:
    with pytest.raises(InvtrackError, match=message):
        draw()
