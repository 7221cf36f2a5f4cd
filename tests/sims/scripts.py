"""Running the scripts as a user does: any working directory, no display; in a process of their own, or in this one."""

from __future__ import annotations

import contextlib
import io
import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

SIMS = Path(__file__).parents[2] / "sims"


def run_script(name: str, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """sims/<name>.py with these words on its command line, in the working directory `folder`."""
    command = [sys.executable, str(SIMS / f"{name}.py"), *words]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)


def summary_of(name: str, folder: Path, *words: str, timestep: float, says: str) -> dict[str, Any]:
    """summary.json of a run without figures that ends well and prints `says`; everything it writes is in `folder`.

    In this process, which has loaded already what takes long to load.
    """
    script, out, err = str(SIMS / f"{name}.py"), io.StringIO(), io.StringIO()
    words = ("--timestep", str(timestep), "--no-figures", "--out", str(folder), *words)
    with pytest.MonkeyPatch.context() as patched, contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        patched.syspath_prepend(SIMS)
        patched.setattr(sys, "argv", [script, *words])
        with pytest.raises(SystemExit) as left:
            runpy.run_path(script, run_name="__main__")
    assert not left.value.code, err.getvalue()
    assert says in out.getvalue()
    assert not err.getvalue()
    summary: dict[str, Any] = json.loads((folder / "summary.json").read_text())
    assert (summary["study"], summary["status"]) == (name, "complete")
    assert {path.name for path in folder.iterdir()} == {"summary.json", *summary["files"]}
    return summary
