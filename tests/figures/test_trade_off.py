"""Panels over a shared axis: what is drawn is what was given, and what does not fit is refused."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure
from numpy.typing import NDArray

from invtrack.errors import InvtrackError
from invtrack.figures.comparison import overlay_figure
from invtrack.figures.curves import frequency_response_figure
from invtrack.figures.style import save_figure
from invtrack.figures.trade_off_figure import trade_off_figure

ComplexArray = NDArray[np.complex128]

ERRORS = ("largest error [rad]", [0.1, 0.2, 0.4])
PANELS = [
    ("peak input [N]", {"stiff": [9.0, 5.0, 2.0], "soft": [8.0, 4.0, np.nan]}),
    ("preactuation [s]", {"stiff": [3.0, 2.0, 1.0]}),
]


def texts(figure: Figure) -> list[str]:
    return [artist.get_text() for artist in figure.findobj(matplotlib.text.Text)]


def test_panels_share_the_axis_and_hold_the_points(tmp_path: Path) -> None:
    figure = trade_off_figure("t", horizontal=ERRORS, panels=PANELS, notes=["", "chosen", ""])
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel()) == ("peak input [N]", "preactuation [s]")
    assert (upper.get_xlabel(), lower.get_xlabel()) == ("", "largest error [rad]")
    assert upper.get_xlim() == lower.get_xlim()
    np.testing.assert_array_equal(np.asarray(upper.lines[0].get_xdata()), ERRORS[1])
    np.testing.assert_array_equal(np.asarray(upper.lines[1].get_ydata()), [8.0, 4.0, np.nan])
    assert upper.lines[0].get_color() == lower.lines[0].get_color()
    assert texts(figure).count("chosen") == 1
    assert {"stiff", "soft"} <= set(texts(figure))
    save_figure(figure, tmp_path / "trade_off.png")


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


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InvtrackError, match=r"curve 'a' of u \[N\] has 2 points for 3 values of largest error"):
        trade_off_figure("t", horizontal=ERRORS, panels=[("u [N]", {"a": [1.0, 2.0]})])
    with pytest.raises(InvtrackError, match="a note for each of 3 points"):
        trade_off_figure("t", horizontal=ERRORS, panels=PANELS, notes=["one"])
    for horizontal, panels in ((("e", []), PANELS), (ERRORS, []), (ERRORS, [("u [N]", {})])):
        with pytest.raises(InvtrackError, match="at least one point and one curve in every panel"):
            trade_off_figure("t", horizontal=horizontal, panels=panels)


def test_overlaid_curves_keep_their_look_and_limits_are_drawn(tmp_path: Path) -> None:
    times = np.linspace(0.0, 10.0, 101)
    panels = [
        ("angle [rad]", {"wanted": (times, times), "exact": (times, 2 * times)}),
        ("motor [1]", {"exact": (times, np.sin(times))}),
    ]
    figure = overlay_figure("t", panels=panels, wanted="wanted", window=(2.0, 4.0), limits={"motor [1]": (-0.5, 0.5)})
    upper, lower = figure.axes
    wanted, exact = upper.lines
    assert wanted.get_zorder() > exact.get_zorder()
    assert exact.get_color() == lower.lines[0].get_color() != wanted.get_color()
    shown = np.asarray(exact.get_xdata(), dtype=float)
    assert 1.9 <= shown[0] <= 2.0
    assert 4.0 <= shown[-1] <= 4.1 + 1e-9
    assert [line.get_ydata()[0] for line in lower.lines[1:]] == [-0.5, 0.5]  # type: ignore[index]
    assert lower.get_xlabel() == "time [s]"
    assert texts(figure).count("limit") == 1
    save_figure(figure, tmp_path / "overlay.png")


def test_overlays_that_do_not_fit_are_refused() -> None:
    times = np.arange(3.0)
    with pytest.raises(InvtrackError, match="curve 'a' of u has 2 values at 3 times"):
        overlay_figure("t", panels=[("u", {"a": (times, times[:2])})])
    with pytest.raises(InvtrackError, match="panel 'u' has no curve"):
        overlay_figure("t", panels=[("u", {})])
    with pytest.raises(InvtrackError, match=r"limits of the panels \['u'\], got \['v'\]"):
        overlay_figure("t", panels=[("u", {"a": (times, times)})], limits={"v": (-1.0, 1.0)})


def test_frequency_response_of_a_double_lag(tmp_path: Path) -> None:
    w = np.geomspace(0.01, 100.0, 401)
    figure = frequency_response_figure("t", w=w, curves={"lag": 1 / (1 + 1j * w) ** 2}, magnitude="|G| [1]")
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel(), lower.get_xlabel()) == ("|G| [1]", "phase [degrees]", "frequency [rad/s]")
    np.testing.assert_allclose(np.asarray(upper.lines[0].get_ydata(), dtype=float), 1 / (1 + w**2))
    np.testing.assert_allclose(np.asarray(lower.lines[0].get_ydata(), dtype=float), -2 * np.degrees(np.arctan(w)))
    save_figure(figure, tmp_path / "response.png")
    assert len(frequency_response_figure("t", w=w, curves={"a": w + 0j}, magnitude="|G| [1]", phase=False).axes) == 1


@pytest.mark.parametrize(("response", "lowest"), [(lambda s: s, 90), (lambda s: 1 / s, -90), (lambda s: 1 / s**2, -180)])
def test_where_the_phase_begins(response: Callable[[ComplexArray], ComplexArray], lowest: float) -> None:
    """Whichever way rounding turns it: a pair of integrators lags."""
    w = np.geomspace(0.01, 100.0, 41)
    for turn in (1 + 1e-15j, 1 - 1e-15j):
        figure = frequency_response_figure("t", w=w, curves={"a": turn * response(1j * w)}, magnitude="|G| [1]")
        np.testing.assert_allclose(np.asarray(figure.axes[1].lines[0].get_ydata(), dtype=float), lowest, atol=1e-9)


def test_frequencies_that_make_no_sense_are_refused() -> None:
    for w in (np.array([0.0, 1.0]), np.array([2.0, 1.0]), np.array([1.0])):
        with pytest.raises(InvtrackError, match="two or more positive frequencies that increase"):
            frequency_response_figure("t", w=w, curves={"a": w + 0j}, magnitude="|G| [1]")
    with pytest.raises(InvtrackError, match=r"curve 'a' has shape \(1,\)"):
        frequency_response_figure("t", w=np.array([1.0, 2.0]), curves={"a": np.ones(1, complex)}, magnitude="|G| [1]")
