"""What is kept of a run that a test has looked at: its recording and a figure, in a folder of the test's own."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

from invtrack.arguments import file_path
from invtrack.figures import save_figure, tracking_figure
from invtrack.recording import save_recording
from invtrack.results.result import RunResult
from invtrack.results.vibration import vibration_window

LONGEST_NAME = 80

RECORDING, FIGURE = "recording", "figure"

KINDS = ".rrd", ".parquet", ".png"
"""What the files end in: a recording is two of them."""


class Artifacts:
    """The folder in which tests keep recordings and figures, each test in a folder of its own: <folder>/<test>/<run>.rrd and so on.

    A run that several tests share is kept once, in the folder of the first. Raises FileError for what is no path.
    """

    def __init__(self, folder: str | Path) -> None:
        self.folder = file_path(folder)
        self._kept: dict[int, tuple[RunResult, dict[str, str]]] = {}

    def keep(self, run: RunResult, test: str) -> dict[str, str]:
        """Write the recording and the figure of a run; "recording" and "figure" with their paths, or why one could not be written.

        test: a name of the test, such as pytest's node id.
        """
        if id(run) not in self._kept:  # the run is kept with it, so that no other one gets its identity
            stem = self._of(test) / _file_name(run.name)
            self._kept[id(run)] = run, {RECORDING: _record(run, stem), FIGURE: _draw(run, stem)}
        return self._kept[id(run)][1]

    def _of(self, test: str) -> Path:
        """The folder of a test: called by its module and its name, and distinct by all of its node id."""
        module, separator, name = test.partition("::")
        return self.folder / _file_name(module.rpartition("/")[2] + separator + name, distinct=test)

    def discard(self, test: str) -> None:
        """Remove what an earlier session has kept for a test that now passes."""
        folder = self._of(test)
        if not folder.is_dir():
            return
        for path in (path for kind in KINDS for path in folder.glob(f"*{kind}")):
            path.unlink(missing_ok=True)
        if not any(folder.iterdir()):
            folder.rmdir()


def _record(run: RunResult, stem: Path) -> str:
    path = stem.with_name(f"{stem.name}.rrd")
    try:
        save_recording(run, path)
    except Exception as error:  # whatever it is, the report of the test that failed is not to be lost for it
        return f"not kept: {error}"
    return str(path)


def _draw(run: RunResult, stem: Path) -> str:
    path = stem.with_name(f"{stem.name}.png")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        save_figure(tracking_figure(run, window=_shown(run)), path)
    except Exception as error:
        return f"not drawn: {error}"
    return str(path)


def _shown(run: RunResult) -> tuple[float, float]:
    """From before the manoeuvre until the residual vibration is seen, as far as the run goes."""
    T_i, T_f = run.manoeuvre
    lasting = max(vibration_window(run).value or 0.0, T_f - T_i)
    return max(float(run.time[0]), T_i - lasting), min(float(run.time[-1]), T_f + lasting)


def _file_name(text: str, *, distinct: str | None = None) -> str:
    """A name that files can have everywhere, distinct for distinct texts, or for what else has to be told apart."""
    plain = re.sub(r"[^A-Za-z0-9_.=+-]+", "-", text).strip("-.")[:LONGEST_NAME]
    whole = text if distinct is None else distinct
    return plain if plain == whole else f"{plain}-{hashlib.blake2b(whole.encode(), digest_size=3).hexdigest()}"
