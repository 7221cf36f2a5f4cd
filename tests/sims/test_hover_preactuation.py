"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import invtrack
from tests.cited_plants import HE3_A, HE3_B, HE3_C
from tests.linear.random_plants import assert_same_set, pencil_zeros
from tests.sims.scripts import summary_of


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("hover_preactuation")


@pytest.fixture(scope="module")
def summary(folder: Path) -> dict[str, Any]:
    return summary_of("hover_preactuation", folder, timestep=0.05, says="HE3 of COMPleib")


def as_complex(pairs: list[list[float]]) -> np.ndarray:
    return np.array([complex(*pair) for pair in pairs])


def test_unstable_pair_alone_is_moved(summary: dict[str, Any]) -> None:
    zeros = pencil_zeros(HE3_A, HE3_B, HE3_C, np.zeros((4, 4)))
    assert_same_set(as_complex(summary["zeros"]), zeros, 1e-6)
    moved = [complex(2.0, zero.imag) if zero.real > 0 else zero for zero in zeros]
    assert_same_set(as_complex(summary["zeros_modified"]), [*moved, -1, -2, -3, -4], 1e-6)


def test_exact_plan_is_exact_on_the_linear_model(summary: dict[str, Any]) -> None:
    assert summary["cases"]["exact_linear"]["max_error"] < 1e-6


def test_error_of_the_modified_plan_is_the_predicted_one(summary: dict[str, Any]) -> None:
    linear = summary["cases"]["modified_linear"]
    assert linear["max_error"] == pytest.approx(linear["predicted_max_error"], abs=1e-6)
    assert linear["difference_from_prediction"] < 1e-6
    assert linear["max_error"] < 0.1 * 0.375  # of the peak speed


def test_the_inverse_of_the_rigid_body_is_exact_in_mujoco(summary: dict[str, Any]) -> None:
    """From rest, however far the body tilts: the plan for the linear model leaves 9.8e-3 m/s."""
    assert summary["cases"]["exact_nonlinear"]["max_error"] < 2e-5
    assert summary["cases"]["exact"]["max_error"] > 5e-3


def test_bent_outputs_of_the_rigid_body_are_followed(summary: dict[str, Any]) -> None:
    """At less preactuation than the linear modified inverse, with half its error at most; the peak speed is 0.375 m/s."""
    linear, bent = summary["cases"]["modified"], summary["cases"]["modified_nonlinear"]
    assert bent["preactuation_time"] < linear["preactuation_time"]
    assert bent["max_error"] < 0.5 * linear["max_error"]
    assert bent["difference_from_prediction"] < 1e-5 * 0.375
    assert bent["start"] == pytest.approx(-np.log(100) / 2.0)
    assert bent["fitted_decay_rate"] is None


@pytest.mark.parametrize("case", ["exact", "exact_linear", "exact_nonlinear", "modified", "modified_linear"])
def test_input_fades_backward_as_the_nearest_pole_says(summary: dict[str, Any], case: str) -> None:
    alpha = min(pole.real for pole in as_complex(summary["zeros_modified" if "modified" in case else "zeros"]) if pole.real > 0)
    assert summary["cases"][case]["fitted_decay_rate"] == pytest.approx(alpha, rel=0.01)


def test_preactuation_falls_to_seconds(summary: dict[str, Any]) -> None:
    assert summary["cases"]["exact"]["preactuation_time"] > 30
    assert summary["cases"]["modified"]["preactuation_time"] < 3
    assert summary["cases"]["exact"]["preactuation_time"] > 30 * summary["cases"]["modified"]["preactuation_time"]


@pytest.mark.parametrize("case", ["exact", "modified"])
def test_nonlinear_body_adds_no_more_than_its_tilt_explains(summary: dict[str, Any], case: str) -> None:
    """Velocities along axes that are tilted by phi differ from those along level axes by phi times the speed."""
    numbers = summary["cases"][case]
    tilt = summary["likeness"]["roll phi"][f"{case}_peak"]
    assert numbers["difference_from_prediction"] < tilt * 0.375
    way = numbers["displacement"]
    assert [way["right"], way["down"]] == pytest.approx([1.0, 1.0], abs=0.03)
    assert abs(way["forward"]) < 0.03


def test_recording_shows_the_body(folder: Path) -> None:
    run = invtrack.load_recording(folder / "modified.rrd")["modified"]
    assert run.qpos.shape == (len(run.time), 7)
    assert run.state.channels.names[0] == "helicopter.rx"
    assert run.model == "hover"
