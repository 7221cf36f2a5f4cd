"""The directory in which one sim leaves its summary, recordings and figures."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from invtrack.errors import FileError
from invtrack.files import replaced_when_complete

SUMMARY_NAME = "summary.json"


class RunFolder:
    """The output directory of one sim: created if it is not there, and without a summary until `write_summary` has run.

    A summary left by an earlier run is removed at once, so that a sim that fails midway leaves none. Other files stay until they
    are written anew.

    Raises FileError where the directory cannot be made or written.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self.summary_path.unlink(missing_ok=True)
        except OSError as error:
            raise FileError(
                f"expected a directory for the results at {self.path}, which cannot be made ready: {error.strerror} "
                f"({error.filename}); choose another one with --out"
            ) from error
        if not os.access(self.path, os.W_OK | os.X_OK):
            raise FileError(f"the directory {self.path} is there but cannot be written; choose another one with --out")

    @property
    def summary_path(self) -> Path:
        """Where the summary stands once it is written."""
        return self.path / SUMMARY_NAME

    def file(self, name: str) -> Path:
        """Path of a file of this run, for instance `folder.file("tracking.png")`."""
        return self.path / name

    def write_summary(self, *, sim: str, model: str, timestep: float, cases: Mapping[str, Mapping[str, Any]], **extra: Any) -> Path:
        """Write summary.json in one piece and return its path.

        The file holds {"sim", "model", "timestep" [s], "cases": {case: {metric: number in SI units}}} and whatever `extra` adds
        at the top. Values may be text, finite numbers, None where a metric is not defined, arrays, and mappings and sequences
        of these.

        Raises FileError naming the entry that is not finite or not writable as JSON, or the file that cannot be written.
        """
        summary = {"sim": sim, "model": model, "timestep": timestep, "cases": cases, **extra}
        text = json.dumps(_as_json("", summary), indent=2, allow_nan=False)
        with replaced_when_complete(self.summary_path) as draft:
            draft.write_text(text + "\n", encoding="utf-8")
        return self.summary_path


def _as_json(where: str, value: Any) -> Any:
    """`value` in JSON's own types; `where` is its path in the summary, for messages."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise FileError(f"{where or 'the summary'} has keys {list(value)}; expected text for every key")
        return {key: _as_json(f"{where}.{key}".lstrip("."), entry) for key, entry in value.items()}
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise FileError(f"{where} is {value}, expected a finite number; pass None where a value is deliberately not defined")
        return value
    if isinstance(value, Sequence) and not isinstance(value, (bytes, bytearray)):
        return [_as_json(f"{where}[{i}]", entry) for i, entry in enumerate(value)]
    raise FileError(f"{where} is a {type(value).__name__}, expected text, numbers, None, or mappings and sequences of these")
