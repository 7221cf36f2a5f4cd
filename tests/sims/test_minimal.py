"""The template that newcomers copy, run as they run it, with a coarse step to keep it short."""

from __future__ import annotations

import json
from pathlib import Path

import invtrack
from tests.sims.scripts import SIMS, run_script


def test_the_template_is_short_and_shows_what_inversion_is_worth(tmp_path: Path) -> None:
    assert len([line for line in (SIMS / "minimal.py").read_text().splitlines() if line.strip()]) <= 27
    finished = run_script("minimal", tmp_path, "--timestep", "0.02", "--json")
    assert finished.returncode == 0, finished.stderr
    assert not finished.stderr
    summary = json.loads(finished.stdout)
    recordings = [f"{case}.{kind}" for case in ("inversion", "feedforward_only", "feedback_only") for kind in ("rrd", "parquet")]
    assert summary["files"] == [*recordings, "comparison.png"]
    error = {name: numbers["max_error"] for name, numbers in summary["cases"].items()}
    assert error["inversion"] < error["feedforward_only"] < 1e-3 < 1 < error["feedback_only"]
    recorded = invtrack.load_recording(tmp_path / "runs/minimal/inversion.rrd")["inversion"]
    assert recorded.manoeuvre == (0.0, 6.0)
