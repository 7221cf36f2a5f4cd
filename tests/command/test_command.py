"""The command as a user types it: a crane of a few lines, from its zeros to runs that are compared."""

from __future__ import annotations

import json
import shutil
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
    assert 3 * max(known["max_error"], heavy["max_error"]) < unknown["max_error"] < 0.01
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


def test_limits_are_kept_or_the_plan_is_refused(folder: Path) -> None:
    free = run("free")
    limited = run("limited", "--limit", "drive=4", "--limit", "drive:rate=-30:30")
    assert (folder / "limited" / "limited.rrd").exists()
    assert limited["peak_input"] <= 4 < free["peak_input"]
    assert limited["limits_exceeded"] == []
    (driven,) = invtrack.load_recording(folder / "limited" / "limited.rrd").values()
    rates = np.diff(driven.commanded.values[:, 0]) / np.diff(driven.time[:-1])
    assert np.max(np.abs(rates)) <= 30
    loose = run("loose", "--method", "exact", "--limit", f"drive={1.2 * free['peak_input']}")
    assert loose["peak_input"] == free["peak_input"]


def test_a_plan_on_the_motion_departs_less_from_what_is_driven_than_the_linear_one(folder: Path) -> None:
    departures = []
    for name, words in (("redesign", ()), ("redesign_nonlinear", ("--nonlinear",))):
        found = run(name, "--method", "redesign", "--give-up", "0.5%", *words)
        assert 4e-3 < found["max_error"] < 6e-3
        (driven,) = invtrack.load_recording(folder / name / f"{name}.rrd").values()
        departures.append(invtrack.max_error(driven, wanted="planned_output"))
    assert departures[1] < departures[0] / 10


def test_a_plan_is_written_for_hardware_from_its_file_or_from_a_run(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    motion = ("--set", "body:load:mass=3", "--change", "1.5", "body:load:mass=2")
    run("driven", *motion)
    assert status_of("export", "driven", "--period", "5ms", "--gains", "gains.csv", "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["rate"], said["files"]) == (200.0, ["plan.csv", "gains.csv"])
    options = ("-y", "site:load:x", "--move", "1", "--in", "3", *motion)
    assert status_of("export", "crane.xml", *options, "--period", "5ms", "--out", "again.csv", "--quiet") == 0
    assert capsys.readouterr().out == ""
    assert (folder / "plan.csv").read_text() == (folder / "again.csv").read_text()
    plan = invtrack.read_plan(folder / "plan.csv")
    (driven,) = invtrack.load_recording(folder / "driven" / "exact.rrd").values()
    assert plan.states(driven.time) == pytest.approx(driven.state_reference.values, abs=1e-4)
    table = np.loadtxt(folder / "gains.csv", delimiter=",", skiprows=2)
    assert table[:, 0] == pytest.approx([said["start"], 1.5])
    names = (folder / "gains.csv").read_text().splitlines()[0].split(",")
    assert names[1:] == ["K.drive.x", "K.drive.swing", "K.drive.x velocity", "K.drive.swing velocity"]
    model = invtrack.linearize(invtrack.Plant.from_xml("crane.xml", inputs=["drive"], outputs=["site:load:x"]))
    assert np.max(np.linalg.eigvals(model.A - model.B @ table[1:, 1:]).real) < 0
    (folder / "crane.xml").write_text(CRANE.replace('mass="5"', 'mass="6"'))
    assert status_of("export", "driven") == 1
    assert "no longer makes the plan of that run" in capsys.readouterr().err
    assert status_of("export", "driven", "--method", "redesign") == 1
    assert "method: the folder of a run says how its plan was made" in capsys.readouterr().err


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
    assert found["command"] == (
        f"invtrack run crane.xml -y site:load:x --move 1.0 --in {found['recommended']['duration']!r} "
        f"--smoothness {found['recommended']['smoothness']} --method exact --error 1% --limit drive=12 --timestep 0.004"
    )
    assert status_of(*found["command"].split()[1:], "--no-figures", "--quiet", "--out", "again") == 0
    again = json.loads((folder / "again" / "summary.json").read_text())["cases"]["exact"]
    assert again["max_error"] == pytest.approx(found["recommended"]["error"], rel=1e-6)
    assert status_of("compare", "advice", "again", "--quiet") == 0
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
        (
            ["advise", "crane.xml", "-y", "site:load:x", "--move", "1", "--set", "body:load:mass=-1"],
            "must be finite and not negative",
        ),
        (
            ["run", "crane.xml", "-y", "site:load:x", "--move", "1", "--in", "3", "--method", "exact", "--limit", "drive=4"],
            "stable inversion does not keep to it: input 'drive' between -4 and 4 is exceeded by 28",
        ),
        (
            ["run", "crane.xml", "-y", "site:load:x", "--move", "1", "--limit", "drive:rat=4"],
            "with one of drive, drive:rate, site:load",
        ),
        (["export", "crane.xml", "-y", "site:load:x", "--move", "1", "--period", "0ms"], "--period: expected a time"),
        (["export", "crane.xml", "-y", "site:load:x", "--move", "1", "--out", "plan.txt"], "ends in .csv, got 'plan.txt'"),
        (["export", "."], ".: expected the folder of a run that has ended"),
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


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_shells_are_told_how_to_complete(shell: str, folder: Path) -> None:
    assert status_of("--tyro-write-completion", shell, "completions") == 0
    script = (folder / "completions").read_text()
    assert "export" in script
    assert "--parameter-error" in script
    if shutil.which(shell):
        subprocess.run([shell, "-n", "completions"], check=True)
    else:
        assert shell == "zsh"  # bash is there


def test_a_reader_that_leaves_is_no_error() -> None:
    command = f"{sys.executable} -m invtrack study | true; echo ${{PIPESTATUS[0]}}"
    ended = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert ended.stderr == ""
    assert int(ended.stdout) in (0, 141)  # 0 where all was written before the reader left


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
