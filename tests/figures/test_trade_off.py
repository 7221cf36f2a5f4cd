"""What one quantity costs in others: what is drawn is what was given, and what does not fit is refused."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import InvtrackError
from invtrack.figures import trade_off_figure
from tests.figures.drawn import legend_entries, texts

ERRORS = ("largest error [rad]", [0.1, 0.2, 0.4])
PANELS = [
    ("peak input [N]", {"stiff": [9.0, 5.0, 2.0], "soft": [8.0, 4.0, np.nan]}),
    ("preactuation [s]", {"stiff": [3.0, 2.0, 1.0]}),
]


def test_panels_share_the_axis_and_hold_the_points() -> None:
    figure = trade_off_figure("t", horizontal=ERRORS, panels=PANELS, notes=["", "chosen", ""])
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("peak input [N]", "preactuation [s]")
    assert (upper.get_xlabel(), lower.get_xlabel()) == ("", "largest error [rad]")
    assert upper.get_xlim() == lower.get_xlim()
    np.testing.assert_array_equal(np.asarray(upper.lines[0].get_xdata()), ERRORS[1])
    np.testing.assert_array_equal(np.asarray(upper.lines[1].get_ydata()), [8.0, 4.0, np.nan])
    assert upper.lines[0].get_color() == lower.lines[0].get_color()
    assert texts(figure).count("chosen") == 1
    assert legend_entries(figure) == ["stiff", "soft"]


def test_noted_points_are_marked_on_every_curve_that_has_them() -> None:
    figure = trade_off_figure("t", horizontal=ERRORS, panels=PANELS, notes=["", "chosen", "cheap"])
    rings = [
        [np.asarray(line.get_ydata()).tolist() for line in axes.lines[count:]]
        for axes, count in zip(figure.axes, (2, 1), strict=True)
    ]
    assert rings == [[[5.0, 4.0], [2.0]], [[2.0], [1.0]]]


@pytest.mark.parametrize(("curve", "above"), [([9.0, 5.0, 2.0], True), ([2.0, 5.0, 9.0], False)])
def test_a_note_stands_where_the_curve_leaves_room(curve: list[float], above: bool) -> None:
    figure = trade_off_figure("t", horizontal=ERRORS, panels=[("y [1]", {"c": curve})], notes=["left", "", ""])
    (note,) = figure.axes[0].texts
    assert (note.get_verticalalignment() == "bottom") is above


def test_axes_can_be_logarithmic() -> None:
    figure = trade_off_figure("t", horizontal=ERRORS, panels=PANELS, horizontal_log=True, vertical_log=True)
    assert {(axes.get_xscale(), axes.get_yscale()) for axes in figure.axes} == {("log", "log")}
    figure.draw_without_rendering()
    low, high = figure.axes[-1].get_xlim()
    labels = {label.get_position()[0]: label.get_text() for label in figure.axes[-1].get_xticklabels(minor=True)}
    shown = [text for place, text in labels.items() if low <= place <= high]
    assert shown == [r"$\mathdefault{2\times10^{-1}}$"]


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InvtrackError, match=r"curve 'a' of u \[N\] has 2 points for 3 values of largest error"):
        trade_off_figure("t", horizontal=ERRORS, panels=[("u [N]", {"a": [1.0, 2.0]})])
    with pytest.raises(InvtrackError, match="a note for each of 3 points"):
        trade_off_figure("t", horizontal=ERRORS, panels=PANELS, notes=["one"])
    for horizontal, panels in ((("e", []), PANELS), (ERRORS, []), (ERRORS, [("u [N]", {})])):
        with pytest.raises(InvtrackError, match="at least one point and one curve in every panel"):
            trade_off_figure("t", horizontal=horizontal, panels=panels)
