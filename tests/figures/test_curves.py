"""Curves of one's own: what is drawn is what was given, and what does not fit is refused."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

import invtrack
from invtrack.errors import InvtrackError
from invtrack.figures import Decay, decay_figure, frequency_response_figure, overlay_figure, plan_figure, sweep_figure
from tests.cited_plants import cantilever_paper
from tests.figures.drawn import legend_entries, line_named, points, texts

ComplexArray = NDArray[np.complex128]

TIME = np.linspace(1.0, 9.0, 801)


def test_overlaid_curves_keep_their_look_and_limits_are_drawn() -> None:
    times = np.linspace(0.0, 10.0, 101)
    panels = [
        ("angle [rad]", {"wanted": (times, times), "exact": (times, 2 * times)}),
        ("motor [1]", {"exact": (times, np.sin(times))}),
    ]
    figure = overlay_figure("t", panels=panels, wanted="wanted", window=(2.0, 4.0), limits={"motor [1]": (-0.5, 0.5)})
    upper, lower = figure.axes
    wanted, exact = (line_named(upper, name) for name in ("wanted", "exact"))
    assert wanted.get_zorder() < exact.get_zorder()
    assert wanted.get_linewidth() > 2 * exact.get_linewidth()
    assert exact.get_color() == lower.lines[0].get_color() != wanted.get_color()
    shown = np.asarray(exact.get_xdata(), dtype=float)
    assert 1.9 <= shown[0] <= 2.0
    assert 4.0 <= shown[-1] <= 4.1 + 1e-9
    assert [line.get_ydata()[0] for line in lower.lines[1:]] == [-0.5, 0.5]  # type: ignore[index]
    assert lower.get_xlabel() == "time [s]"
    assert legend_entries(figure) == ["exact", "wanted", "limit"]


def test_the_manoeuvre_is_marked_where_it_is_given() -> None:
    times = np.linspace(0.0, 10.0, 101)
    panels = [("y [m]", {"a": (times, times)}), ("u [N]", {"a": (times, times)})]
    for manoeuvre, expected in (((2.0, 4.0), [2.0, 4.0]), (None, [])):
        figure = overlay_figure("t", panels=panels, manoeuvre=manoeuvre)
        for axes in figure.axes:
            assert [float(np.asarray(line.get_xdata())[0]) for line in axes.lines if line.get_label() != "a"] == expected
        assert [name for name in texts(figure) if name in ("$T_i$", "$T_f$")] == ["$T_i$", "$T_f$"][: len(expected)]
    with pytest.raises(InvtrackError, match=r"manoeuvre must be \(start, end\) \[s\]"):
        overlay_figure("t", panels=panels, manoeuvre=(4.0, 2.0))


def test_overlays_that_do_not_fit_are_refused() -> None:
    times = np.arange(3.0)
    with pytest.raises(InvtrackError, match="curve 'a' of u has 2 values at 3 times"):
        overlay_figure("t", panels=[("u", {"a": (times, times[:2])})])
    with pytest.raises(InvtrackError, match="panel 'u' has no curve"):
        overlay_figure("t", panels=[("u", {})])
    with pytest.raises(InvtrackError, match=r"limits of the panels \['u'\], got \['v'\]"):
        overlay_figure("t", panels=[("u", {"a": (times, times)})], limits={"v": (-1.0, 1.0)})


def test_frequency_response_of_a_double_lag() -> None:
    w = np.geomspace(0.01, 100.0, 401)
    figure = frequency_response_figure("t", w=w, curves={"lag": 1 / (1 + 1j * w) ** 2}, magnitude="|G| [1]")
    upper, lower = figure.axes
    assert (upper.get_ylabel(), lower.get_ylabel(), lower.get_xlabel()) == ("|G| [1]", "phase [degrees]", "frequency [rad/s]")
    np.testing.assert_allclose(np.asarray(upper.lines[0].get_ydata(), dtype=float), 1 / (1 + w**2))
    np.testing.assert_allclose(np.asarray(lower.lines[0].get_ydata(), dtype=float), -2 * np.degrees(np.arctan(w)))
    assert lower.get_yticks()[1:-1].tolist() == [-180.0, -135.0, -90.0, -45.0, 0.0]  # parts of a turn
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


def test_a_sweep_has_a_line_and_markers_of_one_colour_for_each_curve() -> None:
    values = [1.0, 2.0, 4.0]
    curves = {"change": [0.3, 0.2, 0.1], "input": [0.9, 0.7, 0.4]}
    measured = {"change": [0.31, 0.21, 0.11]}
    figure = sweep_figure("t", label="duration [s]", values=values, predicted=curves, measured=measured, quantity="share [1]")
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("duration [s]", "share [1]")
    line, markers, other = axes.lines
    assert line.get_color() == markers.get_color() != other.get_color()
    assert (line.get_linestyle(), markers.get_linestyle(), markers.get_marker()) == ("-", "None", "o")
    for drawn, expected in ((line, curves["change"]), (markers, measured["change"]), (other, curves["input"])):
        assert [side.tolist() for side in points(drawn)] == [values, expected]
    assert legend_entries(figure) == ["change, predicted", "change, measured", "input, predicted"]


def test_what_was_only_measured_is_joined_up_on_logarithmic_axes() -> None:
    figure = sweep_figure(
        "t", label="way [m]", values=[1.0, 10.0], predicted={}, measured={"a": [1e-6, 1e-5]}, quantity="error [1]", logarithmic=True
    )
    (axes,) = figure.axes
    (line,) = axes.lines
    assert (axes.get_xscale(), axes.get_yscale(), line.get_linestyle(), line.get_marker()) == ("log", "log", "-", "o")
    assert legend_entries(figure) == ["a, measured"]


def test_sweeps_of_another_length_are_refused() -> None:
    with pytest.raises(InvtrackError, match=r"curve 'change' has 2 points for 1 values of duration \[s\]"):
        sweep_figure("t", label="duration [s]", values=[1.0], predicted={"change": [1.0, 2.0]}, measured={}, quantity="share [1]")


def test_the_exponential_touches_the_error_from_above() -> None:
    values = np.exp(-0.7 * TIME) * np.cos(5 * TIME) + np.exp(-4 * TIME)
    expected = Decay("error [m]", TIME, values, rate=0.7).expected()
    late = TIME >= 5.0
    assert np.all(expected[late] >= np.abs(values)[late] * (1 - 1e-12))
    assert np.min(expected[late] / np.abs(values)[late]) == pytest.approx(1.0)
    assert np.polyfit(TIME, np.log(expected), 1)[0] == pytest.approx(-0.7)


def test_a_panel_for_each_error_with_its_unit_and_rate() -> None:
    decays = [Decay("estimate [1]", TIME, -np.exp(-3 * TIME), 3.0), Decay("output [m]", TIME, np.exp(-0.1 * TIME), 0.1)]
    figure = decay_figure("decay", decays)
    for axes, decay in zip(figure.axes, decays, strict=True):
        assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_yscale()) == ("time [s]", decay.label, "log")
        assert legend_entries(axes) == ["error", f"exp(-{decay.rate:g} t)"]
        error, exponential = axes.get_lines()
        np.testing.assert_array_equal(points(error)[1], np.abs(decay.values))
        np.testing.assert_array_equal(points(exponential)[1], decay.expected())


def test_decays_that_cannot_be_drawn_are_refused() -> None:
    with pytest.raises(InvtrackError, match="at least one error"):
        decay_figure("decay", [])
    with pytest.raises(InvtrackError, match="800 values at 801 times"):
        Decay("output [m]", TIME, TIME[1:], 1.0)
    with pytest.raises(InvtrackError, match="1 times and values, expected two or more"):
        Decay("output [m]", TIME[:1], TIME[:1], 1.0)


def test_a_plan_is_drawn_with_both_sides_of_its_jumps() -> None:
    light, heavy = (
        invtrack.StateSpace(*cantilever_paper(mass), inputs=["force"], outputs=invtrack.Channels(["tip"], ["m"]))
        for mass in (0.0, 9.0)
    )
    plan = invtrack.invert(invtrack.SwitchedSystem([light, heavy], [2.0]), invtrack.raised_cosine(2.0), tolerance=1e-4)
    figure = plan_figure(plan, states=["x2"], window=(-1.0, 7.0))
    output, force, state = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["tip [m]", "force", "x2"]
    assert legend_entries(figure) == ["stable inversion", "wanted"]
    t, y = points(line_named(output, "wanted"))
    assert y == pytest.approx(plan.reference(t)[:, 0], abs=1e-9)
    t, u = points(line_named(force, "stable inversion"))
    sides = [plan(2.0, inside=side).u[0, 0] for side in (1.9, 2.1)]
    assert u[t == 2.0] == pytest.approx(np.array(sides), rel=1e-9)
    assert sides[0] != pytest.approx(sides[1], rel=0.1)
    assert points(state.lines[0])[1] == pytest.approx(plan(points(state.lines[0])[0]).x[:, 1], abs=1e-9)
    half = invtrack.quadratic_redesign(plan.model, plan.reference, R=1e-5, Q_y=1.0, tolerance=1e-4)
    both = plan_figure({"exact": plan, "half the force": half})
    assert legend_entries(both) == ["exact", "half the force", "wanted"]


def test_plans_that_do_not_fit_a_figure_are_refused() -> None:
    model = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
    other = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], inputs=["torque"])
    one, two = (invtrack.invert(each, invtrack.rest_to_rest(0.0, 1.0, duration=1.0)) for each in (model, other))
    with pytest.raises(InvtrackError, match="at least one plan"):
        plan_figure({})
    with pytest.raises(InvtrackError, match="plan 'b' leads from torque to y1, the first one from u1 to y1"):
        plan_figure({"a": one, "b": two})
    with pytest.raises(InvtrackError, match="no channel is named 'z'; there are: x1, x2"):
        plan_figure(one, states=["z"])
