"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.sims.scripts import summary_of

EXPERIMENT = ("experiment_exact", "experiment_redesigned", "experiment_limited")


@pytest.fixture(scope="module")
def summary(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("run")
    result = summary_of("two_disc_redesign", folder, timestep=0.05, says="the papers report")
    assert {path.stem for path in folder.glob("*.rrd")} == set(result["cases"])
    return result


def test_measured_reductions_are_the_predicted_ones(summary: dict[str, Any]) -> None:
    assert len(summary["durations"]) == 18
    for row in summary["durations"]:
        for share, predicted in row["predicted"].items():
            assert row["measured"][share] == pytest.approx(predicted, abs=0.01)
        limited = row["limited"]
        assert limited["measured"] == pytest.approx(limited["predicted"], abs=0.01)
        assert 0.999 * limited["input_limit"] < limited["peak_input"] <= limited["input_limit"]  # reached, and not passed
        assert limited["clamped"] == 0
    for profile in ("quintic", "septic"):
        changes = [row["predicted"]["output_change"] for row in summary["durations"] if row["profile"] == profile]
        assert changes == sorted(changes, reverse=True)
    assert set(summary["cases"]) == {"exact", "redesigned", "redesigned_limited", "exact_clamped", *EXPERIMENT}
    assert summary["cases"]["exact"]["max_error"] < 1e-4


def test_published_figures_occur_where_they_are_known_to(summary: dict[str, Any]) -> None:
    """Published with the plant's numbers: 10 % of the slew near 30 s, 60 % of the input near 27 s, 20 % of the twist near 41 s."""
    at = {share: there["duration"] for share, there in summary["published_at"].items()}
    assert at == pytest.approx({"output_change": 30, "input_reduction": 27, "twist_reduction": 41}, abs=0.5)


def test_the_papers_weights_are_a_point_of_the_trade_off(summary: dict[str, Any]) -> None:
    (papers,) = (row for row in summary["pareto"] if (row["r"], row["q_x"], row["q_y"]) == (1, 5000, 1))
    (shown,) = (row for row in summary["durations"] if (row["profile"], row["duration"]) == ("quintic", 30))
    assert papers["output_change"] == pytest.approx(shown["predicted"]["output_change"], rel=1e-3)
    assert 1 - papers["peak_input_share"] == pytest.approx(shown["predicted"]["input_reduction"], rel=1e-3)
    for q_x in (5000, 0):
        family = sorted((row for row in summary["pareto"] if row["q_x"] == q_x), key=lambda row: float(row["q_y"]))
        for figure, falls in (("output_change", True), ("rms_input", False), ("peak_twist", False)):
            values = [row[figure] for row in family]
            assert values == sorted(values, reverse=falls)


def test_limits_are_kept_and_the_clamp_never_acts(summary: dict[str, Any]) -> None:
    limits, measured = summary["limits"]["limits"], summary["limits"]["measured"]
    limited = measured["redesigned_limited"]
    assert limited["clamped"] == 0
    for quantity, figure in (("input", "peak_input"), ("input_rate", "peak_rate"), ("twist", "peak_twist")):
        assert limited[figure] <= limits[quantity] * (1 + 1e-6)
        assert limited[figure] >= limits[quantity] * (1 - 2e-3)
        assert summary["limits"]["planned"]["exact"][figure] > 1.1 * limits[quantity]
    assert {each["name"].split()[0] for each in summary["limits"]["active"]} == {"input", "rate", "'twist'"}
    assert all(each["seconds"] > 0.1 for each in summary["limits"]["active"])
    assert measured["exact_clamped"]["clamped"] > 0
    assert measured["exact_clamped"]["max_error"] > 3 * limited["max_error"]


def test_the_experiment_keeps_the_reductions_that_noise_leaves(summary: dict[str, Any]) -> None:
    rigs = summary["experiment"]
    assert len({json.dumps(row["rig"]) for row in rigs}) == len(rigs) >= 6
    for row in rigs:
        measured, predicted = row["measured"], row["predicted"]
        assert measured["output_change"] == pytest.approx(predicted["output_change"], abs=0.01)
        assert measured["twist_reduction"] == pytest.approx(predicted["twist_reduction"], abs=0.05)
        # Noise of the same size rides on both inputs, so the smaller one loses more of its reduction.
        assert predicted["input_reduction"] - 0.10 < measured["input_reduction"] < predicted["input_reduction"]
        if row["name"].startswith("as identified"):
            assert row["redesigned"]["input_noise"] == pytest.approx(row["exact"]["input_noise"], rel=0.1)
