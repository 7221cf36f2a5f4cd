"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.sims.scripts import summary_of


def test_prediction_and_physics_stand_side_by_side(tmp_path: Path) -> None:
    summary = summary_of("cantilever_sensors", tmp_path, timestep=0.005, says="the actuator passes on -inf to inf")
    cases = summary["cases"]
    names = {"full_state", "kalman_ideal_sensors", "kalman_noise", "placed_noise", "kalman_coarse"}
    assert set(cases) == names | {f"{name}_linear" for name in names}
    for name in names:
        measured, predicted = cases[name], cases[f"{name}_linear"]
        # Where values lie next to the edge between two digits, differences of rounding decide which one is shown.
        tolerance = 0.1 if name == "kalman_coarse" else 1e-4
        assert measured["max_error"] == pytest.approx(predicted["max_error"], rel=tolerance)
        assert measured["peak_input"] == pytest.approx(predicted["peak_input"], rel=1e-6)
    # What holding the input costs is known beforehand: from the plan's state ideal sensors are as good as the state itself.
    assert cases["kalman_ideal_sensors"]["max_error"] == pytest.approx(cases["full_state"]["max_error"], rel=1e-3)
    assert cases["kalman_ideal_sensors"]["max_error"] < cases["kalman_noise"]["max_error"]
    assert cases["kalman_noise"]["max_error"] < 10 * summary["noise"]
    assert {path.stem for path in tmp_path.glob("*.rrd")} == names
