"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import invtrack
from tests.sims.scripts import summary_of

LAWS = ("exact_map", "switched_francis", "single_francis", "estimated_exosystem")
CASES = {
    *LAWS,
    "output_feedback",
    *(f"{law}_from_exact_state" for law in LAWS),
    "long_exact_map",
    "long_switched_francis",
    "long_estimated",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("switched_regulator")


@pytest.fixture(scope="module")
def summary(folder: Path) -> dict[str, Any]:
    says = "x_e1: at t = 6.28319 s derivative 0 of output 'tip_position' jumps by 6.28"
    return summary_of("switched_regulator", folder, timestep=0.02, says=says)


def test_the_exact_map_alone_keeps_its_output(summary: dict[str, Any]) -> None:
    cases = summary["cases"]
    assert set(cases) == CASES
    assert {numbers["status"] for numbers in cases.values()} == {"completed"}
    error = {name: numbers["max_error"] for name, numbers in cases.items()}
    step_squared = (summary["timestep"] / 1e-3) ** 2  # held inputs cost second order; at 1 ms the bound is 1e-6
    for name in ("exact_map", "output_feedback", "exact_map_from_exact_state"):
        assert error[name] < 1e-6 * step_squared
    for name in ("switched_francis", "single_francis", "switched_francis_from_exact_state", "long_switched_francis"):
        assert error[name] > 1.0
    assert error["long_exact_map"] < 1e-5 * error["long_switched_francis"] * step_squared


def test_each_jump_shows_in_its_interval(summary: dict[str, Any]) -> None:
    """Started in its own state a switched regulator is as good as the exact map until the first jump, and bad after it."""
    cases = summary["cases"]
    regulator, exact = cases["switched_francis_from_exact_state"], cases["exact_map_from_exact_state"]
    assert regulator["error_mass_0"] < 10 * exact["error_mass_0"]
    assert regulator["error_mass_100"] > 1e3 * exact["error_mass_100"]
    assert regulator["error_before"] is None
    assert cases["exact_map"]["error_before"] < 1e-8
    assert cases["estimated_exosystem"]["preactuation_time"] == 0  # nothing is known before the start


def test_a_wrong_estimate_decays_and_no_jump_renews_it(summary: dict[str, Any]) -> None:
    decay = summary["estimate_decay"]
    assert decay["measured"] == pytest.approx(decay["designed"], rel=0.01)
    cycles = np.array(summary["cases"]["long_estimated"]["cycle_errors"])
    assert summary["long_run"]["jumps"] == 3 * len(cycles) - 1
    fall = np.log(cycles[1] / cycles[8]) / (7 * 2 * np.pi)
    assert fall == pytest.approx(summary["long_run"]["rate_through_jumps"], rel=0.3)
    switched = np.array(summary["cases"]["long_switched_francis"]["cycle_errors"])
    assert switched[-1] > switched[0]


def test_the_map_is_the_one_that_the_paper_prints(summary: dict[str, Any]) -> None:
    G_0, check = np.array(summary["G0"]), summary["G0_check"]
    assert G_0.shape == (6, 2)
    assert check["printed"][0] == [-4.6715, -3.3239]
    assert np.abs(G_0 - np.array(check["printed"])).max() < 0.013
    assert pytest.approx(G_0 - np.array(check["printed"])) == np.array(check["difference"])
    assert check["boundary_residual"] < 1e-10
    assert set(check["not_admissible"]) == {"x_e1", "x_e3", "x_e4"}


def test_recordings_hold_the_jumps(folder: Path, summary: dict[str, Any]) -> None:
    run = invtrack.load_recording(folder / "long_exact_map.rrd")["long_exact_map"]
    changes = np.diff(run.parameters["tip_mass"])
    assert np.count_nonzero(changes) == summary["long_run"]["jumps"]
    assert {event.kind for event in run.events} == {"manoeuvre", "parameter"}
