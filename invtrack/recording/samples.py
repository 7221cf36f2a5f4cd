"""Every sample of runs in one Parquet file, bit for bit, for `load_recording` and for every program that reads tables.

A row is a sample, a column a channel: `case`, `time [s]`, `output tip_position [m]`, ..., `qpos 0`. What holds over the steps has
no value (null) in the last row of its case, and a case has none in columns that only others have. What is no series stands as JSON
in the metadata of the file under `invtrack`, compiled models beside it, each once.
"""

from __future__ import annotations

import base64
import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from invtrack.arrays import Array
from invtrack.errors import RecordingError
from invtrack.recording.header import columns_of, run_header, run_without_values
from invtrack.results.result import RunResult

FORMAT = 4
"""Number of the layout of a recording's two files; a reader refuses numbers that it does not know."""

GROUP = 65_536
"""Samples in a row group: what is copied at a time, in writing and in reading."""

CASE, TIME = "case", "time [s]"

METADATA, DIGEST = "invtrack", "invtrack digest"
"""Keys of the metadata; those of the models begin with the first."""

LARGEST_TEXT = 2**31 - 1
"""Bytes that one text of the metadata may have when it is read: as many as the format can hold, since models can be large."""


def samples_path(path: Path) -> Path:
    """Where the samples of the recording at `path` stand: beside it, under the same name."""
    return path.with_suffix(".parquet")


def write_samples(runs: Sequence[RunResult], path: Path, *, recording: str) -> None:
    """Write all samples of the runs, straight from their arrays, a row group at a time.

    recording: what identifies the recording, by which its two files know each other.
    """
    columns = [columns_of(run) for run in runs]
    names = list(dict.fromkeys(name for case in columns for name in case))
    schema = pa.schema([(CASE, pa.string()), *((name, pa.float64()) for name in names)])
    with pq.ParquetWriter(
        path,
        schema,
        compression="zstd",
        use_dictionary=[CASE],
        use_byte_stream_split=True,
        write_statistics=[CASE, TIME],
        write_page_checksum=True,
        store_schema=False,  # Arrow's own copy, for types that Parquet does not know
    ) as writer:
        writer.add_key_value_metadata(_metadata(runs, recording))
        for run, case in zip(runs, columns, strict=True):
            for first in range(0, run.time.size, GROUP):
                rows = min(GROUP, run.time.size - first)
                absent = pa.nulls(rows, pa.float64())
                arrays = [_part(case[name], first, rows) if name in case else absent for name in names]
                writer.write_table(pa.Table.from_arrays([pa.repeat(run.name, rows), *arrays], schema=schema), row_group_size=GROUP)


def _part(column: Array, first: int, rows: int) -> pa.Array:
    """`rows` values from `first` on, none (null) where the column has ended."""
    values = pa.array(np.ascontiguousarray(column[first : first + rows], dtype=np.float64))
    return values if len(values) == rows else pa.concat_arrays([values, pa.nulls(rows - len(values), pa.float64())])


def _metadata(runs: Sequence[RunResult], recording: str) -> dict[str, str]:
    """What is no series, as texts, for Parquet's metadata are texts; the last one is the digest of the others."""
    models = list(dict.fromkeys(run.mjb for run in runs if run.mjb))
    cases = [{**run_header(run), "mjb": models.index(run.mjb) if run.mjb else None, "mjb_size": len(run.mjb)} for run in runs]
    texts = {METADATA: json.dumps({"format": FORMAT, "recording": recording, "cases": cases})}
    for number, model in enumerate(models):
        texts[f"{METADATA} model {number}"] = base64.b64encode(pa.compress(model, "zstd", asbytes=True)).decode()
    return {**texts, DIGEST: _digest(texts)}


def _digest(texts: Mapping[str, str]) -> str:
    return hashlib.blake2b(json.dumps(texts, sort_keys=True).encode(), digest_size=16).hexdigest()


def read_samples(path: Path, *, recording: str | None = None) -> dict[str, RunResult]:
    """The runs in a file that `write_samples` wrote, by the name of the case, in the order in which they were written.

    recording: what identifies the recording of which they must be, any if it is None.

    Raises RecordingError where the file cannot be read, is damaged, was not written by invtrack, or is of another recording.
    """
    try:
        with pq.ParquetFile(path, page_checksum_verification=True, thrift_string_size_limit=LARGEST_TEXT) as file:
            header = _header(texts := _texts(file), path)
            if recording is not None and header["recording"] != recording:
                raise RecordingError(
                    f"{path} holds the samples of another recording than {path.with_suffix('.rrd').name} beside it; expected the "
                    "two files that one call wrote. Load the .parquet file itself where its runs are wanted"
                )
            groups = iter(range(file.num_row_groups))
            runs = {case["name"]: run_without_values(case, _model(case, texts)) for case in header["cases"]}
            for run in runs.values():
                _fill(run, file, groups, path)
            return runs
    except (pa.ArrowException, OSError, UnicodeDecodeError) as error:
        raise RecordingError(
            f"cannot read the samples in {path}: {error}. It is no Parquet file, or it is damaged or was cut off; expected a file "
            "that save_recording wrote"
        ) from error


def _texts(file: pq.ParquetFile) -> dict[str, str]:
    """The metadata that are ours; other programs may add theirs."""
    found = {key.decode(errors="replace"): text.decode(errors="replace") for key, text in (file.metadata.metadata or {}).items()}
    return {key: text for key, text in found.items() if key.startswith(METADATA)}


def _header(texts: dict[str, str], path: Path) -> dict[str, Any]:
    if METADATA not in texts:
        raise RecordingError(f"{path} is a Parquet file, but not one that save_recording wrote: its metadata have no {METADATA!r}")
    if _digest({key: text for key, text in texts.items() if key != DIGEST}) != texts.get(DIGEST):
        raise RecordingError(f"the metadata of {path} do not have the digest that was written with them: the file is damaged")
    header: dict[str, Any] = json.loads(texts[METADATA])
    require_format(header["format"], path)
    return header


def require_format(found: int, path: Path) -> None:
    """Raises RecordingError for the number of a layout that this version does not know."""
    if found != FORMAT:
        raise RecordingError(f"{path} has format {found}, this version reads {FORMAT}; use the version that wrote it")


def _model(case: dict[str, Any], texts: dict[str, str]) -> bytes:
    if case["mjb"] is None:
        return b""
    packed = base64.b64decode(texts[f"{METADATA} model {case['mjb']}"])
    model: bytes = pa.decompress(packed, case["mjb_size"], "zstd", asbytes=True)
    return model


def _fill(run: RunResult, file: pq.ParquetFile, groups: Iterator[int], path: Path) -> None:
    """Read the samples of a run from the next row groups into its arrays."""
    columns = columns_of(run)
    missing = sorted({CASE, *columns} - set(file.schema_arrow.names))
    if missing:
        raise RecordingError(f"{path} has no column {', '.join(map(repr, missing))}: the file was edited or is damaged")
    done = 0
    while done < run.time.size:
        group = next(groups, None)
        table = None if group is None else file.read_row_group(group, columns=[CASE, *columns])
        cases = [] if table is None else table.column(CASE).unique().to_pylist()
        if table is None or cases != [run.name] or done + table.num_rows > run.time.size:
            raise RecordingError(
                f"expected {run.time.size} samples of case {run.name!r} in {path}, found {done} and then those of {cases}: the "
                "file was edited"
            )
        for name, values in columns.items():
            part = values[done : done + table.num_rows]
            stored = table.column(name).slice(0, len(part))
            if stored.null_count:
                raise RecordingError(f"column {name!r} of case {run.name!r} in {path} lacks values: the file was edited")
            part[:] = stored.to_numpy()
        done += table.num_rows
