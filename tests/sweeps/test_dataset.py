"""The rows on disk: what is read is what was written, or is not taken."""

from __future__ import annotations

import os
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from invtrack import files
from invtrack.errors import FileError
from invtrack.sweeps import Row, grid, sweep
from invtrack.sweeps.dataset import Dataset
from invtrack.sweeps.row import Outcome

STRANGE = [0.0, -0.0, 5e-324, -1.7976931348623157e308, np.inf, -np.inf, np.nan, 0.1 + 0.2]


def row(index: int) -> Row:
    numbers = {"value": STRANGE[index % len(STRANGE)], "word": "µ, \n", "flag": index % 2 == 0, "none": None}
    traces = {} if index == 3 else {"error": np.roll(STRANGE, index), "empty": np.zeros(0)}
    status = "diverged" if index == 3 else "completed"
    point = {"a": 0.1 * index, "count": 2**62 + index, "method": "exact", "on": True}
    return Row.of(index, point, index, Outcome(status, "why" * index, numbers, traces))


def test_rows_are_read_back_bit_for_bit(tmp_path: Path) -> None:
    written = [row(i) for i in range(10)]
    dataset = Dataset(tmp_path, "0")
    dataset.add(written[:4])
    dataset.add(written[4:])
    read = Dataset(tmp_path, "0").rows()
    for mine in written:
        theirs = read[mine.key]
        assert theirs.equals(mine)
        assert dict(theirs.point) == dict(mine.point)
        assert {name: np.float64(value).tobytes() for name, value in theirs.numbers.items() if isinstance(value, float)} == {
            "value": np.float64(mine.numbers["value"]).tobytes()  # type: ignore[arg-type]
        }
        assert {name: values.tobytes() for name, values in theirs.traces.items()} == {
            name: np.asarray(values).tobytes() for name, values in mine.traces.items()
        }


def test_the_file_does_not_depend_on_the_order_in_which_rows_came(tmp_path: Path) -> None:
    written = [row(i) for i in range(10)]
    contents = []
    for name, order in (("forward", written), ("backward", written[::-1])):
        dataset = Dataset(tmp_path / name, "0")
        for each in order:
            dataset.add([each])
        read = dataset.rows()
        dataset.compact([read[mine.key] for mine in written], [])
        contents.append(dataset.path.read_bytes())
    assert contents[0] == contents[1]


def test_no_flipped_bit_is_taken_for_a_row(tmp_path: Path) -> None:
    dataset = Dataset(tmp_path, "0")
    dataset.add([row(i) for i in range(10)])
    genuine = {row(i).digest for i in range(10)}
    (part,) = dataset.folder.iterdir()
    whole = part.read_bytes()
    lost = 0
    for place in range(0, len(whole), 29):
        part.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << place % 8)]) + whole[place + 1 :])
        with warnings.catch_warnings(record=True) as heard:
            warnings.simplefilter("always")
            read = dataset.rows()
        assert {each.digest for each in read.values()} <= genuine
        assert len(read) == 10 or len(heard) == 1  # what is missing is told
        lost += len(read) < 10
    assert lost > 10


def test_an_interruption_in_the_middle_of_writing_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    replace, parts = os.replace, 0

    def interrupted(draft: Path, path: Path) -> None:
        nonlocal parts
        parts += 1
        if parts == 2:
            raise KeyboardInterrupt
        replace(draft, path)

    monkeypatch.setattr("invtrack.sweeps.running.SECONDS_BETWEEN_PARTS", 0.0)

    def study(point: dict[str, Any], seed: int) -> dict[str, float]:
        return {"value": point["a"] / 3}

    design = grid({"a": list(range(40))})
    with monkeypatch.context() as patch:
        patch.setattr(files.os, "replace", interrupted)
        with pytest.raises(KeyboardInterrupt):
            sweep(study, design, out=tmp_path, workers=1, progress=lambda share: None)
    (folder,) = tmp_path.iterdir()
    assert not list(folder.glob(".*.tmp"))
    kept = len(Dataset(tmp_path, folder.name.removeprefix("study=")).rows())
    finished = sweep(study, design, out=tmp_path)
    assert kept > 0
    assert finished.computed == 40 - kept
    assert finished.numbers("value").tolist() == [a / 3 for a in range(40)]


def test_a_folder_that_cannot_be_read_is_no_damage(tmp_path: Path) -> None:
    dataset = Dataset(tmp_path, "0")
    (dataset.folder / "part-00000000-0.parquet").mkdir()
    with pytest.raises(FileError, match=r"cannot read .* which may hold rows of this sweep"):
        dataset.rows()
