"""The script as a user runs it, with few runs and a coarse step to keep it short."""

from __future__ import annotations

import json
from pathlib import Path

import pyarrow.parquet as pq

from tests.sims.scripts import run_script

RUNS = 5


def test_rows_table_and_figures_are_of_the_same_runs(tmp_path: Path) -> None:
    words = ("--runs", str(RUNS), "--timestep", "0.01", "--out", str(tmp_path / "out"))
    finished = run_script("cantilever_monte_carlo", tmp_path, *words)
    assert finished.returncode == 0, finished.stderr
    assert f"{RUNS} runs of 20 s: {RUNS} completed, {RUNS} of them computed now" in finished.stdout
    summary = json.loads((tmp_path / "out/summary.json").read_text())
    assert (summary["study"], summary["status"], summary["runs"]) == ("cantilever_monte_carlo", "complete", RUNS)
    assert len([name for name in summary["files"] if name.endswith(".png")]) == 5
    found = summary["monte_carlo"]
    rows = pq.read_table(tmp_path / "out" / found["rows"])
    errors = rows["max_error"].to_pylist()
    assert len(errors) == RUNS
    assert found["max_error"]["largest"] == max(errors)
    # What the plan does not know costs much more than the sampling of its input.
    assert min(errors) > 3 * summary["cases"]["nominal"]["max_error"]
    assert max(abs(value) for error in rows["error_tip_position"].to_pylist() for value in error) <= max(errors) * (1 + 1e-12)
    again = run_script("cantilever_monte_carlo", tmp_path, *words, "--no-figures")
    assert f"{RUNS} runs of 20 s: {RUNS} completed.\n" in again.stdout  # the rows were there
    assert json.loads((tmp_path / "out/summary.json").read_text())["monte_carlo"] == found
