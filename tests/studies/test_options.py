"""The options of a study, as its command line and as programs give them."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
import tyro
from rich.console import Console

from invtrack.errors import InvtrackError, SimulationError
from invtrack.studies.options import StudyOptions
from invtrack.studies.session import Session, progress
from tests.studies.tiny import study

TERMINAL = {"force_terminal": True, "_environ": {"TERM": "xterm"}}


def parsed(*args: str) -> StudyOptions:
    return tyro.cli(StudyOptions, default=StudyOptions(timestep=2e-3), args=args)


def test_defaults_and_flags() -> None:
    assert parsed() == StudyOptions(timestep=2e-3)
    assert parsed("--timestep", "2e-4", "--no-figures", "--out", "here", "--case", "a", "--case", "b", "--json", "--quiet") == (
        StudyOptions(out=Path("here"), timestep=2e-4, figures=False, case=("a", "b"), json=True, quiet=True)
    )


@pytest.mark.parametrize(
    ("option", "value"),
    [("timestep", value) for value in (0.0, -1e-3, float("nan"), float("inf"))]
    + [("seed", -1), ("json", float("nan")), ("quiet", 1), ("figures", "no")],
)
def test_useless_values_are_refused_by_name(option: str, value: Any) -> None:
    with pytest.raises(SimulationError, match=rf"--{option.replace('_', '-')}\W.*, got {value!r}"):
        StudyOptions(**{option: value})


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--timestep=-1",), "expected a positive, finite number of seconds"),
        (("--timestep", "1e999"), "expected a positive, finite number of seconds"),
        (("--timestep", "fast"), "--timestep"),
        (("--out", ""), "expected a folder such as runs/trial, got an empty name"),
        (("--out", " "), "expected a folder such as runs/trial, got an empty name"),
    ],
)
def test_useless_words_end_with_a_message(words: tuple[str, ...], expected: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        parsed(*words)
    assert exit_info.value.code == 2
    message = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert expected in message
    assert "Traceback" not in message


def test_help_explains_every_option(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        study().main(["--help"])
    assert exit_info.value.code == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for expected in ("usage: tiny", "What it claims.", "--out DIR", "runs/tiny", "--timestep", "[s]", "--case NAME", "--seed"):
        assert expected in text
    for expected in ("--json", "--quiet", "--no-figures"):
        assert expected in text


def test_options_that_matter_are_those_that_change_numbers() -> None:
    @dataclass(frozen=True, kw_only=True)
    class SweepOptions(StudyOptions):
        count: int = 3

    assert SweepOptions(json=True, case=("a",)).that_matter() == {"timestep": 1e-3, "seed": 0, "count": 3}


def test_progress_is_silent_away_from_a_terminal() -> None:
    stream = io.StringIO()
    with progress("inversion", console=Console(file=stream, force_terminal=False)) as report:
        report(0.5)
    assert stream.getvalue() == ""


def test_progress_shows_its_description_on_a_terminal() -> None:
    stream = io.StringIO()
    with progress("inversion [1/2]", console=Console(file=stream, width=80, **TERMINAL)) as report:
        report(0.5)
        report(1.0)
    assert "inversion [1/2]" in stream.getvalue()


def test_progress_in_pieces_shows_how_many_are_done_and_how_many_a_second() -> None:
    stream = io.StringIO()
    with progress("sweep", total=200, unit="runs", console=Console(file=stream, width=120, **TERMINAL)) as report:
        report(0.25)
        report(1.0)
    assert "200 of 200 runs, " in stream.getvalue()
    assert " runs/s" in stream.getvalue()


def test_progress_lets_an_error_through() -> None:
    with pytest.raises(InvtrackError, match="diverged"), progress("run", console=Console(file=io.StringIO(), **TERMINAL)):
        raise InvtrackError("diverged")


@pytest.mark.parametrize("quiet", [True, False])
def test_activity_is_shown_unless_the_study_is_quiet(quiet: bool) -> None:
    stream = io.StringIO()
    session = Session(StudyOptions(quiet=quiet), console=Console(file=stream, width=80, **TERMINAL))
    with session.activity("first (1 of 2)"):
        pass
    assert ("first (1 of 2)" in stream.getvalue()) is not quiet
