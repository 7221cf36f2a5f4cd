"""Figures of one run show what the run holds: its samples, names, units, marks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes

from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.figures import comparison_figure, preactuation_figure, tracking_figure
from invtrack.figures.style import COLORS
from invtrack.results import RunResult, preactuation_time
from invtrack.results.result import Signal
from tests.figures.drawn import error_sizes, legend_entries, line_named, points, texts
from tests.synthetic_runs import GROWTH_RATE, JUMP, MANOEUVRE, PEAK_INPUT, TwoModes, diverged, two_mode_run


@pytest.fixture(scope="module")
def run() -> RunResult:
    return two_mode_run(modes=TwoModes(slow=1e-3, fast=2e-4))


def panel(axes: list[Axes], ylabel: str) -> Axes:
    (found,) = [candidate for candidate in axes if candidate.get_ylabel() == ylabel]
    return found


def test_panels_of_states_output_error_and_input_with_their_units(run: RunResult) -> None:
    axes = tracking_figure(run).axes
    labels = ["states [m]", "states [m/s]", "$y - y_d$ [m]", "tip position [m]", "$|y - y_d|$ [m]", "base force [N]"]
    assert [one.get_ylabel() for one in axes] == labels
    assert [one.get_xlabel() for one in axes] == ["", "", "time [s]", "", "", "time [s]"]
    assert [one.get_yscale() for one in axes] == ["linear", "linear", "linear", "linear", "log", "linear"]


def test_the_lines_are_the_samples_of_the_run(run: RunResult) -> None:
    start, end = MANOEUVRE
    axes = tracking_figure(run, window=(2 * start - end, 2 * end - start)).axes
    shown = (run.time > 2 * start - end) & (run.time < 2 * end - start)
    for ylabel, name, values in (
        ("states [m]", "base", run.state["base"]),
        ("states [m/s]", "tip_velocity", run.state["tip_velocity"]),
        ("tip position [m]", "tip_position", run.output["tip_position"]),
    ):
        time, drawn = points(line_named(panel(axes, ylabel), name))
        inside = (time > 2 * start - end) & (time < 2 * end - start)
        np.testing.assert_array_equal(time[inside], run.time[shown])
        np.testing.assert_array_equal(drawn[inside], values[shown])
    _, wanted, *_ = panel(axes, "tip position [m]").get_lines()
    time, drawn = points(wanted)
    np.testing.assert_array_equal(drawn, run.reference["tip_position"][np.searchsorted(run.time, time)])
    time, drawn = points(panel(axes, "$|y - y_d|$ [m]").get_lines()[0])
    np.testing.assert_array_equal(drawn, error_sizes(run, time))
    time, drawn = points(panel(axes, "$y - y_d$ [m]").get_lines()[0])
    np.testing.assert_array_equal(drawn, run.error[np.searchsorted(run.time, time), 0])


def test_what_is_wanted_lies_pale_beneath_the_line_that_follows_it_in_the_same_colour(run: RunResult) -> None:
    axes = panel(tracking_figure(run).axes, "states [m]")
    for name in ("tip", "base"):
        line = line_named(axes, name)
        (pale,) = [each for each in axes.get_lines() if each.get_color() == line.get_color() and each is not line]
        assert pale.get_zorder() < line.get_zorder()
        assert pale.get_linewidth() > 2 * line.get_linewidth()
        time, drawn = points(pale)
        np.testing.assert_array_equal(drawn, run.state_reference[name][np.searchsorted(run.time, time)])


def test_channels_of_different_units_have_panels_of_their_own(run: RunResult) -> None:
    both = Signal(np.column_stack([run.output.values, run.output.values]), Channels(("tip", "yaw"), ("m", "rad")))
    mixed = replace(run, output=both, reference=both, planned_output=both)
    labels = [axes.get_ylabel() for axes in tracking_figure(mixed).axes]
    assert {"tip [m]", "yaw [rad]", "$y - y_d$ [m]", "$y - y_d$ [rad]", "$|y - y_d|$ [m]", "$|y - y_d|$ [rad]"} <= set(labels)


def test_an_input_holds_from_its_time_to_the_next(run: RunResult) -> None:
    line = line_named(panel(tracking_figure(run).axes, "base force [N]"), "base_force")
    assert line.get_drawstyle() == "steps-post"
    time, drawn = points(line)
    np.testing.assert_array_equal(drawn, run.applied["base_force"][np.searchsorted(run.time, time)])
    whole = line_named(panel(tracking_figure(run, window=(10.0, 16.0)).axes, "base force [N]"), "base_force")
    time, drawn = points(whole)
    assert time[-1] == run.time[-1]
    assert drawn[-1] == drawn[-2] == run.applied["base_force"][-1]


def test_a_commanded_input_is_drawn_where_it_differs_from_the_applied_one(run: RunResult) -> None:
    def entries(result: RunResult) -> list[str]:
        return legend_entries(panel(tracking_figure(result).axes, "base force [N]"))

    clamped = replace(run, applied=replace(run.applied, values=np.clip(run.applied.values, -10.0, 10.0)))
    assert entries(run) == []
    assert entries(clamped) == ["base_force", "commanded"]


def test_legends_name_the_states_and_what_is_wanted(run: RunResult) -> None:
    axes = tracking_figure(run).axes
    assert legend_entries(panel(axes, "states [m]")) == ["tip", "base", "plan"]
    assert legend_entries(panel(axes, "tip position [m]")) == ["tip_position", "reference"]


@pytest.mark.parametrize("count", [4, 14])
def test_legends_with_many_long_names_lie_within_their_panels_above_the_lines(run: RunResult, count: int) -> None:
    names = tuple(f"r_forearm_roll_joint_{i} velocity" for i in range(count))
    channels = Channels(names, count * ("rad/s",))
    values = np.repeat(run.state.values[:, :1], count, axis=1)
    figure = tracking_figure(replace(run, state=Signal(values, channels), state_reference=Signal(values, channels)))
    figure.draw_without_rendering()
    axes = panel(figure.axes, "states [rad/s]")
    legend = axes.get_legend()
    assert legend is not None
    inside, around = legend.get_window_extent(), axes.get_window_extent()
    assert around.width > 0.3 * figure.bbox.width
    assert around.x0 <= inside.x0
    assert inside.x1 <= around.x1
    highest = max(np.max(points(line)[1]) for line in axes.get_lines())
    assert axes.transData.transform((0.0, highest))[1] <= inside.y0 + 1  # a pixel of rounding


def test_parameters_and_the_manoeuvre_are_marked(run: RunResult) -> None:
    shown = [text.replace("\n", " = ", 1) if "kg" in text and "=" not in text else text for text in texts(tracking_figure(run))]
    for expected in ("tip_mass = 0 kg", "tip_mass = 100 kg", "$T_i$", "$T_f$"):
        assert shown.count(expected) == 2  # above both columns
    marks = [line.get_xdata() for line in tracking_figure(run).axes[0].get_lines()]
    assert {float(np.asarray(x)[0]) for x in marks if len(np.unique(x)) == 1} == set(MANOEUVRE)


def test_preactuation_is_marked_where_the_metric_finds_it(run: RunResult) -> None:
    figure = preactuation_figure(run, level=0.02)
    (axes,) = figure.axes
    assert (axes.get_xlabel(), axes.get_ylabel(), axes.get_yscale()) == ("time [s]", r"$|u - u_\mathrm{rest}|$ [N]", "log")
    expected = preactuation_time(run, level=0.02)
    assert expected == pytest.approx(-np.log(0.02 * PEAK_INPUT) / GROWTH_RATE, abs=0.02)
    assert f"preactuation time {expected:.3g} s" in texts(figure)
    (arrow,) = [text for text in axes.texts if text.get_text() == "" and hasattr(text, "xy")]
    assert arrow.xyann[0] - arrow.xy[0] == pytest.approx(expected)
    (level,) = [line for line in axes.get_lines() if line.get_color() == COLORS[1]]
    np.testing.assert_allclose(points(level)[1], 0.02 * np.max(run.applied.values))
    time, drawn = points(axes.get_lines()[0])
    growing = time < MANOEUVRE[0]
    np.testing.assert_allclose(np.diff(np.log(drawn[growing])), GROWTH_RATE * np.diff(time[growing]), rtol=1e-9)


def test_a_level_that_is_no_share_is_refused(run: RunResult) -> None:
    with pytest.raises(InvtrackError, match=r"level, .* must lie between 0 and 1, got 2"):
        preactuation_figure(run, level=2.0)


def test_an_error_of_exactly_zero_is_said_to_be_so(run: RunResult) -> None:
    assert "exactly zero" in texts(tracking_figure(replace(run, output=run.reference)))
    silent = replace(run, applied=replace(run.applied, values=np.zeros_like(run.applied.values)))
    assert "exactly zero" in texts(preactuation_figure(silent))


@pytest.mark.parametrize("amplitude", [1e6, 1e200])
def test_a_diverged_run_is_drawn_up_to_its_last_finite_sample(run: RunResult, amplitude: float) -> None:
    broken = diverged(run, at=5.0, amplitude=amplitude)
    for figure in (tracking_figure(broken), comparison_figure([run, broken]), preactuation_figure(broken)):
        figure.draw_without_rendering()  # every axis has finite limits and ticks
    _, drawn = points(line_named(panel(tracking_figure(broken).axes, "tip position [m]"), "tip_position"))
    assert drawn[-2:].tolist() == [amplitude, np.inf]


def test_windows_outside_the_run_are_refused(run: RunResult) -> None:
    with pytest.raises(InvtrackError, match="cannot show the times"):
        tracking_figure(run, window=(20.0, 30.0))
    for window in ((3.0, 3.0), (5.0, 1.0), (float("nan"), 1.0)):
        with pytest.raises(InvtrackError, match=r"window must be \(start, end\)|window \[s\] must be finite"):
            tracking_figure(run, window=window)


def test_the_default_window_holds_the_preactuation_and_what_follows(run: RunResult) -> None:
    start, end = MANOEUVRE
    low, high = tracking_figure(run).axes[0].get_xlim()
    assert low < start - preactuation_time(run) < start < end < high <= end + (end - low)
    assert low > run.time[0]
    assert tracking_figure(two_mode_run(start=-0.1, end=4.5)).axes[0].get_xlim() == (-0.1, 4.5)
    assert tracking_figure(run, window=(JUMP, 3.0)).axes[0].get_xlim() == (JUMP, 3.0)


def test_preactuation_is_drawn_from_rest_and_says_why_there_is_none(run: RunResult) -> None:
    loaded = replace(run, applied=replace(run.applied, values=run.applied.values + 7.0), rest_inputs=np.full((2, 1), 7.0))
    (axes,), (unloaded,) = preactuation_figure(loaded).axes, preactuation_figure(run).axes
    np.testing.assert_allclose(points(axes.get_lines()[0])[1], points(unloaded.get_lines()[0])[1], rtol=1e-9, atol=1e-12)
    late = texts(preactuation_figure(two_mode_run(start=-0.2)))
    assert "preactuation time 0.2 s, at least: the input is above 1 % of its peak from the run's start on" in late
    moving = texts(preactuation_figure(replace(run, rest_inputs=np.full((2, 1), np.nan))))
    assert "no preactuation time: the input is not at rest before the manoeuvre: the plan goes on moving there" in moving
