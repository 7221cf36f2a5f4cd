"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path

from tests.sims.scripts import summary_of


def test_arms_are_raised_against_gravity_by_the_inverse_of_their_motion(tmp_path: Path) -> None:
    names = [f"{motion}_{way}" for motion in ("raised", "joints") for way in ("inverse", "linear_inverse", "feedback_only")]
    words = [word for name in names for word in ("--case", name)]
    summary = summary_of("flexible_arm", tmp_path, *words, timestep=2e-3, says="Flexible arms raised against gravity")
    errors = {name: numbers["error_share"] for name, numbers in summary["cases"].items()}
    for motion in ("raised", "joints"):
        assert errors[f"{motion}_inverse"] < 3e-4
        assert errors[f"{motion}_linear_inverse"] > 1e2 * errors[f"{motion}_inverse"]
        assert errors[f"{motion}_feedback_only"] > 1e2 * errors[f"{motion}_inverse"]
    assert summary["cases"]["joints_inverse"]["preactuation_time"] == 0.0  # minimum phase: no zeros at all


def test_the_inverse_learns_what_bearings_rub_more_than_the_model_knows(tmp_path: Path) -> None:
    words = [word for way in ("for_the_hold", "learned") for word in ("--case", f"rubbing_inverse_{way}")]
    cases = summary_of("flexible_arm", tmp_path, *words, timestep=8e-3, says="Flexible arms raised against gravity")["cases"]
    assert cases["rubbing_inverse_for_the_hold"]["error_share"] > 1e-2
    assert cases["rubbing_inverse_learned"]["error_share"] < 1e-3
