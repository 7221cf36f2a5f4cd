"""A study keeps what it has done, says how it ended, and ends its program with a status that says the same."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

import invtrack
from invtrack.errors import InvtrackError, NonHyperbolicError
from invtrack.figures import comparison_figure
from invtrack.studies import Column, DivergedError, Session, Setup, Study, StudyOptions, Table
from tests.studies.tiny import case, controller, diverging, oscillator, study

CHECKOUT = Path(__file__).parents[2]


def ended(study_: Study[Any], *words: str) -> int:
    """The status with which the program ends."""
    with pytest.raises(SystemExit) as exit_info:
        study_.main(words)
    assert isinstance(exit_info.value.code, int)
    return exit_info.value.code


def summary(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    return content


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_complete_study_leaves_all_its_parts_and_ends_with_0(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = study(
        sections={"stiffness": 40.0, "largest": lambda done: max(invtrack.max_error(run) for run in done.among())},
        sweeps={"gains": {f"gain {gain}": lambda done, gain=gain: {"gain": gain} for gain in (1, 2, 3)}},
        figures={"comparison": lambda done: comparison_figure(done.among())},
        report=["before", Table("Oscillator", [Column("max error")]), lambda done: f"{len(done.section('gains'))} gains"],
    )
    assert ended(made) == 0
    folder = elsewhere / "runs/tiny"
    left = summary(folder)
    assert (left["study"], left["status"], left["model"], left["timestep"], left["seed"]) == (
        "tiny", "complete", "linear model", 0.02, 0
    )  # fmt: skip
    assert list(left["cases"]) == ["first", "second"]
    assert left["largest"] == max(numbers["max_error"] for numbers in left["cases"].values()) > 0
    assert left["gains"] == [{"gain": 1}, {"gain": 2}, {"gain": 3}]
    assert {entry.name for entry in folder.iterdir()} == {"summary.json", *left["files"]}
    assert left["files"] == ["first.rrd", "first.parquet", "second.rrd", "second.parquet", "comparison.png"]
    out = capsys.readouterr().out
    assert out.startswith("before\nOscillator\n")
    assert "\n3 gains\n" in out
    assert out.endswith(
        "written to runs/tiny: summary.json, 2 recordings, 1 figure; look into the recordings with: rerun runs/tiny/*.rrd\n"
    )


def test_recordings_of_a_study_share_an_application_and_hold_a_case_each(elsewhere: Path) -> None:
    ended(study())
    paths = sorted((elsewhere / "runs/tiny").glob("*.rrd"))
    stores = [store for path in paths for store in RrdReader(path).recordings()]
    assert [store.application_id for store in stores] == ["invtrack tiny"] * 2
    assert len({store.recording_id for store in stores}) == 2
    assert [name for path in paths for name in invtrack.load_recording(path)] == ["first", "second"]


def test_a_diverged_case_says_so_and_shows_no_numbers(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = study(
        cases=[diverging(), case("first")],
        sections={"ratio": lambda done: invtrack.max_error(done["diverging"]), "rest": lambda done: len(done.among())},
        figures={"alone": lambda done: comparison_figure([done["diverging"]])},
    )
    assert ended(made) == 3
    left = summary(elsewhere / "runs/tiny")
    assert left["status"] == "diverged"
    assert left["cases"]["diverging"].keys() == {"status", "reason"}
    assert left["cases"]["first"]["status"] == "completed"
    assert left["rest"] == 1
    assert "ratio" not in left
    assert left["files"] == ["diverging.rrd", "diverging.parquet", "first.rrd", "first.parquet"]
    printed = capsys.readouterr()
    (row,) = (line for line in printed.out.splitlines() if line.startswith("diverging"))
    assert row.split() == ["diverging", "(diverged)", "-", "-"]
    assert "tiny: diverging diverged (stopped at t = 0 s" in printed.err


def test_a_point_of_a_sweep_that_diverges_is_missing_and_says_so(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def point(gain: float, done: Session) -> float:
        plant = invtrack.LinearPlant(oscillator())
        return invtrack.max_error(done.simulate(plant, controller(gain), name="driven", evaluate="stages"))

    points = {f"gain {gain}": lambda done, gain=gain: point(gain, done) for gain in (0.0, -1e9, 1.0)}
    assert ended(study(sweeps={"errors": points})) == 3
    assert len(summary(elsewhere / "runs/tiny")["errors"]) == 2
    assert "errors: gain -1000000000.0 diverged (driven diverged: stopped" in capsys.readouterr().err


def test_an_interruption_keeps_the_cases_done(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def interrupt() -> invtrack.TrackingController:
        previous = signal.signal(signal.SIGINT, signal.default_int_handler)  # as in a process of its own
        try:
            signal.raise_signal(signal.SIGINT)
        finally:
            signal.signal(signal.SIGINT, previous)
        raise AssertionError("the signal comes first")

    made = study(
        cases=[case("first"), case("second", interrupt), case("third")],
        sections={"late": lambda done: 1.0},
        figures={"late": lambda done: comparison_figure(done.among())},
    )
    assert ended(made) == 130
    left = summary(elsewhere / "runs/tiny")
    assert left["status"] == "interrupted"
    assert list(left["cases"]) == ["first"]
    assert left["cases"]["first"]["max_error"] > 0
    assert {entry.name for entry in (elsewhere / "runs/tiny").iterdir()} == {"summary.json", "first.rrd", "first.parquet"}
    printed = capsys.readouterr()
    assert "first" in printed.out
    assert printed.err == "tiny: interrupted\n"


def test_each_case_is_on_disk_before_the_next_begins(elsewhere: Path) -> None:
    def look() -> invtrack.TrackingController:
        kept = json.loads((elsewhere / "runs/tiny/unfinished.json").read_text())
        assert kept["status"] == "unfinished"
        assert kept["cases"]["first"]["max_error"] > 0
        assert invtrack.load_recording(elsewhere / "runs/tiny/first.rrd")
        return controller()

    assert ended(study(cases=[case("first"), case("second", look)])) == 0


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (InvtrackError("no bounded inverse; move the zero"), "no bounded inverse; move the zero"),
        (FileNotFoundError(2, "No such file or directory", "rig.xml"), "rig.xml: No such file or directory"),
    ],
)
def test_a_failure_ends_in_one_line_with_1_and_keeps_what_was_done(
    error: Exception, line: str, elsewhere: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> invtrack.TrackingController:
        raise error

    assert ended(study(cases=[case("first"), case("second", fail)])) == 1
    (message,) = capsys.readouterr().err.splitlines()
    assert message.startswith(f"tiny: {line}")
    assert message.endswith("what was done before is kept in runs/tiny")
    kept = json.loads((elsewhere / "runs/tiny/unfinished.json").read_text())
    assert list(kept["cases"]) == ["first"]
    assert not (elsewhere / "runs/tiny/summary.json").exists()
    assert ended(study()) == 0  # and the next run takes its place
    assert not (elsewhere / "runs/tiny/unfinished.json").exists()


def test_a_defect_keeps_its_traceback() -> None:
    def fail(_: StudyOptions) -> Setup:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        study(fail).main([])


def test_a_refusal_before_the_first_case_leaves_the_earlier_run(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(study()) == 0
    before = summary(elsewhere / "runs/tiny")
    assert ended(study(), "--case", "thrid") == 1
    assert "there is no case thrid; there are: first, second" in capsys.readouterr().err
    assert summary(elsewhere / "runs/tiny") == before


@pytest.mark.parametrize("words", [("--timestep", "soon"), ("--out", ""), ("--unheard-of",)])
def test_a_command_line_that_cannot_be_read_ends_with_2(words: Sequence[str], elsewhere: Path) -> None:
    assert ended(study(), *words) == 2
    assert not list(elsewhere.iterdir())


def test_chosen_cases_alone_are_run_and_shown(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    made = study(
        cases=[case("first"), case("second"), case("third")],
        sweeps={"gains": {"one": lambda done: 1.0}},
        sections={"of_first": lambda done: invtrack.max_error(done["first"]), "number": lambda done: len(done.among())},
        report=[lambda done: f"second {done.numbers_of('second')['max_error']}", lambda done: f"gains {done.section('gains')}"],
    )
    assert ended(made, "--case", "third", "--case", "second") == 0
    left = summary(elsewhere / "runs/tiny")
    assert list(left["cases"]) == ["second", "third"]
    assert left["number"] == 2
    assert not {"of_first", "gains"} & left.keys()
    out = capsys.readouterr().out
    assert out.startswith("second ")
    assert "gains" not in out
    assert ended(made, "--case", "gains") == 0
    assert summary(elsewhere / "runs/tiny")["gains"] == [1.0]
    assert not (elsewhere / "runs/tiny/second.rrd").exists()  # two runs never mix


def test_json_is_the_summary_and_nothing_else(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(study(), "--json") == 0
    assert json.loads(capsys.readouterr().out) == summary(elsewhere / "runs/tiny")


def test_quiet_prints_nothing(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert ended(study(), "--quiet") == 0
    assert capsys.readouterr() == ("", "")


def test_no_figures_draws_none(elsewhere: Path) -> None:
    drawn = {"curve": lambda run: comparison_figure([run])}
    assert ended(study(cases=[case("first", figures=drawn)]), "--no-figures") == 0
    assert summary(elsewhere / "runs/tiny")["files"] == ["first.rrd", "first.parquet"]
    assert ended(study(cases=[case("first", figures=drawn)])) == 0
    assert summary(elsewhere / "runs/tiny")["files"] == ["first.rrd", "first.parquet", "curve_first.png"]


def test_the_seed_reaches_every_simulation(elsewhere: Path) -> None:
    law = invtrack.OutputFeedbackController(
        controller().plan,
        invtrack.lqr(oscillator(), Q=1.0, R=1.0),
        invtrack.LuenbergerObserver((-20.0, -21.0)),
        period=0.02,
    )
    made = study(cases=[case("noisy", law, settings={"sensors": {"y1": invtrack.Sensor(noise=1e-3)}})])

    def error(*words: str) -> float:
        assert ended(made, *words) == 0
        return float(summary(elsewhere / "runs/tiny")["cases"]["noisy"]["max_error"])

    assert error() == error("--seed", "0") != error("--seed", "1")


def test_a_case_may_be_there_to_be_refused(elsewhere: Path) -> None:
    def refuse() -> invtrack.TrackingController:
        raise NonHyperbolicError("zeros on the axis")

    assert ended(study(cases=[case("first"), case("second", refuse, refused_by=NonHyperbolicError)])) == 0
    assert summary(elsewhere / "runs/tiny")["cases"]["second"] == {"status": "refused", "reason": "zeros on the axis"}
    assert ended(study(cases=[case("second", refuse)])) == 1
    assert ended(study(cases=[case("first", controller, refused_by=NonHyperbolicError)])) == 1


def test_warnings_of_a_simulation_and_limits_that_act_become_remarks(elsewhere: Path, capsys: pytest.CaptureFixture[str]) -> None:
    narrow = case("narrow")
    weak = invtrack.LinearPlant(oscillator(), input_limits=[[-1.0, 1.0]])
    assert ended(study(cases=[type(narrow)("narrow", weak, narrow.controller)])) == 0
    printed = capsys.readouterr()
    assert "narrow: the plan needs u1 from" in printed.out
    assert not printed.err
    before, during = summary(elsewhere / "runs/tiny")["warnings"]["narrow"]
    assert "expect saturation" in before
    assert during.startswith("in the run: limit of u1, exceeded by up to ")


def test_a_long_run_is_announced_before_it_begins(
    elsewhere: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("invtrack.simulation.span.LONG", 100)
    said: list[str] = []

    def draw(run: invtrack.RunResult) -> None:
        said.append(capsys.readouterr().err)
        raise KeyboardInterrupt

    assert ended(study(cases=[case("first", numbers=draw)])) == 130
    assert "first: a long run: 6 s in 3e+02 steps of 0.02 s" in said[0]
    assert ended(study(cases=[case("first")]), "--quiet") == 0
    assert "a long run" not in capsys.readouterr().err
    assert "a long run" in summary(elsewhere / "runs/tiny")["warnings"]["first"][0]


def test_a_study_may_add_options_of_its_own(elsewhere: Path) -> None:
    @dataclass(frozen=True, kw_only=True)
    class SweepOptions(StudyOptions):
        count: int = 3
        """Number of cases."""

    def build(options: SweepOptions) -> Setup:
        return Setup([case(f"number_{number}") for number in range(options.count)])

    assert ended(Study("tiny", build, defaults=SweepOptions(timestep=0.02)), "--count", "2") == 0
    left = summary(elsewhere / "runs/tiny")
    assert (left["count"], list(left["cases"])) == (2, ["number_0", "number_1"])


def test_run_returns_the_summary(elsewhere: Path) -> None:
    left = study().run(StudyOptions(out=elsewhere / "there", timestep=0.02, quiet=True))
    assert left == summary(elsewhere / "there")


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"cases": [case("first"), case("first")]}, "names of their own, got first twice"),
        ({"cases": [case("up/../first")]}, "names that files can have, got 'up/../first'"),
        ({"cases": [], "sweeps": {"x": {}}, "sections": {"x": 1.0}}, "got x twice"),
        ({"cases": [], "sections": {"status": 1.0}}, "names that the summary does not use itself, got status"),
    ],
)
def test_names_that_cannot_be_told_apart_or_written_are_refused(parts: dict[str, Any], message: str) -> None:
    with pytest.raises(InvtrackError, match=message):
        Setup(**parts)


def test_simulate_refuses_a_run_that_diverges() -> None:
    bad = diverging()
    assert isinstance(bad.controller, invtrack.TrackingController)
    with pytest.raises(DivergedError, match="diverging diverged: stopped at"):
        Session(StudyOptions(timestep=0.02)).simulate(bad.plant, bad.controller, name="diverging", **bad.settings)


def test_a_program_that_is_killed_leaves_what_it_has_done(elsewhere: Path) -> None:
    program = (
        "import os, signal\n"
        "from tests.studies.tiny import case, study\n"
        "study(cases=[case('first'), case('second', lambda: os.kill(os.getpid(), signal.SIGKILL))]).main([])\n"
    )
    path = os.pathsep.join([str(CHECKOUT), os.environ.get("PYTHONPATH", "")])
    killed = subprocess.run([sys.executable, "-c", program], cwd=elsewhere, env={**os.environ, "PYTHONPATH": path}, check=False)
    assert killed.returncode == -signal.SIGKILL
    kept = json.loads((elsewhere / "runs/tiny/unfinished.json").read_text())
    assert list(kept["cases"]) == ["first"]
    assert invtrack.load_recording(elsewhere / "runs/tiny/first.rrd")["first"].status == "completed"
    assert ended(study(cases=[case("other")])) == 0
    assert {entry.name for entry in (elsewhere / "runs/tiny").iterdir()} == {"summary.json", "other.rrd", "other.parquet"}
