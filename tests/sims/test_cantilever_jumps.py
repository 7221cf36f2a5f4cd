"""The script as a user runs it: a separate process, any working directory, a coarse step to keep it short."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest

import invtrack
from tests.sims.scripts import run_script

CASES = {
    "inversion",
    "inversion_for_the_hold",
    "inversion_continuous",
    "feedforward_only",
    "feedback_only",
    "frozen_inversion",
    "payload_error",
    "late_switch",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cantilever_jumps")


@pytest.fixture(scope="module")
def finished(folder: Path) -> subprocess.CompletedProcess[str]:
    return run_script("cantilever_jumps", folder, "--timestep", "0.02")


def test_it_ends_well_with_a_table(finished: subprocess.CompletedProcess[str]) -> None:
    assert finished.returncode == 0, finished.stderr
    assert not finished.stderr
    for case in CASES:
        assert case in finished.stdout
    assert "[m]" in finished.stdout


def test_the_summary_ranks_the_cases(folder: Path, finished: subprocess.CompletedProcess[str]) -> None:
    summary = json.loads((folder / "runs/cantilever_jumps/summary.json").read_text())
    assert (summary["study"], summary["status"], summary["timestep"]) == ("cantilever_jumps", "complete", 0.02)
    assert set(summary["cases"]) == CASES
    error = {case: numbers["max_error"] for case, numbers in summary["cases"].items()}
    assert (
        error["inversion_continuous"] < error["inversion"] < error["late_switch"] < error["payload_error"] < error["feedback_only"]
    )
    # What is left when the manoeuvre ends is the error that vibrates on, so its peak to peak is at most twice the largest error.
    for numbers in summary["cases"].values():
        assert 0.5 * numbers["rms_error"] < numbers["residual_vibration"] <= 2 * numbers["max_error"]
    vibration = {case: numbers["residual_vibration"] for case, numbers in summary["cases"].items()}
    assert error["inversion_for_the_hold"] < 1e-2 * error["inversion"]
    assert vibration["inversion_continuous"] < 1e-2 * vibration["inversion"] < 1e-4 * vibration["feedback_only"]
    coarse, fine = summary["error_slope"][-1], summary["error_slope"][0]
    assert coarse["max_error"] / fine["max_error"] == pytest.approx((coarse["timestep"] / fine["timestep"]) ** 2, rel=0.1)


def test_recordings_hold_the_runs_and_figures_are_drawn(folder: Path, finished: subprocess.CompletedProcess[str]) -> None:
    out = folder / "runs/cantilever_jumps"
    errors = {case: numbers["max_error"] for case, numbers in json.loads((out / "summary.json").read_text())["cases"].items()}
    for case in CASES:
        run = invtrack.load_recording(out / f"{case}.rrd")[case]
        assert run.manoeuvre == pytest.approx((0.0, 6.283185307179586))
        assert set(run.parameters["tip_mass"]) == ({0.0, 105.0, 10.5} if case == "payload_error" else {0.0, 100.0, 10.0})
        assert invtrack.max_error(run) == errors[case]  # every sample is there
    for name in (*(f"tracking_{case}" for case in CASES), "comparison", "preactuation"):
        assert coloured(out / f"{name}.png") > 2e-3


def coloured(path: Path) -> float:
    """Share of a picture that is neither white nor black nor grey: of its lines, for axes and texts have no colour."""
    pixels = matplotlib.image.imread(path)[:, :, :3]
    return float(np.mean(np.ptp(pixels, axis=2) > 0.3))


@pytest.mark.parametrize(("words", "status"), [(("--timestep", "-1"), 2), (("--out", "file/under"), 1)])
def test_mistakes_end_in_one_message(tmp_path: Path, words: tuple[str, ...], status: int) -> None:
    (tmp_path / "file").write_text("in the way")
    failed = run_script("cantilever_jumps", tmp_path, *words)
    assert failed.returncode == status
    assert "Traceback" not in failed.stderr
    assert failed.stderr.strip()
    assert not list(tmp_path.rglob("summary.json"))
