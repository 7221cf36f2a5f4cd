"""Figures of several runs share their axes, show every run, and say what is wrong with a request."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.figures import around_figure, comparison_figure
from invtrack.results import RunResult, preactuation_time
from tests.figures.drawn import error_sizes, legend_entries, line_named, points, texts
from tests.synthetic_runs import JUMP, TwoModes, two_mode_run

TIMES = {"start": 0.0, "jump": JUMP}


@pytest.fixture(scope="module")
def runs() -> list[RunResult]:
    return [
        two_mode_run(modes=TwoModes(slow=1e-3, fast=2e-4)),
        replace(two_mode_run(modes=TwoModes(slow=1e-6, fast=2e-7)), name="better"),
    ]


def test_outputs_errors_and_inputs_with_units_and_a_legend_of_the_runs(runs: list[RunResult]) -> None:
    figure = comparison_figure(runs, window=(-2.0, 6.0))
    outputs, errors, inputs = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["tip position [m]", "$|y - y_d|$ [m]", "base force [N]"]
    assert [axes.get_yscale() for axes in figure.axes] == ["linear", "log", "linear"]
    assert (inputs.get_xlabel(), inputs.get_xlim()) == ("time [s]", (-2.0, 6.0))
    assert legend_entries(figure) == [*(run.name for run in runs), "reference"]
    time, drawn = points(line_named(outputs, "reference"))
    np.testing.assert_array_equal(drawn, runs[0].reference.values[np.searchsorted(runs[0].time, time), 0])
    for number, run in enumerate(runs):
        line = line_named(errors, run.name)
        time, drawn = points(line)
        np.testing.assert_array_equal(drawn, error_sizes(run, time))
        assert line.get_color() == inputs.get_lines()[number].get_color()


def test_the_error_of_several_outputs_is_the_largest_of_them(runs: list[RunResult]) -> None:
    def twice(run: RunResult, factor: float) -> RunResult:
        def two(signal: object, values: np.ndarray) -> object:
            return replace(signal, values=values, channels=Channels(["a", "b"], ["m", "m"]))  # type: ignore[type-var]

        wanted = np.repeat(run.reference.values, 2, axis=1)
        return replace(
            run,
            output=two(run.output, wanted + run.error * [1.0, factor]),  # type: ignore[arg-type]
            reference=two(run.reference, wanted),  # type: ignore[arg-type]
        )

    _, drawn = points(comparison_figure([twice(runs[0], -3.0)]).axes[2].get_lines()[0])
    _, single = points(comparison_figure([runs[0]]).axes[1].get_lines()[0])
    np.testing.assert_allclose(drawn, 3.0 * single, rtol=1e-9, atol=1e-14)


def test_a_run_without_error_is_said_to_be_so_or_leaves_room_for_others(runs: list[RunResult]) -> None:
    perfect = replace(runs[0], output=runs[0].reference, name="perfect")
    assert "exactly zero" in texts(comparison_figure([perfect, replace(perfect, name="too")]))
    mixed = comparison_figure([perfect, runs[0]])
    assert "exactly zero" not in texts(mixed)
    low, high = mixed.axes[1].get_ylim()
    assert 0 < low < high
    assert high > np.abs(runs[0].error).max()


def test_a_run_that_is_to_do_something_else_has_its_reference_in_its_own_colour(runs: list[RunResult]) -> None:
    half = replace(runs[0], reference=replace(runs[0].reference, values=0.5 * runs[0].reference.values), name="half")
    for other, expected in ((half, 1), (replace(runs[1], time=runs[1].time + 1e-9), 0)):
        outputs = comparison_figure([runs[0], other]).axes[0]
        color = line_named(outputs, other.name).get_color()
        pale = [line for line in outputs.get_lines() if line.get_color() == color and line.get_label() != other.name]
        assert len(pale) == expected


def test_runs_that_coincide_are_all_to_be_seen(runs: list[RunResult]) -> None:
    same = [replace(runs[0], name=f"run {number}") for number in range(4)]
    lines = [line_named(comparison_figure(same).axes[0], run.name) for run in same]
    widths, patterns = [line.get_linewidth() for line in lines], {str(line.get_linestyle()) for line in lines}
    assert widths == sorted(widths, reverse=True)
    assert len(set(widths)) == 4
    assert lines[0].get_linestyle() == "-"
    assert len(patterns) > 1


def test_a_run_that_fails_leaves_the_panel_of_the_output(runs: list[RunResult]) -> None:
    values = runs[0].output.values.copy()
    values[runs[0].time > 2.0] = 1e6
    low, high = (
        comparison_figure([runs[0], replace(runs[0], output=replace(runs[0].output, values=values), name="off")]).axes[0].get_ylim()
    )
    span = np.ptp(runs[0].reference.values)
    assert high - low <= 2.5 * span


def test_preactuation_is_shown_unless_a_window_is_given(runs: list[RunResult]) -> None:
    low, high = comparison_figure(runs).axes[0].get_xlim()
    start, end = runs[0].manoeuvre
    assert low < start - max(preactuation_time(run) for run in runs)
    assert end < high <= end + (end - low)


def test_runs_that_do_not_fit_are_refused(runs: list[RunResult]) -> None:
    with pytest.raises(InvtrackError, match="at least one run"):
        comparison_figure([])
    other = replace(
        runs[0], name="rig", applied=replace(runs[0].applied, channels=Channels(runs[0].applied.channels.names, ["N m"]))
    )
    for draw in (comparison_figure, lambda both: around_figure(both, times=TIMES, before=0.2, after=0.2)):
        with pytest.raises(InvtrackError, match=r"'rig' has the applied channels base_force \[N m\], expected .* \[N\]"):
            draw([runs[0], other])


def test_a_column_for_each_time(runs: list[RunResult]) -> None:
    figure = around_figure(runs, times=TIMES, before=0.2, after=0.4)
    assert len(figure.axes) == 2 * len(TIMES)
    for column, (name, time) in enumerate(TIMES.items()):
        errors, inputs = figure.axes[column], figure.axes[column + len(TIMES)]
        assert errors.get_title(loc="left") == f"{name}, {time:.4g} s"
        assert errors.get_xlim() == inputs.get_xlim() == pytest.approx((time - 0.2, time + 0.4))
        assert inputs.get_xlabel() == "time [s]"
        for run in runs:
            shown, drawn = points(line_named(errors, run.name))
            np.testing.assert_array_equal(drawn, error_sizes(run, shown))
            assert shown[0] <= time - 0.2 < time + 0.4 <= shown[-1]
    assert [axes.get_ylabel() for axes in figure.axes] == ["$|y - y_d|$ [m]", "", "base force [N]", ""]
    assert legend_entries(figure) == [run.name for run in runs]


@pytest.mark.parametrize("length", [4, 25, 60])
def test_the_legend_stays_in_the_figure_whatever_the_runs_are_called(runs: list[RunResult], length: int) -> None:
    named = [replace(runs[0], name=f"{'x' * length} {number}") for number in range(4)]
    figure = comparison_figure(named)
    figure.draw_without_rendering()
    (legend,) = figure.legends
    assert legend_entries(figure) == [*(run.name for run in named), "reference"]
    assert 0 <= legend.get_window_extent().x0 < legend.get_window_extent().x1 <= figure.bbox.width
    lines = {round(text.get_window_extent().y0) for text in legend.get_texts()}
    assert (len(lines) == 1) == (length == 4)


def test_the_error_axis_holds_the_errors_of_all_columns(runs: list[RunResult]) -> None:
    """Scaled to the last column alone, larger errors elsewhere would be cut off."""
    quiet = replace(runs[0], output=replace(runs[0].output, values=runs[0].reference.values + 1e-9), name="quiet")
    late = quiet.time > JUMP + 0.3
    values = quiet.output.values.copy()
    values[~late] += runs[0].error[~late]
    mixed = replace(quiet, output=replace(quiet.output, values=values))
    figure = around_figure([mixed], times={"jump": JUMP, "later": JUMP + 0.6}, before=0.2, after=0.2)
    low, high = figure.axes[0].get_ylim()
    shown = np.abs(mixed.error[(mixed.time > JUMP - 0.2) & (mixed.time < JUMP + 0.2)]).max()
    assert low < 1e-9
    assert high > shown


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"times": {}}, "at least one time"),
        ({"before": 0.0}, "before must be a positive number of seconds, got 0"),
        ({"times": {"never": 1e6}}, "cannot show the times"),
    ],
)
def test_bad_requests_are_refused(runs: list[RunResult], options: dict[str, object], message: str) -> None:
    with pytest.raises(InvtrackError, match=message):
        around_figure(runs, **{"times": TIMES, "before": 0.2, "after": 0.2, **options})  # type: ignore[arg-type]
