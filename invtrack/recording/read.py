"""Read runs back from a Rerun recording."""

from __future__ import annotations

import json
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from invtrack.errors import RecordingError
from invtrack.recording.layout import ARCHETYPE, FORMAT, HELD, SAMPLED, STEP, channels_by_unit, entity_path, unit_path
from invtrack.results.result import Array, Event, RunResult, Signal

METADATA, MJB, QPOS, SCALARS = f"{ARCHETYPE}:metadata", f"{ARCHETYPE}:mjb", f"{ARCHETYPE}:qpos", "Scalars:scalars"


def load_recording(path: str | Path) -> dict[str, RunResult]:
    """Read the runs of a recording that `save_recording` wrote, by case name and in the order in which they were saved.

    Each run equals the saved one bit for bit (`RunResult.equals`).

    Raises RecordingError where the file cannot be read, is no Rerun recording, was not written by invtrack, or lacks data.
    """
    chunks = _chunks(Path(path))
    headers = [json.loads(_cell(chunk, METADATA)[0]) for group in chunks.values() for chunk in group if METADATA in _fields(chunk)]
    if not headers:
        raise RecordingError(f"{path} is a Rerun recording, but not one that invtrack wrote: no entity has {METADATA}")
    unknown = {header.get("format") for header in headers} - {FORMAT}
    if unknown:
        raise RecordingError(
            f"{path} has format {', '.join(map(str, unknown))}, this version reads {FORMAT}; use the version that wrote it"
        )
    return {header["name"]: _run(header, chunks, path) for header in sorted(headers, key=lambda header: int(header["number"]))}


def _chunks(path: Path) -> dict[str, list[Chunk]]:
    """All chunks of the first recording in the file, by entity path."""
    if not path.is_file():
        raise RecordingError(f"there is no recording {path}; expected an .rrd file that save_recording wrote")
    chunks: dict[str, list[Chunk]] = defaultdict(list)
    try:
        with warnings.catch_warnings():  # a recording that was cut off is reported by the error that follows
            warnings.simplefilter("ignore", RerunWarning)
            reader = RrdReader(path)
        for chunk in reader.stream():
            chunks[chunk.entity_path].append(chunk)
    except (ValueError, RuntimeError, OSError) as error:
        raise RecordingError(f"cannot read {path} as a Rerun recording: {error}") from error
    return chunks


def _run(header: dict[str, Any], chunks: dict[str, list[Chunk]], source: str | Path) -> RunResult:
    case = header["root"]

    def rows(path: str, shape: tuple[int, int], field: str = SCALARS) -> Array:
        return _matrix(chunks.get(path, []), field, shape, f"{path} in {source}")

    def signal(name: str) -> Signal:
        stored = header["signals"][name]
        names, units = tuple(stored["names"]), tuple(stored["units"])
        result = Signal(np.empty((stored["rows"], len(names))), names, units)
        for unit, channels in channels_by_unit(result).items():
            result.values[:, channels] = rows(unit_path(case, name, unit), (stored["rows"], len(channels)))
        return result

    models = [chunk for chunk in chunks[entity_path(case, "run")] if MJB in _fields(chunk)]
    return RunResult(
        name=header["name"],
        model=header["model"],
        time=rows(entity_path(case, "time"), (header["samples"], 1))[:, 0],
        **{name: signal(name) for name in SAMPLED + HELD},
        manoeuvre=(header["manoeuvre"][0], header["manoeuvre"][1]),
        timestep=header["timestep"],
        evaluate=header["evaluate"],
        integrator=header["integrator"],
        vibration_period=header["vibration_period"],
        events=tuple(Event(time, kind, text) for time, kind, text in header["events"]),
        parameter_bodies=header["parameter_bodies"],
        qpos=rows(entity_path(case, "qpos"), tuple(header["qpos_shape"]), QPOS),
        status=header["status"],
        message=header["message"],
        mjb=_cell(models[0], MJB).astype(np.uint8).tobytes() if models else b"",
    )


def _matrix(chunks: list[Chunk], field: str, shape: tuple[int, int], what: str) -> Array:
    """The rows of an entity in order of their step, whatever chunks they have been split into."""
    rows, width = shape
    if rows == 0 or width == 0:
        return np.zeros(shape)
    batches = [chunk.to_record_batch() for chunk in chunks if field in _fields(chunk)]
    blocks = [batch.column(field).flatten().to_numpy(zero_copy_only=False) for batch in batches]
    if sum(block.size for block in blocks) != rows * width:
        found = sum(block.size for block in blocks)
        raise RecordingError(f"expected {rows} x {width} numbers at {what}, found {found}: the recording is damaged or was edited")
    values = np.concatenate(blocks).astype(np.float64, copy=False).reshape(rows, width)
    steps = np.concatenate([batch.column(STEP).to_numpy(zero_copy_only=False) for batch in batches])
    return np.array(values if np.array_equal(steps, np.arange(rows)) else values[np.argsort(steps, kind="stable")])


def _cell(chunk: Chunk, field: str) -> NDArray[Any]:
    """The one value of a static component, as an array of its instances."""
    return np.asarray(chunk.to_record_batch().column(field).flatten().to_numpy(zero_copy_only=False))


def _fields(chunk: Chunk) -> list[str]:
    return list(chunk.to_record_batch().schema.names)
