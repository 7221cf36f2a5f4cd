"""Close-ups share their axes, show every run in every column, and say what is wrong with a request."""

from __future__ import annotations

from dataclasses import replace

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from invtrack.errors import InvtrackError
from invtrack.figures.around import around_figure
from invtrack.results.result import RunResult
from tests.synthetic_runs import JUMP, TwoModes, two_mode_run

TIMES = {"start": 0.0, "jump": JUMP}


@pytest.fixture(scope="module")
def runs() -> list[RunResult]:
    return [
        two_mode_run(modes=TwoModes(slow=1e-3, fast=2e-4)),
        replace(two_mode_run(modes=TwoModes(slow=1e-6, fast=2e-7)), name="better"),
    ]


def texts(figure: Figure) -> str:
    return "\n".join(artist.get_text() for artist in figure.findobj(matplotlib.text.Text))


def test_a_column_for_each_time(runs: list[RunResult]) -> None:
    figure = around_figure(runs, times=TIMES, before=0.2, after=0.4)
    assert len(figure.axes) == 2 * len(TIMES)
    for axes, time in zip(figure.axes[:2], TIMES.values(), strict=True):
        assert axes.get_xlim() == pytest.approx((max(time - 0.2, runs[0].time[0]), time + 0.4))
        assert {line.get_label() for line in axes.get_lines()} >= {run.name for run in runs}
    for expected in (f"jump, {JUMP:.4g} s", "time [s]", "better"):
        assert expected in texts(figure)
    assert all(axes.get_ylabel().endswith("]") for axes in figure.axes[::2])


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
        ({"before": 0.0}, "at least one time and a positive span"),
        ({"times": {"never": 1e6}}, "cannot show the times"),
    ],
)
def test_bad_requests_are_refused(runs: list[RunResult], options: dict[str, object], message: str) -> None:
    with pytest.raises(InvtrackError, match=message):
        around_figure(runs, **{"times": TIMES, "before": 0.2, "after": 0.2, **options})  # type: ignore[arg-type]
