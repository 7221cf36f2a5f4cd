"""Recordings of runs in Rerun's files: written for people to look at, read back bit for bit."""

from __future__ import annotations

import hashlib
import json
import uuid
import warnings
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk, RrdReader
from rerun.error_utils import RerunWarning

from invtrack.arguments import file_path, require_text
from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.errors import RecordingError
from invtrack.files import replaced_when_complete
from invtrack.recording.blueprint import make_blueprint
from invtrack.recording.numbers import send_numbers
from invtrack.recording.scene import Scene, make_scene, send_scene
from invtrack.recording.series import (
    ARCHETYPE,
    FORMAT,
    HELD,
    SAMPLED,
    SHARED_ROOT,
    STEP,
    channels_by_unit,
    entity_path,
    send_series,
    time_columns,
    unit_path,
)
from invtrack.results.result import Event, RunResult, Signal

METADATA, MJB, QPOS, SCALARS = f"{ARCHETYPE}:metadata", f"{ARCHETYPE}:mjb", f"{ARCHETYPE}:qpos", "Scalars:scalars"


def save_recording(results: RunResult | Sequence[RunResult], path: str | Path, *, application: str = "") -> Path:
    """Write one Rerun recording (.rrd) with one or several cases and return its path.

    Every array is kept in float64, so that `load_recording(path)[case].equals(result)` holds bit for bit. Beside them stand what
    people look at: the 3-D scene of each case that has a MuJoCo model (float32, about 60 frames per second of simulated time), the
    tracking error, the events, and a layout of views. Open it with `rerun <path>`.

    application: name that recordings of one case each share, such as the cases of a study. Opened together, `rerun <folder>/*.rrd`,
    they then show in one layout, in which every case has the same place. The file appears under its name only once it is
    complete; missing folders above it are made.

    Raises RecordingError where there is no case, an application is given for several cases, two cases share a name, the arrays of a
    case or its model and positions do not fit together, the path does not end in .rrd, or the file cannot be written.
    """
    runs = list(results) if isinstance(results, Sequence) else [results]
    strange = [type(run).__name__ for run in runs if not isinstance(run, RunResult)]
    if strange:
        raise RecordingError(f"expected results of runs, as invtrack.simulate returns them, got {', '.join(strange)}")
    require_text("application", application, error=RecordingError)
    _check(runs, application)
    target = file_path(path)
    if target.suffix != ".rrd":
        raise RecordingError(f"expected a path that ends in .rrd, by which the Rerun viewer knows recordings; got {target}")
    scenes = [make_scene(run) for run in runs]
    with replaced_when_complete(target) as draft:
        target.parent.mkdir(parents=True, exist_ok=True)
        draft.touch()  # Rerun opens the file in the background, so find out here whether it can be written
        _write(runs, scenes, draft, title=target.stem, application=application)
    return target


def _write(runs: list[RunResult], scenes: list[Scene | None], path: Path, *, title: str, application: str) -> None:
    recording = rr.RecordingStream(f"invtrack {application}" if application else _application_id(runs), recording_id=uuid.uuid4())
    shown = [replace(run, name=SHARED_ROOT) for run in runs] if application else runs
    try:
        recording.save(path, default_blueprint=make_blueprint(shown, scenes, shared=bool(application)))
        recording.send_recording_name(title)
        for number, (run, placed, scene) in enumerate(zip(runs, shown, scenes, strict=True)):
            prefix = f"{run.name}: " if len(runs) > 1 else ""
            _send_run(recording, placed, number, name=run.name)
            send_series(recording, placed, number=number, prefix=prefix)
            send_numbers(recording, placed, name=run.name)
            if scene is not None:
                send_scene(recording, placed, scene)
    finally:
        recording.disconnect()  # writes the footer
    try:
        RrdReader(path).store()
    except (ValueError, RuntimeError) as error:
        raise OSError(f"the file is incomplete ({error}), perhaps for lack of space") from error


def _application_id(runs: list[RunResult]) -> str:
    """The viewer keeps one layout per application id; recordings with other cases or channels need another layout."""
    labels = [
        [run.name, *((getattr(run, name).channels.names, getattr(run, name).channels.units) for name in SAMPLED + HELD)]
        for run in runs
    ]
    digest = hashlib.blake2b(json.dumps(labels).encode(), digest_size=4).hexdigest()
    return f"invtrack {runs[0].model} {digest}"


def _send_run(recording: rr.RecordingStream, run: RunResult, number: int, *, name: str) -> None:
    """Send what is no time series, and the generalized positions; name: of the case, which stands under `run.name`."""
    components: dict[str, Any] = {"metadata": json.dumps({**metadata(run, number), "name": name, "root": run.name})}
    if run.mjb:
        components["mjb"] = np.frombuffer(run.mjb, dtype=np.uint8)
    recording.log(entity_path(run.name, "run"), rr.DynamicArchetype(ARCHETYPE, components=components), static=True, strict=True)
    if run.qpos.size:
        rows, width = run.qpos.shape
        columns = rr.DynamicArchetype.columns(ARCHETYPE, components={"qpos": np.ascontiguousarray(run.qpos).ravel()})
        rr.send_columns(
            entity_path(run.name, "qpos"),
            time_columns(np.arange(rows), run.time[:rows]),
            columns.partition(np.full(rows, width)),
            recording=recording,
            strict=True,
        )


def metadata(run: RunResult, number: int) -> dict[str, Any]:
    """Everything of a run but its arrays, for JSON: floats survive it exactly, NaN included."""
    return {
        "format": FORMAT,
        "number": number,
        "name": run.name,
        "model": run.model,
        "manoeuvre": [float(time) for time in run.manoeuvre],
        "rest_inputs": run.rest_inputs.tolist(),
        "timestep": float(run.timestep),
        "evaluate": run.evaluate,
        "integrator": run.integrator,
        "vibration_period": float(run.vibration_period),
        "events": [[float(event.time), event.kind, event.text, event.until] for event in run.events],
        "remarks": list(run.remarks),
        "parameter_bodies": dict(run.parameter_bodies),
        "status": run.status,
        "message": run.message,
        "qpos_shape": run.qpos.shape,
        "samples": run.time.size,
        "signals": {
            name: {"rows": signal.values.shape[0], "names": signal.channels.names, "units": signal.channels.units}
            for name, signal in ((name, getattr(run, name)) for name in SAMPLED + HELD)
        },
    }


def _check(runs: list[RunResult], application: str) -> None:
    names = [run.name for run in runs]
    if application and len(runs) != 1:
        raise RecordingError(f"expected one case for a recording that shares its layout with others, got {len(runs)}: {names}")
    if not runs:
        raise RecordingError("expected at least one run to record, got none")
    if len(set(names)) != len(names) or "" in names:
        raise RecordingError(f"expected cases with distinct, non-empty names, got {names}; rename them with dataclasses.replace")
    for run in runs:
        if run.time.size == 0:
            raise RecordingError(f"case {run.name!r} has no samples to record")
        limits = {**dict.fromkeys(SAMPLED, run.time.size), **dict.fromkeys(HELD, run.time.size - 1)}
        for name, rows in limits.items():
            optional = name in ("measured", "estimate") and not getattr(run, name).channels.names
            if getattr(run, name).values.shape[0] != rows and not optional:
                raise RecordingError(
                    f"case {run.name!r} has {run.time.size} times, so {name} needs {rows} rows; it has "
                    f"{getattr(run, name).values.shape[0]}"
                )
        if run.qpos.size and run.qpos.shape[0] != run.time.size:
            raise RecordingError(f"case {run.name!r} has {run.time.size} times but {run.qpos.shape[0]} rows of qpos")


def load_recording(path: str | Path) -> dict[str, RunResult]:
    """Read the runs of a recording that `save_recording` wrote, by case name and in the order in which they were saved.

    Each run equals the saved one bit for bit (`RunResult.equals`).

    Raises RecordingError where the file cannot be read, is no Rerun recording, was not written by invtrack, or lacks data.
    """
    chunks = _chunks(file_path(path))
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
        labelled = Channels(stored["names"], stored["units"])
        result = Signal(np.empty((stored["rows"], len(labelled))), labelled)
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
        rest_inputs=np.array(header["rest_inputs"], dtype=float),
        timestep=header["timestep"],
        evaluate=header["evaluate"],
        integrator=header["integrator"],
        vibration_period=header["vibration_period"],
        events=tuple(Event(time, kind, text, until) for time, kind, text, until in header["events"]),
        remarks=tuple(header["remarks"]),
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
