"""The script as a user runs it, with a coarse step to keep it short."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "sims" / "two_disc_redesign.py"


def test_measured_reductions_are_the_predicted_ones(tmp_path: Path) -> None:
    words = [sys.executable, str(SCRIPT), "--timestep", "0.05", "--no-figures", "--out", str(tmp_path)]
    finished = subprocess.run(words, capture_output=True, text=True, check=False)
    assert finished.returncode == 0, finished.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert len(summary["durations"]) == 18
    for row in summary["durations"]:
        for share, predicted in row["predicted"].items():
            assert row["measured"][share] == pytest.approx(predicted, abs=0.01)
    for profile in ("quintic", "septic"):
        changes = [row["predicted"]["output_change"] for row in summary["durations"] if row["profile"] == profile]
        assert changes == sorted(changes, reverse=True)
    # Published with the plant's numbers: 10 % of the slew near 30 s, 60 % of the input near 27 s, 20 % of the twist near 41 s.
    at = {share: there["duration"] for share, there in summary["published_at"].items()}
    assert at == pytest.approx({"output_change": 30, "input_reduction": 27, "twist_reduction": 41}, abs=0.5)
    assert set(summary["cases"]) == {"exact", "redesigned"}
    assert summary["cases"]["exact"]["max_error"] < 1e-4
