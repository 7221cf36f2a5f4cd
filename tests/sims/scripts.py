"""Running the scripts as a user does: a separate process, any working directory, no display."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

SIMS = Path(__file__).parents[2] / "sims"


def run_script(name: str, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """sims/<name>.py with these words on its command line, in the working directory `folder`."""
    command = [sys.executable, str(SIMS / f"{name}.py"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def summary_of(name: str, folder: Path, *words: str, timestep: float, says: str) -> dict[str, Any]:
    """summary.json of a run without figures that ends well and prints `says`; everything it writes is in `folder`."""
    finished = run_script(name, folder, "--timestep", str(timestep), "--no-figures", "--out", str(folder), *words)
    assert finished.returncode == 0, finished.stderr
    assert says in finished.stdout
    assert not finished.stderr
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    assert (summary["study"], summary["status"]) == (name, "complete")
    assert {path.name for path in folder.iterdir()} == {"summary.json", *summary["files"]}
    return summary
