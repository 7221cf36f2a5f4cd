"""A run folder holds a whole summary or none."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invtrack.errors import FileError
from invtrack.files import replaced_when_complete
from invtrack.studies.folder import RunFolder


def summarize(folder: RunFolder, **metrics: Any) -> Path:
    return folder.write_summary(sim="sim", model="rig", timestep=1e-3, cases={"exact": metrics})


def test_summary_reads_back_as_written(tmp_path: Path) -> None:
    folder = RunFolder(tmp_path / "new" / "folder")
    path = folder.write_summary(
        sim="sim",
        model="rig",
        timestep=1e-3,
        cases={"exact": {"max_error": np.float64(0.1), "count": np.int64(3), "residual_vibration": None}},
        durations=np.array([1.0, 2.0]),
        versions={"mujoco": "4.0.0"},
    )
    assert json.loads(path.read_text()) == {
        "sim": "sim",
        "model": "rig",
        "timestep": 1e-3,
        "cases": {"exact": {"max_error": 0.1, "count": 3, "residual_vibration": None}},
        "durations": [1.0, 2.0],
        "versions": {"mujoco": "4.0.0"},
    }
    assert [entry.name for entry in folder.path.iterdir()] == ["summary.json"]


def test_a_new_run_removes_the_old_summary_and_nothing_else(tmp_path: Path) -> None:
    summarize(RunFolder(tmp_path), max_error=1.0)
    (tmp_path / "exact.rrd").write_bytes(b"recording")
    folder = RunFolder(tmp_path)
    assert not folder.summary_path.exists()
    assert folder.file("exact.rrd").read_bytes() == b"recording"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -np.inf, np.float64("nan"), np.array([0.0, np.nan])])
def test_numbers_that_are_not_finite_are_refused_by_name(tmp_path: Path, value: Any) -> None:
    folder = RunFolder(tmp_path)
    with pytest.raises(FileError, match=r"cases\.exact\.max_error(\[1\])? is .*expected a finite number"):
        summarize(folder, max_error=value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("value", "message"), [(object(), "is a object"), (b"bytes", "is a bytes"), ({1: 2}, "expected text")])
def test_values_that_json_cannot_hold_are_refused(tmp_path: Path, value: Any, message: str) -> None:
    with pytest.raises(FileError, match=rf"cases\.exact\.max_error.*{message}"):
        summarize(RunFolder(tmp_path), max_error=value)


def test_a_failed_write_keeps_the_old_file_and_leaves_no_draft(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "figure.png"
    target.write_bytes(b"old")

    def fail(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", fail)
    with pytest.raises(FileError, match="No space left"), replaced_when_complete(target) as draft:
        draft.write_bytes(b"new")
    assert target.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [target]


def test_a_file_in_the_place_of_the_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "taken").write_text("")
    with pytest.raises(FileError, match=r"expected a directory .*--out"):
        RunFolder(tmp_path / "taken")
    with pytest.raises(FileError, match=r"expected a directory .*--out"):
        RunFolder(tmp_path / "taken" / "below")


def test_a_folder_without_write_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # os.access is replaced because the superuser may write everywhere.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileError, match="cannot be written"):
        RunFolder(tmp_path)
