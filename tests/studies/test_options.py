"""A sim's command line, and the one line and exit status with which it fails."""

from __future__ import annotations

import io
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest
from rich.console import Console

from invtrack.errors import InvtrackError, SimulationError
from invtrack.studies.options import SimOptions, run_sim
from invtrack.studies.progress import progress

DEFAULTS = SimOptions(out=Path("runs/demo"), timestep=1e-3)


@dataclass(frozen=True, kw_only=True)
class SweepOptions(SimOptions):
    count: int = 3
    """Number of durations."""


def parsed(*args: str) -> SimOptions:
    seen: list[SimOptions] = []
    run_sim(seen.append, defaults=DEFAULTS, args=args)
    return seen[0]


def test_defaults_and_flags() -> None:
    assert parsed() == DEFAULTS
    assert parsed("--timestep", "2e-4", "--no-figures", "--out", "here") == SimOptions(
        out=Path("here"), timestep=2e-4, figures=False
    )


def test_a_sim_may_add_options_of_its_own() -> None:
    seen: list[SweepOptions] = []
    run_sim(seen.append, defaults=SweepOptions(out=Path("runs/sweep"), timestep=1e-3), args=["--count", "5"])
    assert (seen[0].count, seen[0].timestep) == (5, 1e-3)


@pytest.mark.parametrize("value", ["-1", "0", "nan", "inf", "-inf", "1e999", "fast"])
def test_useless_timesteps_are_refused_at_the_door(value: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        parsed("--timestep", value)
    assert exit_info.value.code in (1, 2)
    message = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert "--timestep" in message
    assert "Traceback" not in message
    assert value == "fast" or "expected a positive, finite number of seconds" in message


@pytest.mark.parametrize("value", [0.0, -1e-3, float("nan"), float("inf")])
def test_useless_timesteps_are_refused_in_code(value: float) -> None:
    with pytest.raises(SimulationError, match=r"--timestep: expected a positive, finite number"):
        SimOptions(out=Path("here"), timestep=value)


def test_help_explains_every_option_with_its_unit(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as exit_info:
        run_sim(print, defaults=DEFAULTS, description="What it claims.", args=["--help"])
    assert exit_info.value.code == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    for expected in ("What it claims.", "--out", "runs/demo", "--timestep", "[s]", "--no-figures"):
        assert expected in text


@pytest.mark.parametrize(
    ("error", "status", "line"),
    [
        (InvtrackError("no bounded inverse; move the zero"), 1, "no bounded inverse; move the zero"),
        (KeyboardInterrupt(), 130, "interrupted"),
        (FileNotFoundError(2, "No such file or directory", "rig.xml"), 1, "rig.xml: No such file or directory"),
    ],
)
def test_failures_end_in_one_line(error: BaseException, status: int, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    def main(_: SimOptions) -> None:
        raise error

    with pytest.raises(SystemExit) as exit_info:
        run_sim(main, defaults=DEFAULTS, args=[])
    assert exit_info.value.code == status
    (message,) = capsys.readouterr().err.splitlines()
    assert message.endswith(f": {line}")


def test_a_defect_keeps_its_traceback() -> None:
    def main(_: SimOptions) -> None:
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        run_sim(main, defaults=DEFAULTS, args=[])


def test_a_failing_script_prints_no_traceback(tmp_path: Path) -> None:
    script = tmp_path / "sim_that_fails.py"
    script.write_text(
        "from pathlib import Path\n"
        "from invtrack.studies.folder import RunFolder\n"
        "from invtrack.studies.options import SimOptions, run_sim\n"
        "def main(options): RunFolder(options.out)\n"
        "run_sim(main, defaults=SimOptions(out=Path('runs/x'), timestep=1e-3))\n"
    )
    finished = subprocess.run(
        [sys.executable, script, "--out", str(script)], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert finished.returncode == 1
    assert finished.stdout == ""
    (line,) = finished.stderr.splitlines()
    assert line.startswith("sim_that_fails: expected a directory")


def test_progress_is_silent_away_from_a_terminal() -> None:
    stream = io.StringIO()
    with progress("inversion", console=Console(file=stream, force_terminal=False)) as report:
        report(0.5)
    assert stream.getvalue() == ""


def test_progress_shows_its_description_on_a_terminal() -> None:
    stream = io.StringIO()
    console = Console(file=stream, force_terminal=True, width=80, _environ={"TERM": "xterm"})
    with progress("inversion [1/2]", console=console) as report:
        report(0.5)
        report(1.0)
    assert "inversion [1/2]" in stream.getvalue()


def test_progress_lets_an_error_through() -> None:
    stream = io.StringIO()
    with (
        pytest.raises(InvtrackError, match="diverged"),
        progress("run", console=Console(file=stream, force_terminal=True, _environ={"TERM": "xterm"})),
    ):
        raise InvtrackError("diverged")
