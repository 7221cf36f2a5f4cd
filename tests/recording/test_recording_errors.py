from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import rerun as rr

from invtrack.errors import FileError, RecordingError
from invtrack.recording import load_recording, recording_file, samples, save_recording
from invtrack.results.result import RunResult

CHECKOUT = Path(__file__).parents[2]


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


@pytest.mark.parametrize("half", ["send_series", "write_samples"])
def test_a_failure_midway_leaves_the_earlier_recording(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, half: str
) -> None:
    path = save_recording(run, tmp_path / "run.rrd")

    def fail(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording_file, half, fail)
    with pytest.raises(KeyboardInterrupt):
        save_recording(dataclasses.replace(run, name="later"), path)
    assert list(load_recording(path)) == ["inversion"]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.parquet", "run.rrd"]


def test_an_end_between_the_two_files_is_told_and_loses_no_run(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, later = save_recording(run, tmp_path / "run.rrd"), dataclasses.replace(run, name="later")

    def replace_samples_alone(draft: Path, target: Path) -> None:
        if target.suffix == ".rrd":
            raise KeyboardInterrupt
        os.rename(draft, target)

    with monkeypatch.context() as ending:
        ending.setattr(os, "replace", replace_samples_alone)
        with pytest.raises(KeyboardInterrupt):
            save_recording(later, path)
    with pytest.raises(RecordingError, match="holds the samples of another recording"):
        load_recording(path)
    assert load_recording(path.with_suffix(".parquet"))["later"].equals(later)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.parquet", "run.rrd"]


def test_a_killed_process_leaves_the_earlier_recording(run: RunResult, tmp_path: Path) -> None:
    path = save_recording(run, tmp_path / "run.rrd")
    program = (
        "import os, signal, sys\n"
        "import pyarrow.parquet as pq\n"
        "from invtrack.recording import save_recording\n"
        "from tests.recording.conftest import mechanism_run\n"
        "class Killed(pq.ParquetWriter):\n"
        "    def write_table(self, *arguments, **options):\n"
        "        super().write_table(*arguments, **options)\n"
        "        os.kill(os.getpid(), signal.SIGKILL)\n"
        "pq.ParquetWriter = Killed\n"
        "save_recording(mechanism_run('later'), sys.argv[1])\n"
    )
    search = os.pathsep.join([str(CHECKOUT), os.environ.get("PYTHONPATH", "")])
    ended = subprocess.run([sys.executable, "-c", program, str(path)], env={**os.environ, "PYTHONPATH": search}, check=False)
    assert ended.returncode == -signal.SIGKILL
    assert load_recording(path)["inversion"].equals(run)
    assert {file.name for file in tmp_path.iterdir() if not file.name.startswith(".")} == {"run.parquet", "run.rrd"}


def test_a_failure_of_the_disk_is_reported_and_leaves_the_earlier_recording(
    run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = save_recording(run, tmp_path / "run.rrd")

    def fail(*_: object, **__: object) -> None:
        raise OSError("no space left")

    monkeypatch.setattr(pq.ParquetWriter, "write_table", fail)
    with pytest.raises(
        FileError, match=r"cannot write .*run\.parquet: no space left; expected a writable folder with enough space"
    ):
        save_recording(dataclasses.replace(run, name="later"), path)
    assert load_recording(path)["inversion"].equals(run)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["run.parquet", "run.rrd"]


@pytest.mark.parametrize("name", ["run.rrd", "run.parquet"])
def test_a_folder_in_the_way_of_either_file_is_found_before_anything_is_written(run: RunResult, tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    with pytest.raises(FileError, match=rf"cannot write .*{name}: a folder has that name"):
        save_recording(run, tmp_path / "run.rrd")
    assert [entry.name for entry in tmp_path.iterdir()] == [name]


def test_files_that_are_no_recordings(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"no recording .*missing"):
        load_recording(tmp_path / "missing.rrd")
    with pytest.raises(RecordingError, match=r"ends in \.rrd or \.parquet, got .*run\.csv"):
        load_recording(tmp_path / "run.csv")
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
    with pytest.raises(RecordingError, match="not one that this version of invtrack wrote"):
        load_recording(tmp_path / "other.rrd")
    pq.write_table(pa.table({"time [s]": [0.0, 1.0]}), tmp_path / "other.parquet")
    with pytest.raises(RecordingError, match="a Parquet file, but not one that save_recording wrote"):
        load_recording(tmp_path / "other.parquet")


def test_a_later_format_is_refused(run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with monkeypatch.context() as later:
        later.setattr(recording_file, "FORMAT", 99)
        later.setattr(samples, "FORMAT", 99)
        path = save_recording(run, tmp_path / "run.rrd")
    for file in (path, path.with_suffix(".parquet")):
        with pytest.raises(RecordingError, match=rf"{file.name} has format 99, this version reads 4"):
            load_recording(file)


def test_several_cases_do_not_share_the_place_of_one(run: RunResult, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="expected one case for a recording that shares its layout with others, got 2"):
        save_recording([run, dataclasses.replace(run, name="other")], tmp_path / "run.rrd", application="study")


def test_missing_samples_are_refused(run: RunResult, tmp_path: Path) -> None:
    path = save_recording(run, tmp_path / "run.rrd")
    path.with_suffix(".parquet").rename(tmp_path / "elsewhere.parquet")
    with pytest.raises(RecordingError, match=r"its runs stand in run\.parquet, which is not beside it"):
        load_recording(path)
    assert load_recording(tmp_path / "elsewhere.parquet")["inversion"].equals(run)


def test_samples_of_another_recording_of_the_same_run_are_refused(run: RunResult, tmp_path: Path) -> None:
    path, other = save_recording(run, tmp_path / "run.rrd"), save_recording(run, tmp_path / "other.rrd")
    other.with_suffix(".parquet").replace(path.with_suffix(".parquet"))
    with pytest.raises(RecordingError, match=r"run\.parquet holds the samples of another recording than run\.rrd beside it"):
        load_recording(path)


def test_damage_anywhere_in_the_samples_is_found(run: RunResult, tmp_path: Path) -> None:
    path = save_recording(run, tmp_path / "run.rrd")
    file = path.with_suffix(".parquet")
    whole = file.read_bytes()
    file.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(RecordingError, match=r"cannot read the samples in .*run\.parquet.*damaged or was cut off"):
        load_recording(path)
    plain = dataclasses.replace(
        run, mjb=b"", qpos=np.zeros((0, 0)), parameter_bodies={}
    )  # half of its file says what is in the other
    file = save_recording(plain, path).with_suffix(".parquet")
    whole = file.read_bytes()
    unnoticed = []
    for place in np.random.default_rng(0).integers(0, 8 * len(whole), 500):
        byte, bit = divmod(int(place), 8)
        file.write_bytes(whole[:byte] + bytes([whole[byte] ^ (1 << bit)]) + whole[byte + 1 :])
        try:
            loaded = load_recording(file)
        except RecordingError:
            continue
        if not loaded["inversion"].equals(plain):
            unnoticed.append(place)
    assert unnoticed == []


def rewritten(path: Path, table: pa.Table) -> Path:
    """The file at `path` with other rows or columns, under the metadata that it had."""
    metadata = pq.read_metadata(path).metadata
    pq.write_table(table.replace_schema_metadata({key: metadata[key] for key in metadata if key.startswith(b"invtrack")}), path)
    return path


def test_edited_samples_are_refused(run: RunResult, tmp_path: Path) -> None:
    path = save_recording(run, tmp_path / "run.rrd").with_suffix(".parquet")
    table = pq.read_table(path)
    with pytest.raises(RecordingError, match=r"has no column 'applied base_force \[N\]', 'case'"):
        load_recording(rewritten(path, table.drop_columns(["applied base_force [N]", "case"])))
    with pytest.raises(RecordingError, match=r"column 'qpos 1' of case 'inversion' .*lacks values"):
        load_recording(rewritten(path, table.set_column(table.column_names.index("qpos 1"), "qpos 1", pa.nulls(301, pa.float64()))))
    with pytest.raises(RecordingError, match=r"expected 301 samples of case 'inversion' .*, found 300"):
        load_recording(rewritten(path, table.slice(0, 300)))
    with pytest.raises(RecordingError, match=r"expected 301 samples of case 'inversion' .*, found 0 .*'other'"):
        load_recording(rewritten(path, table.set_column(0, "case", pa.array(["other"] * 301))))
    assert load_recording(rewritten(path, table))["inversion"].equals(run)
