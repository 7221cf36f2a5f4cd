"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sims.scripts import summary_of


def test_nothing_that_was_tried_costs_less_than_the_optimum_through_the_jumps(tmp_path: Path) -> None:
    summary = summary_of("cantilever_redesign", tmp_path, timestep=0.01, says="MuJoCo gives")
    costs = {name: numbers["cost"] for name, numbers in summary["cases"].items()}
    best = costs.pop("redesigned")
    assert best == pytest.approx(summary["predicted_cost"], rel=1e-4)
    assert len(costs) >= 20
    assert min(costs.values()) > best + 1e-4
    above = summary["above_optimum"]
    assert above == pytest.approx({"redesigned": 0.0, **{name: cost - best for name, cost in costs.items()}})
    for number in range(1, 7):  # the cost is quadratic around its minimum: either sign of a change costs the same
        assert costs[f"disturbed_plus_{number}"] - best == pytest.approx(costs[f"disturbed_minus_{number}"] - best, rel=0.05)
    assert costs["scaled_inversion"] < min(costs["exact_inversion"], costs["not_moving"])
    assert not list(tmp_path.glob("disturbed*.rrd"))
