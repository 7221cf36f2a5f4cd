"""Logs of hardware read as runs: what they hold is what was logged, what they do not hold is said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.errors import FileError
from invtrack.figures import comparison_figure, tracking_figure

MODEL = invtrack.StateSpace(
    [[0.0, 1.0], [-9.0, -2.0]],
    [[0.0], [9.0]],
    [[1.0, 0.0]],
    states=invtrack.Channels(["tip", "tip velocity"], ["m", "m/s"]),
    inputs=invtrack.Channels(["force"], ["N"]),
    outputs=invtrack.Channels(["tip"], ["m"]),
)
PLAN = invtrack.invert(MODEL, invtrack.rest_to_rest(0.0, 0.2, 1.0, smoothness=3))


@pytest.fixture(scope="module")
def run() -> invtrack.RunResult:
    return invtrack.simulate(invtrack.LinearPlant(MODEL), invtrack.TrackingController(PLAN), timestep=1e-2)


def written(folder: Path, header: str, *columns: np.ndarray) -> Path:
    path = folder / "rig.csv"
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.17g")
    return path


def test_a_log_has_the_metrics_of_the_run_that_it_is_of(run: invtrack.RunResult, tmp_path: Path) -> None:
    u = np.append(run.applied.values, 7.0)  # the last row's input is not known to have held
    x = run.state.values
    header = "time [ms],y.tip [mm],u.force [N],x.tip [m],x.tip velocity [m/s],note"
    path = written(tmp_path, header, 1e3 * (run.time + 40.0), 1e3 * run.output.values[:, 0], u, x, np.zeros(len(u)))
    log = invtrack.read_log(path, PLAN, zero=40.0)
    assert log.name == "rig"
    assert log.time == pytest.approx(run.time, abs=1e-10)
    assert log.output["tip"] == pytest.approx(run.output["tip"], abs=1e-15)
    assert log.state["tip velocity"] == pytest.approx(run.state["tip velocity"], abs=1e-15)
    assert not log.remarks
    ours, theirs = invtrack.metrics(log), invtrack.metrics(run)
    assert {name: ours[name] for name in ours if name != "notes"} == pytest.approx(
        {name: theirs[name] for name in theirs if name != "notes"}, rel=1e-6, abs=1e-9
    )


def test_what_a_log_does_not_hold_is_said_and_drawn_and_recorded_without(run: invtrack.RunResult, tmp_path: Path) -> None:
    path = written(tmp_path, "t,encoder", run.time, run.output.values)
    log = invtrack.read_log(path, PLAN, columns={"tip": "encoder"}, name="rig")
    # One name for an output and a state: the column is both, as the model says.
    assert log.remarks == ("a log, which does not hold force, tip velocity",)
    figures = invtrack.metrics(log)
    assert figures.max_error == pytest.approx(invtrack.max_error(run), abs=1e-12)
    assert figures.peak_input is None
    assert "not finite" in figures.notes["peak_input"] or "no finite sample" in figures.notes["peak_input"]
    assert tracking_figure(log).axes
    assert comparison_figure([run, log]).axes
    saved = invtrack.save_recording(log, tmp_path / "rig.rrd")
    assert invtrack.load_recording(saved)["rig"].equals(log)


def test_along_a_run_a_log_is_compared_with_what_the_run_was_to_do(run: invtrack.RunResult, tmp_path: Path) -> None:
    time = np.linspace(run.time[0] - 1.0, run.time[-1] + 1.0, 3333)  # not the run's samples, and more than its span
    path = written(tmp_path, "time,tip,force", time, PLAN(time).y + 1e-3, PLAN(time).u)
    by_run, by_plan = invtrack.read_log(path, run), invtrack.read_log(path, PLAN)
    assert (by_run.time[0], by_run.time[-1]) == (time[time >= run.time[0]][0], time[time <= run.time[-1]][-1])
    assert invtrack.max_error(by_run) == pytest.approx(1e-3, rel=2e-2)  # interpolated between samples
    assert invtrack.max_error(by_plan) == pytest.approx(1e-3, rel=1e-6)
    assert (by_run.manoeuvre, by_run.vibration_period) == (run.manoeuvre, run.vibration_period)
    with pytest.raises(FileError, match="the plan that the hardware was driven along, or a run along it, got 3"):
        invtrack.read_log(path, 3)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("header", "shift", "options", "says"),
    [
        ("time,tip [kg]", 0.0, {}, r"expected the column 'tip \[kg\]' in \[m\]"),
        ("time,top", 0.0, {}, "no column named 'tip'"),
        ("clock,tip", 0.0, {}, "no column, or more than one, named 'time' or 't'"),
        ("time,tip", 1e4, {}, "have nothing in common with the plan"),
        ("time,tip", 0.0, {"columns": {"elbow": "tip"}}, "columns names .*elbow.*; there are: outputs tip; inputs force"),
        ("time,tip", 0.0, {"columns": {"force": "current"}}, "no column named 'current'"),
        ("time,tip", 0.0, {"zero": np.nan}, "zero"),
    ],
)
def test_a_log_that_does_not_fit_is_refused(
    run: invtrack.RunResult, tmp_path: Path, header: str, shift: float, options: dict[str, object], says: str
) -> None:
    path = written(tmp_path, header, run.time + shift, run.output.values)
    with pytest.raises(FileError, match=says):
        invtrack.read_log(path, PLAN, **options)  # type: ignore[arg-type]


def test_rows_without_header_or_order_are_refused(run: invtrack.RunResult, tmp_path: Path) -> None:
    path = tmp_path / "bare.csv"
    np.savetxt(path, np.column_stack([run.time, run.output.values]), delimiter=",")
    with pytest.raises(FileError, match="has no header row"):
        invtrack.read_log(path, PLAN)
    path = written(tmp_path, "time,tip", run.time[[0, 2, 1]], run.output.values[:3])
    with pytest.raises(FileError, match="line 4: expected times that increase"):
        invtrack.read_log(path, PLAN)
