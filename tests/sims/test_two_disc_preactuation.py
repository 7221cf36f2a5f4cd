"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate

import invtrack
from tests.sims.scripts import summary_of

DURATION = 5.0
# Ratios of the identified rig: k / J1, b1 / J1, b2 / J2, and b1 / b2 (J1 : J2 as k / J2 : k / J1).
STIFFNESS_1, STIFFNESS_2, MOTOR_1, MOTOR_2 = 3.1555, 2.8956, 1.8139, 0.27
MOTOR_RATIO = MOTOR_1 * STIFFNESS_2 / (MOTOR_2 * STIFFNESS_1)
# With the second disc held still, J1 th1'' = -k (1 + b1 / b2) th1.
RINGING = np.sqrt(STIFFNESS_1 * (1 + MOTOR_RATIO))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("two_disc_preactuation")


@pytest.fixture(scope="module")
def summary(folder: Path) -> dict[str, Any]:
    says = "passive_exact is refused: internal dynamics are not hyperbolic"
    return summary_of("two_disc_preactuation", folder, timestep=0.02, says=says)


@pytest.fixture(scope="module")
def cases(summary: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return dict(summary["cases"])


def test_zeros_are_near_the_axis_and_on_it(summary: dict[str, Any]) -> None:
    assert np.abs(summary["zeros"]["identified"]) == pytest.approx(np.array([[0.21998, 4.74976]] * 2), abs=1e-5)
    assert np.abs(summary["zeros"]["passive"]) == pytest.approx(np.array([[0.0, RINGING]] * 2), abs=1e-8)


def test_exact_inversion_on_the_axis_is_refused_with_its_reason(cases: dict[str, dict[str, Any]]) -> None:
    refused = cases["passive_exact"]
    assert refused.keys() == {"status", "reason"}
    assert refused["status"] == "refused"
    assert "lie on the imaginary axis" in refused["reason"]


@pytest.mark.parametrize("case", ["identified_modified", "passive_modified"])
def test_modified_slew_is_bounded_decays_and_ends_on_its_target(cases: dict[str, dict[str, Any]], case: str) -> None:
    numbers = cases[case]
    assert numbers["max_error"] == pytest.approx(numbers["predicted_max_error"], abs=1e-6)
    assert 1e-3 < numbers["max_error"] < 5e-3
    assert numbers["final_error"] < 1e-6
    assert numbers["input_left"] < 1e-6 * numbers["peak_input"]
    assert numbers["preactuation_time"] < 3


def test_exact_inverse_of_the_identified_rig_needs_far_longer(cases: dict[str, dict[str, Any]]) -> None:
    assert cases["identified_exact"]["max_error"] < 1e-6
    assert cases["identified_exact"]["preactuation_time"] > 5 * cases["identified_modified"]["preactuation_time"]


def test_causal_inverse_tracks_and_rings_as_the_spectrum_of_the_slew_says(cases: dict[str, dict[str, Any]]) -> None:
    """With d = th1 - th2 and th2 = y_d: d'' + ringing^2 d = (b1 J2 / (b2 J1) - 1) y_d'', from rest."""
    acceleration = invtrack.rest_to_rest(0.0, 1.0, DURATION)
    parts = [
        scipy.integrate.quad(
            lambda t, wave=wave: acceleration(t, derivative=2)[0] * wave(RINGING * t), 0.0, DURATION, epsabs=1e-12, limit=200
        )[0]
        for wave in (np.cos, np.sin)
    ]
    amplitude = abs(MOTOR_1 / MOTOR_2 - 1) * np.hypot(*parts) / RINGING
    causal = cases["passive_causal"]
    assert causal["twist_left"] == pytest.approx(amplitude, rel=1e-3)
    assert causal["max_error"] < 1e-6
    assert causal["preactuation_time"] == 0
    assert causal["input_left"] > 0.3 * causal["peak_input"]


def test_redesign_with_the_same_error_acts_earlier(cases: dict[str, dict[str, Any]]) -> None:
    redesigned, modified = cases["passive_redesigned_same_error"], cases["passive_modified"]
    assert redesigned["max_error"] == pytest.approx(modified["max_error"], rel=0.01)
    assert redesigned["preactuation_time"] > 1.5 * modified["preactuation_time"]
    assert redesigned["peak_input"] < modified["peak_input"]
    assert redesigned["final_error"] < 1e-6


@pytest.mark.parametrize("speed", ["slow", "fast"])
def test_less_preactuation_costs_more_error(summary: dict[str, Any], speed: str) -> None:
    rows = [row for row in summary["trade_off"] if row["remedy"] == f"modified, {speed} error poles"]
    assert len(rows) == 7
    for earlier, later in pairwise(sorted(rows, key=lambda row: row["real_part"])):
        assert later["preactuation"] < earlier["preactuation"]
        assert later["max_error"] > earlier["max_error"]


def test_case_in_the_trade_off_is_the_one_driven(summary: dict[str, Any], cases: dict[str, dict[str, Any]]) -> None:
    (row,) = (row for row in summary["trade_off"] if row.get("real_part") == 2.0 and "fast" in row["remedy"])
    driven = cases["passive_modified"]
    assert row["preactuation"] == pytest.approx(driven["preactuation_time"], abs=2 * summary["timestep"])
    assert row["max_error"] == pytest.approx(driven["max_error"], rel=1e-3)
    assert row["peak_input"] == pytest.approx(driven["peak_input"], rel=0.01)


def test_every_driven_case_is_recorded(folder: Path, cases: dict[str, dict[str, Any]]) -> None:
    driven = {name for name, numbers in cases.items() if numbers["status"] == "completed"}
    assert {path.stem for path in folder.glob("*.rrd")} == driven
