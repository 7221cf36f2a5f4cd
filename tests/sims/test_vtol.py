"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path

from tests.sims.scripts import summary_of

WAYS = ("inverse_for_the_hold", "inverse", "linear_inverse", "feedback_only")


def test_the_inverse_of_the_motion_steps_aside_where_the_linear_one_falls_and_misses(tmp_path: Path) -> None:
    words = [word for way in WAYS for word in ("--case", f"3_m_{way}")]
    summary = summary_of("vtol", tmp_path, *words, timestep=4e-3, says="VTOL")
    held, motion, linear, feedback = (summary["cases"][f"3_m_{way}"] for way in WAYS)
    assert held["error_share"] < 1e-7
    assert motion["error_share"] < 2e-5
    assert 0.05 < linear["error_share"] < 0.3
    assert feedback["error_share"] > 0.3
    assert 0.05 < motion["preactuation_time"] < 1.0  # the zeros are +-18 rad/s
    assert "3_m_inverse.rrd" in summary["files"]


def test_the_linear_inverse_learns_the_way_where_it_is_not_too_long(tmp_path: Path) -> None:
    words = [word for distance in ("3", "12") for word in ("--case", f"{distance}_m_linear_inverse_learned")]
    cases = summary_of("vtol", tmp_path, *words, timestep=4e-3, says="VTOL")["cases"]
    assert cases["3_m_linear_inverse_learned"]["error_share"] < 1e-4  # 0.1 before anything is learned
    assert cases["12_m_linear_inverse_learned"]["status"] == "refused"
    assert cases["12_m_linear_inverse_learned"]["reason"].startswith("learning does not contract")


def test_the_redesigned_way_costs_what_it_says_and_less_than_exact_inversion(tmp_path: Path) -> None:
    words = [word for way in ("redesigned", "exact", "limited") for word in ("--case", f"3_m_{way}")]
    cases = summary_of("vtol", tmp_path, *words, timestep=4e-3, says="Redesign 3_m")["cases"]
    redesigned, exact, limited = (cases[f"3_m_{way}"] for way in ("redesigned", "exact", "limited"))
    for case in (redesigned, limited):
        assert abs(case["cost"] / case["planned_cost"] - 1) < 1e-4
        assert case["clamped"] == 0
    assert redesigned["cost"] < limited["cost"] < exact["cost"] / 2
    assert limited["peak_departure"] < 0.47 < redesigned["peak_departure"]
