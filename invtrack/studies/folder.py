"""The folder of one run of a study: what is done is on disk at once, and two runs never mix in it."""

from __future__ import annotations

import glob
import json
import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from invtrack.errors import FileError
from invtrack.files import replaced_when_complete

SUMMARY = "summary.json"
UNFINISHED = "unfinished.json"
"""What the summary is called while the study runs. It stays behind where a run is killed or fails."""

Status = Literal["complete", "diverged", "interrupted"]


class RunFolder:
    """The folder of one run.

    Made if it is not there. Until `finish` the summary grows in unfinished.json, which is whole at every moment; then it becomes
    summary.json. It lists the files of the run under "files", by which the next run knows what it may remove.

    Raises FileError where the folder cannot be made or written, or where it holds files but no summary of an earlier run.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._content: dict[str, Any] = {}
        self._files: list[str] = []
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            present = sorted(entry.name for entry in self.path.iterdir())
        except OSError as error:
            raise FileError(
                f"expected a folder for the results at {self.path}, which cannot be made ready: {error.strerror} "
                f"({error.filename}); choose another one with --out"
            ) from error
        if not os.access(self.path, os.W_OK | os.X_OK):
            raise FileError(f"the folder {self.path} is there but cannot be written; choose another one with --out")
        if present and not any(_files_listed(self.path / name) is not None for name in (SUMMARY, UNFINISHED)):
            shown = ", ".join(present[:3]) + (", ..." if len(present) > 3 else "")
            raise FileError(
                f"expected an empty folder or that of an earlier run, but {self.path} holds {shown} and no summary of a run; "
                "choose another one with --out"
            )

    def begin(self) -> None:
        """Remove the files of an earlier run, those alone that it lists. Raises FileError where one cannot be removed."""
        try:
            for summary in (self.path / SUMMARY, self.path / UNFINISHED):
                for name in _files_listed(summary) or []:
                    for leftover in (self.path / name, *self.path.glob(f".{glob.escape(name)}.*.tmp")):
                        leftover.unlink(missing_ok=True)
                summary.unlink(missing_ok=True)  # last, so that the list outlives an interruption
        except OSError as error:
            raise FileError(f"cannot remove {error.filename} of an earlier run: {error.strerror}; choose another --out") from error

    def file(self, name: str) -> Path:
        """The path at which a file of this run is to be written, which is listed from now on.

        Raises FileError where a file of that name is there that no run has listed.
        """
        path = self.path / name
        if path.exists():
            raise FileError(f"{path} is there already and not of an earlier run; move it, or choose another folder with --out")
        self._files.append(name)
        self._save()
        return path

    def keep(self, **entries: Any) -> None:
        """Put entries into the summary, on disk at once.

        Values may be text, finite numbers, None where something is not defined, arrays, and mappings and sequences of these.
        Raises FileError naming the entry that is not finite or not writable as JSON, or the file that cannot be written.
        """
        self._content |= {key: _as_json(key, value) for key, value in entries.items()}
        self._save()

    def finish(self, status: Status) -> dict[str, Any]:
        """Give the summary its status and its name, in one piece and last of all files, and return what it holds."""
        self._files = [name for name in self._files if (self.path / name).exists()]
        self._save(status)
        os.replace(self.path / UNFINISHED, self.path / SUMMARY)
        return self._summary(status)

    def _summary(self, status: str) -> dict[str, Any]:
        study = {"study": self._content.get("study")}
        return {**study, "status": status, **self._content, "files": [*self._files]}

    def _save(self, status: str = "unfinished") -> None:
        text = json.dumps(self._summary(status), indent=2, allow_nan=False)
        with replaced_when_complete(self.path / UNFINISHED) as draft:
            draft.write_text(text + "\n", encoding="utf-8")


def add_to_run(folder: Path, name: str) -> None:
    """List a file, written later, among those of a run that has ended, so that the next run in its folder removes it."""
    path = folder / SUMMARY
    content = json.loads(path.read_text(encoding="utf-8"))
    if name not in content["files"]:
        content["files"].append(name)
        with replaced_when_complete(path) as draft:
            draft.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")


def _files_listed(summary: Path) -> list[str] | None:
    """The plain names that the summary of an earlier run lists, None where this is no summary of a run."""
    try:
        content = json.loads(summary.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(content, dict) or not {"study", "status", "files"} <= content.keys():
        return None
    return [name for name in content["files"] if isinstance(name, str) and name == Path(name).name]


def _as_json(where: str, value: Any) -> Any:
    """`value` in JSON's own types; `where` is its path in the summary, for messages."""
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise FileError(f"{where} has keys {list(value)}; expected text for every key")
        return {key: _as_json(f"{where}.{key}", entry) for key, entry in value.items()}
    if value is None or isinstance(value, (str, bool, int)):
        return value
    if isinstance(value, float):
        if not math.isfinite(value):
            raise FileError(f"{where} is {value}, expected a finite number; pass None where a value is deliberately not defined")
        return value
    if isinstance(value, Sequence) and not isinstance(value, (bytes, bytearray)):
        return [_as_json(f"{where}[{i}]", entry) for i, entry in enumerate(value)]
    raise FileError(f"{where} is a {type(value).__name__}, expected text, numbers, None, or mappings and sequences of these")
