"""The command as a user types it: a crane of a few lines, from its zeros to runs that are compared."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import invtrack
from invtrack.advice import ways
from invtrack.command import main
from invtrack.command.mechanism import assignment
from invtrack.command.motion import seconds

CRANE = """<mujoco model="crane"><option integrator="RK4"/>
<worldbody><body name="trolley"><joint name="x" type="slide" axis="1 0 0" damping="1"/><geom type="box" size=".2 .1 .05" mass="5"/>
<body name="rope"><joint name="swing" type="hinge" axis="0 1 0" damping=".02"/>
<geom type="capsule" fromto="0 0 0 0 0 -1.5" size=".01" mass=".1"/>
<body name="load" pos="0 0 -1.5"><geom type="sphere" size=".1" mass="2"/><site name="load"/></body></body></body></worldbody>
<actuator><motor name="drive" joint="x" ctrlrange="-60 60" ctrllimited="true"/></actuator></mujoco>"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "crane.xml").write_text(CRANE)
    return tmp_path


def status_of(*words: str) -> int:
    with pytest.raises(SystemExit) as left:
        main(words)
    return int(left.value.code or 0)


def run(out: str, *words: str) -> dict[str, Any]:
    options = ("--move", "1", "--in", "3", "--timestep", "4e-3", "--no-figures", "--quiet", "--out", out)
    assert status_of("run", "crane.xml", "-y", "site:load:x", *options, *words) == 0
    summary = json.loads(Path(out, "summary.json").read_text())
    assert summary["status"] == "complete"
    (numbers,) = summary["cases"].values()
    return dict(numbers)


def test_zeros_of_a_file_and_of_a_shipped_model(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("zeros", "crane.xml", "-y", "site:load:x", "--json") == 0
    report = json.loads(capsys.readouterr().out)
    assert report["relative_degree"] == [2]
    assert max(zero["real"] for zero in report["zeros"]) > 0 > min(zero["real"] for zero in report["zeros"])
    assert len(report["modes"]) == 4
    assert status_of("zeros", "cantilever", "-u", "base_force", "-y", "tip_position") == 0
    text = capsys.readouterr().out
    assert "0.2345" in text
    assert "6 modes, 0 of them unstable" in text


def test_a_run_keeps_what_it_shows_and_methods_compare(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exact, feedback, redesign = run("exact"), run("feedback", "--method", "feedback"), run("redesign", "--method", "redesign")
    assert exact["max_error"] < 1e-3 < redesign["max_error"] < 0.1 < feedback["max_error"]
    assert redesign["peak_input"] < exact["peak_input"]
    assert status_of("compare", "exact", "feedback", "--figure", "both.png", "--json") == 0
    rows = json.loads(capsys.readouterr().out)
    assert rows["exact"]["max_error"] == exact["max_error"]
    assert (folder / "both.png").stat().st_size > 1000
    (driven,) = invtrack.load_recording(folder / "exact" / "exact.rrd").values()
    rows = [f"{t + 10},{y + 2e-3}" for t, y in zip(driven.time, driven.output.values[:, 0], strict=True)]
    (folder / "rig.csv").write_text("\n".join(["time [s],site:load:x [m]", *rows]))
    assert status_of("compare", "exact", "rig.csv", "--zero", "10", "--json") == 0
    assert json.loads(capsys.readouterr().out)["rig.csv"]["max_error"] == pytest.approx(2e-3, abs=1.1 * exact["max_error"])


def test_changes_surprises_sensors_and_a_slow_controller(folder: Path) -> None:
    known = run("known", "--change", "1.5", "body:load:mass=3")
    unknown = run("unknown", "--surprise", "body:load:mass=3")
    heavy = run("heavy", "--set", "body:load:mass=3")
    assert max(known["max_error"], heavy["max_error"]) < 2e-3 < unknown["max_error"]
    noisy = run("noisy", "--noise", "site:load:x=1e-3", "--period", "8ms", "--seed", "3")
    assert 1e-3 < noisy["max_error"] < 0.05


def test_a_table_of_wanted_outputs(folder: Path) -> None:
    times = [0.1 * i for i in range(31)]
    reference = invtrack.rest_to_rest(0.0, 500.0, 3.0, smoothness=4)
    rows = [f"{t},{float(reference(t)[0])}" for t in times]
    (folder / "tip.csv").write_text("\n".join(["time [s],site:load:x [mm]", *rows]))
    assert (
        status_of("run", "crane.xml", "-y", "site:load:x", "--reference", "tip.csv", "--quiet", "--no-figures", "--out", "a") == 0
    )
    (run,) = invtrack.load_recording(folder / "a" / "exact.rrd").values()
    assert run.reference.values[-1, 0] == pytest.approx(0.5)


def test_advice_comes_with_a_program_that_runs_by_itself(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    chosen = tuple(way for way in ways.WAYS if way.name in ("stable inversion", "feedback alone"))
    monkeypatch.setitem(invtrack.advise.__globals__, "WAYS", chosen)
    asked = ("--move", "1", "--in", "3", "--limit", "drive=12", "--parameter-error", "body:load:mass=10%")
    words = (*asked, "--max-preactuation", "500ms", "--timestep", "4e-3", "--json", "--out", "advice")
    assert status_of("advise", "crane.xml", "-y", "site:load:x", *words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["recommended"]["method"] == "stable inversion"
    assert found["recommended"]["peak_input"] <= 12
    assert found["parameters_off"] == ["body:load:mass -10 %", "body:load:mass +10 %"]
    assert found["recommended"]["error"] < found["recommended"]["error_off"] < 0.01
    assert "Take stable inversion" in (folder / "advice" / "report.html").read_text()
    names: dict[str, Any] = {}
    exec(compile((folder / "advice" / "program.py").read_text(), "program.py", "exec"), names)
    error = np.max(np.abs(names["result"].output.values - names["result"].reference.values))
    assert error == found["recommended"]["error"]
    monkeypatch.setitem(invtrack.advise.__globals__, "LONGER", ())
    assert status_of("advise", "crane.xml", "-y", "site:load:x", "--move", "1", "--limit", "drive=1", "--quiet") == 1


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["zeros", "crane.xml"], "--output (-y): say what is to follow"),
        (["zeros", "nowhere.xml", "-y", "a"], "there is no file nowhere.xml"),
        (["zeros", "nobody", "-y", "a"], "no shipped model is named 'nobody'"),
        (["zeros", "crane.xml", "-y", "load"], "no sensor or state is named 'load'"),
        (["run", "crane.xml", "-y", "site:load:x"], "--move: expected one distance for each of site:load:x, got 0"),
        (["run", "crane.xml", "-y", "site:load:x", "--move", "1", "--set", "mass"], "--set: expected NAME=NUMBER"),
        (["run", "crane.xml", "-y", "site:load:x", "--move", "1", "--period", "fast"], "--period: expected a time such as 5ms"),
        (["advise", "crane.xml", "-y", "site:load:x", "--move", "1", "--error", "much"], "--error: expected a share such as 1%"),
        (
            ["advise", "crane.xml", "-y", "site:load:x", "--move", "1", "--limit", "x=1"],
            "--limit: expected NAME=VALUE with one of drive",
        ),
        (["advise", "crane.xml", "-y", "site:load:x", "--move", "1", "--limit", "drive=-1"], "--limit: expected a positive number"),
        (["report", "nowhere"], "nowhere: expected the folder of a run that has ended"),
        (["study", "nothing"], "there is no study 'nothing'; there are: "),
        (["compare", "nothing.rrd"], "nothing.rrd: expected a recording (.rrd) or a folder with some"),
    ],
)
def test_what_cannot_be_done_ends_in_one_message(
    folder: Path, capsys: pytest.CaptureFixture[str], words: Sequence[str], says: str
) -> None:
    assert status_of(*words) == 1
    text = capsys.readouterr().err
    assert text.startswith("invtrack: ")
    assert says in text
    assert "Traceback" not in text


def test_a_command_line_that_cannot_be_read_ends_with_two(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("zeroes") == 2
    assert status_of("--version") == 0
    assert capsys.readouterr().out == f"invtrack {invtrack.__version__}\n"


def test_the_doctor_finds_everything_in_order(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("doctor", "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert all(result["works"] for result in found.values())
    assert "read back bit for bit" in found["recordings"]["finding"]


def test_shipped_studies_are_listed_and_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("study") == 0
    names = [line.partition(":")[0] for line in capsys.readouterr().out.splitlines()]
    assert {"minimal", "cantilever_jumps", "hover_preactuation"} <= set(names)
    words = ("--case", "feedforward_only", "--timestep", "1e-2", "--no-figures", "--json", "--out", "a")
    ended = subprocess.run(
        [sys.executable, "-m", "invtrack", "study", "minimal", *words], capture_output=True, text=True, check=True
    )
    assert json.loads(ended.stdout)["cases"]["feedforward_only"]["status"] == "completed"


def test_words_of_options() -> None:
    assert assignment("--set", "body:tip:mass = 3e0") == ("body:tip:mass", 3.0)
    assert [seconds("--period", text) for text in ("5ms", "0.005", "5000 us", "5e-3s")] == pytest.approx([5e-3] * 4)
