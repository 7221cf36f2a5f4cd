"""A run folder holds a whole summary or none, and the files of one run."""

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


def begun(path: Path) -> RunFolder:
    folder = RunFolder(path)
    folder.begin()
    folder.keep(study="sim", cases={})
    return folder


def names(path: Path) -> set[str]:
    return {entry.name for entry in path.iterdir()}


def test_summary_reads_back_as_written(tmp_path: Path) -> None:
    folder = begun(tmp_path / "new" / "folder")
    folder.keep(
        cases={"exact": {"max_error": np.float64(0.1), "count": np.int64(3), "residual_vibration": None}},
        durations=np.array([1.0, 2.0]),
    )
    folder.file("exact.rrd").write_bytes(b"recording")
    folder.file("never_written.png")
    returned = folder.finish("complete")
    assert names(folder.path) == {"summary.json", "exact.rrd"}
    assert json.loads((folder.path / "summary.json").read_text()) == returned
    assert returned == {
        "study": "sim",
        "status": "complete",
        "cases": {"exact": {"max_error": 0.1, "count": 3, "residual_vibration": None}},
        "durations": [1.0, 2.0],
        "files": ["exact.rrd"],
    }


@pytest.mark.parametrize("finished", [True, False])
def test_a_new_run_removes_the_files_of_the_old_one_and_no_others(tmp_path: Path, finished: bool) -> None:
    folder = begun(tmp_path)
    folder.file("exact.rrd").write_bytes(b"recording")
    (tmp_path / ".exact.rrd.123.tmp").write_bytes(b"a draft that a kill left")
    if finished:
        folder.finish("complete")
    (tmp_path / "notes.txt").write_text("a stranger's")
    again = RunFolder(tmp_path)
    assert "exact.rrd" in names(tmp_path)  # until the run begins
    again.begin()
    assert names(tmp_path) == {"notes.txt"}


@pytest.mark.parametrize("file", ["notes.txt", "summary.json", "unfinished.json"])
def test_a_folder_of_something_else_is_refused_and_left_as_it_is(tmp_path: Path, file: str) -> None:
    (tmp_path / file).write_text('{"cases": {}}')
    with pytest.raises(FileError, match=rf"expected an empty folder .* holds {file} .*--out"):
        RunFolder(tmp_path)
    assert (tmp_path / file).read_text() == '{"cases": {}}'


def test_a_list_that_was_tampered_with_removes_nothing_outside(tmp_path: Path) -> None:
    outside = tmp_path / "precious"
    outside.write_text("")
    begun(tmp_path / "run").finish("complete")
    summary = tmp_path / "run" / "summary.json"
    summary.write_text(json.dumps({**json.loads(summary.read_text()), "files": ["../precious", str(outside), 3]}))
    begun(tmp_path / "run")
    assert outside.exists()


def test_a_stranger_is_not_overwritten(tmp_path: Path) -> None:
    begun(tmp_path).finish("complete")
    (tmp_path / "exact.rrd").write_bytes(b"a stranger's")
    folder = begun(tmp_path)
    with pytest.raises(FileError, match=r"exact\.rrd is there already"):
        folder.file("exact.rrd")
    assert (tmp_path / "exact.rrd").read_bytes() == b"a stranger's"


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -np.inf, np.float64("nan"), np.array([0.0, np.nan])])
def test_numbers_that_are_not_finite_are_refused_by_name(tmp_path: Path, value: Any) -> None:
    with pytest.raises(FileError, match=r"cases\.exact\.max_error(\[1\])? is .*expected a finite number"):
        begun(tmp_path).keep(cases={"exact": {"max_error": value}})


@pytest.mark.parametrize(("value", "message"), [(object(), "is a object"), (b"bytes", "is a bytes"), ({1: 2}, "expected text")])
def test_values_that_json_cannot_hold_are_refused(tmp_path: Path, value: Any, message: str) -> None:
    with pytest.raises(FileError, match=rf"cases\.exact\.max_error.*{message}"):
        begun(tmp_path).keep(cases={"exact": {"max_error": value}})


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
    with pytest.raises(FileError, match=r"expected a folder .*--out"):
        RunFolder(tmp_path / "taken")
    with pytest.raises(FileError, match=r"expected a folder .*--out"):
        RunFolder(tmp_path / "taken" / "below")


def test_a_folder_without_write_permission_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # os.access is replaced because the superuser may write everywhere.
    monkeypatch.setattr(os, "access", lambda *_: False)
    with pytest.raises(FileError, match="cannot be written"):
        RunFolder(tmp_path)
