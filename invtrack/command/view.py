"""`invtrack view` and `invtrack compare`: a look at runs that were kept."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import tyro

from invtrack.command.printed import Printed
from invtrack.errors import InvtrackError
from invtrack.figures import comparison_figure, save_figure
from invtrack.results import RunResult, metrics, read_log
from invtrack.studies.table import Column, print_table


@dataclass(frozen=True, kw_only=True)
class View:
    """Open recordings in the Rerun viewer, the cases of several side by side."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Recordings (.rrd), or folders of runs."""

    apart: tyro.conf.FlagCreatePairsOff[bool] = False
    """Open several recordings as they are, one shown at a time, in place of all their cases side by side."""

    def execute(self) -> int:
        """Start the viewer; its status."""
        found = recordings(self.runs)
        if self.apart or len(found) == 1:
            return _viewer(found)
        from invtrack.recording import save_recording  # loads Rerun, which nobody waits for who asks for something else

        with tempfile.TemporaryDirectory() as folder:
            together = Path(folder) / f"{found[0].resolve().parent.name or 'runs'}.rrd"
            runs = [replace(run, name=name) for name, run in named_runs(found).items()]
            return _viewer([save_recording(runs, together)])


@dataclass(frozen=True, kw_only=True)
class Compare(Printed):
    """Print the metrics of runs side by side, and draw their errors and inputs in one figure."""

    runs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="RUN")]
    """Recordings (.rrd), or folders of runs; and logs of hardware (.csv) that was driven along the first run's plan."""

    zero: Annotated[float, tyro.conf.arg(metavar="SECONDS")] = 0.0
    """What the clock of logs shows when the plan's shows 0."""

    figure: Annotated[Path | None, tyro.conf.arg(metavar="FILE.png")] = None
    """Where to draw the comparison."""

    def execute(self) -> int:
        """Print and draw; 0."""
        logs = [path for path in self.runs if path.suffix.lower() == ".csv"]
        found = named_runs(recordings(tuple(path for path in self.runs if path not in logs)))
        first = next(iter(found.values()))
        for path in logs:
            found[str(path)] = read_log(path, first, zero=self.zero)
        rows = {name: {**metrics(run), "status": run.status} for name, run in found.items()}
        if self.json:
            print(json.dumps(rows, indent=2))
        elif not self.quiet:
            columns = ["max error", "rms error", "residual vibration", "peak input", "preactuation time", "postactuation time"]
            print_table("", columns=[Column(name) for name in columns], rows=rows, row_header="run")
        if self.figure is not None:
            save_figure(comparison_figure(list(found.values())), self.figure)
        return 0


def _viewer(paths: list[Path]) -> int:
    return subprocess.run([sys.executable, "-m", "rerun", *map(str, paths)], check=False).returncode


def recordings(paths: tuple[Path, ...]) -> list[Path]:
    """The recordings among paths, and those in folders. Raises InvtrackError where there are none."""
    found: list[Path] = []
    for path in paths:
        inside = sorted(path.glob("*.rrd")) if path.is_dir() else [path]
        if not inside or not all(each.is_file() for each in inside):
            raise InvtrackError(f"{path}: expected a recording (.rrd) or a folder with some")
        found += inside
    if not found:
        raise InvtrackError("expected recordings (.rrd), or folders of runs, got none")
    return found


def named_runs(paths: list[Path]) -> dict[str, RunResult]:
    """All runs of recordings, by names of their own."""
    from invtrack.recording import load_recording  # loads Rerun, which nobody waits for who asks for something else

    runs: dict[str, RunResult] = {}
    for path in paths:
        for name, run in load_recording(path).items():
            runs[name if name not in runs else f"{path.parent.name}/{name}"] = run
    return runs
