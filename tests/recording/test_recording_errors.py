from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader

from invtrack.errors import FileError, RecordingError
from invtrack.recording import load_recording, recording_file, save_recording
from invtrack.results.result import RunResult


def test_cases_need_distinct_names(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"distinct.*\['inversion', 'inversion'\]"):
        save_recording([run, run], tmp_path / "run.rrd")
    with pytest.raises(RecordingError, match="non-empty names"):
        save_recording(dataclasses.replace(run, name=""), tmp_path / "run.rrd")
    with pytest.raises(RecordingError, match="at least one run"):
        save_recording([], tmp_path / "run.rrd")


def test_arrays_must_fit_the_time(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="state needs 300 rows; it has 301"):
        save_recording(dataclasses.replace(run, time=run.time[:-1]), tmp_path / "run.rrd")
    with pytest.raises(RecordingError, match="301 times but 300 rows of qpos"):
        save_recording(dataclasses.replace(run, qpos=run.qpos[1:]), tmp_path / "run.rrd")


def test_the_model_must_fit(run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo writes its warning into a file in the working directory
    with pytest.raises(RecordingError, match="cannot load"):
        save_recording(dataclasses.replace(run, mjb=b"no model" * 100), "run.rrd")
    with pytest.raises(RecordingError, match="3 positions per sample, its model has 2"):
        save_recording(dataclasses.replace(run, qpos=np.zeros((301, 3))), "run.rrd")
    with pytest.raises(RecordingError, match=r"no body 'top'.*cart, arm, tip"):
        save_recording(dataclasses.replace(run, parameter_bodies={"tip_mass": "top"}), "run.rrd")
    with pytest.raises(RecordingError, match="no parameter 'mass'; there are: tip_mass, damping"):
        save_recording(dataclasses.replace(run, parameter_bodies={"mass": "tip"}), "run.rrd")


def test_places_that_cannot_be_written(run: RunResult, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(FileError, match="expected a writable folder"):
        save_recording(run, tmp_path / "file" / "run.rrd")
    (tmp_path / "folder.rrd").mkdir()
    with pytest.raises(FileError, match=r"cannot write .*folder\.rrd"):
        save_recording(run, tmp_path / "folder.rrd")
    with pytest.raises(RecordingError, match=r"ends in \.rrd"):
        save_recording(run, tmp_path / "run.mcap")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["file", "folder.rrd"]


def test_a_failure_midway_leaves_the_earlier_recording(run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = save_recording(run, tmp_path / "run.rrd")

    def fail(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording_file, "send_series", fail)
    with pytest.raises(KeyboardInterrupt):
        save_recording(dataclasses.replace(run, name="later"), path)
    assert list(load_recording(path)) == ["inversion"]
    assert [file.name for file in tmp_path.iterdir()] == ["run.rrd"]


def test_files_that_are_no_recordings(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no recording .*missing"):
        load_recording(tmp_path / "missing.rrd")
    (tmp_path / "text.rrd").write_text("not a recording at all")
    with pytest.raises(RecordingError, match=r"cannot read .*text"):
        load_recording(tmp_path / "text.rrd")
    whole = save_recording(run, tmp_path / "run.rrd").read_bytes()
    (tmp_path / "half.rrd").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RecordingError, match=r"half\.rrd"):
        load_recording(tmp_path / "half.rrd")


def test_recordings_of_other_programs(tmp_path: Path) -> None:
    recording = rr.RecordingStream("other")
    recording.save(tmp_path / "other.rrd")
    recording.log("points", rr.Points3D([[0.0, 0.0, 0.0]]))
    recording.disconnect()
    with pytest.raises(RecordingError, match="not one that invtrack wrote"):
        load_recording(tmp_path / "other.rrd")


def test_a_later_format_is_refused(run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as later:
        later.setattr(recording_file, "FORMAT", 99)
        path = save_recording(run, tmp_path / "run.rrd")
    with pytest.raises(RecordingError, match="format 99, this version reads 3"):
        load_recording(path)


def test_several_cases_do_not_share_the_place_of_one(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="expected one case for a recording that shares its layout with others, got 2"):
        save_recording([run, dataclasses.replace(run, name="other")], tmp_path / "run.rrd", application="study")


def test_missing_data_are_reported(run: RunResult, tmp_path: Path) -> None:
    path = save_recording(run, tmp_path / "run.rrd")
    stream = RrdReader(path).stream().drop(content="/inversion/applied/**")
    stream.write_rrd(tmp_path / "less.rrd", application_id="less", recording_id="less")
    with pytest.raises(RecordingError, match="expected 300 x 1 numbers at /inversion/applied"):
        load_recording(tmp_path / "less.rrd")
