"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from typing import Any

import pytest

from tests.sims.scripts import summary_of

WAYS = ("inverse_for_the_hold", "inverse", "linear_inverse", "feedback_only")
REDESIGNS = ("redesigned", "exact", "limited")
LEARNED = "linear_inverse_learned"


@pytest.fixture(scope="module")
def summary(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    names = [f"3_m_{way}" for way in (*WAYS, *REDESIGNS, LEARNED)]
    words = [word for name in (*names, f"12_m_{LEARNED}") for word in ("--case", name)]
    return summary_of("vtol", tmp_path_factory.mktemp("vtol"), *words, timestep=4e-3, says="Redesign 3_m")


@pytest.fixture(scope="module")
def cases(summary: dict[str, Any]) -> dict[str, dict[str, Any]]:
    return dict(summary["cases"])


def test_the_inverse_of_the_motion_steps_aside_where_the_linear_one_falls_and_misses(summary: dict[str, Any]) -> None:
    held, motion, linear, feedback = (summary["cases"][f"3_m_{way}"] for way in WAYS)
    assert held["error_share"] < 1e-7
    assert motion["error_share"] < 2e-5
    assert 0.05 < linear["error_share"] < 0.3
    assert feedback["error_share"] > 0.3
    assert 0.05 < motion["preactuation_time"] < 1.0  # the zeros are +-18 rad/s
    assert "3_m_inverse.rrd" in summary["files"]


def test_the_linear_inverse_learns_the_way_where_it_is_not_too_long(cases: dict[str, dict[str, Any]]) -> None:
    assert cases[f"3_m_{LEARNED}"]["error_share"] < 1e-4  # 0.1 before anything is learned
    assert cases[f"12_m_{LEARNED}"]["status"] == "refused"
    assert cases[f"12_m_{LEARNED}"]["reason"].startswith("learning does not contract")


def test_the_redesigned_way_costs_what_it_says_and_less_than_exact_inversion(cases: dict[str, dict[str, Any]]) -> None:
    redesigned, exact, limited = (cases[f"3_m_{way}"] for way in REDESIGNS)
    for case in (redesigned, limited):
        assert abs(case["cost"] / case["planned_cost"] - 1) < 1e-4
        assert case["clamped"] == 0
    assert redesigned["cost"] < limited["cost"] < exact["cost"] / 2
    assert limited["peak_departure"] < 0.47 < redesigned["peak_departure"]
