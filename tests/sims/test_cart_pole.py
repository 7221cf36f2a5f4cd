"""The script as a user runs it, with a coarse step and three distances to keep it short."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

import invtrack
from tests.sims.scripts import summary_of

DISTANCES = (1.0, 2.0, 40.0)  # [m]
STEP = 4e-3  # [s]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cart_pole")


@pytest.fixture(scope="module")
def summary(folder: Path) -> dict[str, Any]:
    words = [word for distance in DISTANCES for word in ("--amplitude", f"{distance:g}")]
    return summary_of("cart_pole", folder, *words, timestep=STEP, says="A dash stands for a run that diverged")


def test_the_inverse_of_the_motion_leaves_what_holding_its_input_costs(summary: dict[str, Any]) -> None:
    errors = {name: numbers["error_share"] for name, numbers in summary["cases"].items()}
    assert errors["inverse_for_the_hold"] < 1e-7
    assert errors["inverse"] < 2e-5  # sixteen times that of steps of 1 ms
    assert 1e-2 < errors["linear_inverse"] < 0.1
    assert errors["feedback_only"] > 0.5
    assert summary["cases"]["inverse"]["iterations"] <= 8


def test_what_the_linear_inverse_leaves_out_grows_with_the_square_of_the_distance(summary: dict[str, Any]) -> None:
    """By symmetry the neglected terms are of third order, of which the error is a share."""
    near, far, _ = summary["amplitudes"]
    assert far["linear_inverse"] / near["linear_inverse"] == pytest.approx(4.0, rel=0.1)


def test_only_gains_along_the_motion_keep_departures_small_at_forty_metres(summary: dict[str, Any]) -> None:
    furthest = summary["amplitudes"][-1]
    assert furthest["linear_inverse"] is None or furthest["linear_inverse"] > 1.0
    assert furthest["inverse"] < 5e-5
    assert furthest["lean"] == pytest.approx(77.0, abs=1.0)
    assert furthest["gains_of_the_start"] > 1e3 * furthest["gains_along"]


def test_the_recording_shows_the_pole(folder: Path, summary: dict[str, Any]) -> None:
    assert "inverse.rrd" in summary["files"]
    run = invtrack.load_recording(folder / "inverse.rrd")["inverse"]
    assert run.model == "cart_pole"
    assert run.qpos.shape == (len(run.time), 2)
