"""What the slews of a beam must leave with the right model; the script as a user runs it, cut down to one case."""

from __future__ import annotations

import importlib
from pathlib import Path
from typing import Any

import pytest

from tests.sims.scripts import SIMS, summary_of

STEP = 6e-4  # [s]


@pytest.fixture
def slews(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(SIMS)
    return importlib.import_module("slews.methods"), importlib.import_module("slews.measures")


def test_with_the_right_model_shapers_of_all_modes_and_the_inverse_leave_next_to_nothing(slews: Any) -> None:
    methods, measures = slews
    slew = methods.Slew((0.5, 0.5), 3.0)

    def left(method: str) -> float:
        found: dict[str, float] = measures.tried(slew, slew.controller(method), timestep=STEP)
        return found["residual_vibration"]

    unshaped = left("profile")
    assert unshaped > 1e-3
    for method in ("ZV, all modes", "ZVD, all modes", "inverse"):
        assert left(method) < 0.01 * unshaped, method
    assert left("ZV") > 100 * left("ZV, all modes")  # of one mode: the others are left


def test_the_script_measures_in_mujoco_what_its_linear_model_predicts(tmp_path: Path, slews: Any) -> None:
    summary = summary_of("beam_payload", tmp_path, "--case", "redesign", timestep=STEP, says="the payload halved after 1.2 s")
    methods, measures = slews
    slew = methods.Slew((0.5, 0.25), 3.0)
    assert set(summary["cases"]) == {"redesign"}
    expected = measures.tried(slew, slew.controller("redesign"), timestep=STEP)
    for key in ("residual_vibration", "residual_energy", "peak_input", "peak_strain"):
        assert summary["cases"]["redesign"][key] == pytest.approx(expected[key], rel=0.05), key
