"""Recordings of runs: a Rerun file for people to look at, a Parquet file beside it with every sample, read back bit for bit."""

from __future__ import annotations

import hashlib
import json
import uuid
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import rerun as rr
from rerun.chunk import RrdReader
from rerun.error_utils import RerunWarning

from invtrack.arguments import file_path, flag, require_text
from invtrack.errors import RecordingError
from invtrack.files import replaced_when_complete
from invtrack.recording.blueprint import make_blueprint, scene_aspect
from invtrack.recording.camera import Camera, camera_of
from invtrack.recording.components import component_names
from invtrack.recording.followed import send_followed
from invtrack.recording.header import HELD, SAMPLED
from invtrack.recording.numbers import send_numbers
from invtrack.recording.samples import FORMAT, read_samples, require_format, samples_path, write_samples
from invtrack.recording.scene import Scene, make_scene, send_scene
from invtrack.recording.series import Legend, send_series
from invtrack.recording.stream import Stream
from invtrack.recording.thinning import thinning
from invtrack.results.interval import shown_interval
from invtrack.results.result import RunResult

SHARED_ROOT = "case"
"""What a recording's only case stands under where recordings of several cases share one layout."""

PROPERTY = "invtrack"
"""Property of a Rerun recording that says which samples belong to it."""


def save_recording(
    results: RunResult | Sequence[RunResult],
    path: str | Path,
    *,
    application: str = "",
    every_sample: bool = False,
    camera: str | None = None,
) -> Path:
    """Write a recording with one or several cases, a Rerun file and a Parquet file, and return the path of the former.

    NAME.rrd, at `path`, holds what people look at: the 3-D scene of each case that has a MuJoCo model (float32, about 60 frames
    per second of simulated time where the plots open, 20 elsewhere), the series and the tracking error, thinned so that no
    peak is lost, the events, and a layout of views. Open it with `rerun <path>`. NAME.parquet beside it holds every sample in
    float64, in a row each, and all that the runs hold besides: `load_recording(path)[case].equals(result)` holds bit for bit.

    Thinned: a series shows the first sample of each bucket, and the least and the largest where they lie beyond that and the first
    of the next bucket. 2000 buckets fill the interval with which the plots open, 1000 the manoeuvre, 20 a period of the slowest
    vibration, or more. Around events, jumps of parameters, gaps and the run's ends 10 samples on either side are all there.

    The scene is looked at by the first camera of the model that is fixed to the world, else from where the motion of what outputs
    follow is seen best, from left to right; several cases stand side by side, looked at from the same place. Intervals of more than
    12 s are played faster. Both files appear under their names only once they are complete, the Rerun file last; missing folders
    above them are made.

    Args:
        results: the runs, one or several.
        path: of the Rerun file, which ends in .rrd.
        application: name that recordings of one case each share, such as the cases of a study. Opened together,
            `rerun <folder>/*.rrd`, they then show in one layout, in which every case has the same place.
        every_sample: show every sample in the Rerun file, which then takes several times the space of the Parquet file.
        camera: name of a camera of the model to look with; one that moves is where it is when the motion begins.

    Raises RecordingError where there is no case, an application is given for several cases, two cases share a name, the arrays of a
    case or its model and positions do not fit together, no camera has the name, or the path does not end in .rrd; FileError where a
    file cannot be written.
    """
    runs = list(results) if isinstance(results, Sequence) else [results]
    strange = [type(run).__name__ for run in runs if not isinstance(run, RunResult)]
    if strange:
        raise RecordingError(f"expected results of runs, as invtrack.simulate returns them, got {', '.join(strange)}")
    require_text("application", application, error=RecordingError)
    flag("every_sample", every_sample, error=RecordingError)
    _check(runs, application)
    target = file_path(path)
    if target.suffix != ".rrd":
        raise RecordingError(f"expected a path that ends in .rrd, by which the Rerun viewer knows recordings; got {target}")
    interval = shown_interval(runs)
    if camera is not None:
        require_text("camera", camera, error=RecordingError)
    scenes = [make_scene(run, interval) for run in runs]
    looked_at = camera_of(runs, scenes, interval, camera, aspect=scene_aspect(len(runs)))
    identity = str(uuid.uuid4())
    with (
        replaced_when_complete(target) as shown,
        replaced_when_complete(samples_path(target)) as samples,
        ThreadPoolExecutor(1) as other_core,  # Arrow encodes without the interpreter's lock
    ):
        target.parent.mkdir(parents=True, exist_ok=True)
        shown.touch()  # Rerun opens the file in the background, so find out here whether it can be written
        writing = other_core.submit(write_samples, runs, samples, recording=identity)
        _write_shown(
            runs,
            scenes,
            shown,
            interval=interval,
            camera=looked_at,
            title=target.stem,
            application=application,
            every_sample=every_sample,
            identity=identity,
        )
        writing.result()
    return target


def _write_shown(
    runs: list[RunResult],
    scenes: list[Scene | None],
    path: Path,
    *,
    interval: tuple[float, float],
    camera: Camera | None,
    title: str,
    application: str,
    every_sample: bool,
    identity: str,
) -> None:
    """Write what people look at.

    Args:
        runs, scenes: the cases.
        path: of the file.
        interval: with which the plots open [s].
        camera: from where the scenes are looked at.
        title: name of the recording in the viewer.
        application, every_sample: as in `save_recording`.
        identity: what the recording and its samples know each other by.
    """
    stream = rr.RecordingStream(f"invtrack {application}" if application else _application_id(runs), recording_id=identity)
    placed = [replace(run, name=SHARED_ROOT) for run in runs] if application else runs
    try:
        stream.save(path, default_blueprint=make_blueprint(placed, scenes, interval, camera, shared=bool(application)))
        stream.send_recording_name(title)
        stream.send_property(PROPERTY, rr.DynamicArchetype(PROPERTY, components={"format": FORMAT, "recording": identity}))
        rows = Stream(stream, interval[0])
        for number, (run, at, scene) in enumerate(zip(runs, placed, scenes, strict=True)):
            prefix = f"{run.name}: " if len(runs) > 1 else ""
            legend = Legend(number, prefix, {} if scene is None else component_names(scene.model))
            send_series(rows, at, thinning(run, interval, every_sample=every_sample), legend)
            send_numbers(stream, at, name=run.name)
            if scene is not None:
                send_scene(rows, at, scene)
                send_followed(rows, at, scene)
    finally:
        stream.disconnect()  # writes the footer
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

    path: of the Rerun file (.rrd), whose samples are read from the Parquet file beside it, or of the Parquet file itself. Each run
    equals the saved one bit for bit (`RunResult.equals`).

    Raises RecordingError where a file cannot be read, is damaged or was not written by invtrack, and where the Parquet file is
    missing or belongs to another recording.
    """
    source = file_path(path)
    if source.suffix not in (".rrd", ".parquet"):
        raise RecordingError(f"expected the path of a recording, which ends in .rrd or .parquet, got {source}")
    if not source.is_file():
        raise RecordingError(f"there is no recording {source}; expected a file that save_recording wrote")
    if source.suffix == ".parquet":
        return read_samples(source)
    identity, samples = _identity(source), samples_path(source)
    if not samples.is_file():
        raise RecordingError(
            f"{source} is for the viewer; the samples of its runs stand in {samples.name}, which is not beside it. Keep the two "
            "files of a recording together, under one name"
        )
    return read_samples(samples, recording=identity)


def _identity(path: Path) -> str:
    """What the Rerun file says that its samples are known by."""
    try:
        with warnings.catch_warnings():  # a recording that was cut off is reported by the error that follows
            warnings.simplefilter("ignore", RerunWarning)
            chunks = RrdReader(path).store().stream().filter(content=f"/__properties/{PROPERTY}").to_chunks()
    except (ValueError, RuntimeError, OSError) as error:
        raise RecordingError(f"cannot read {path} as a Rerun recording: {error}") from error
    fields = {field: batch.column(field) for batch in (c.to_record_batch() for c in chunks) for field in batch.schema.names}
    found, identity = (fields.get(f"{PROPERTY}:{name}") for name in ("format", "recording"))
    if found is None or identity is None:
        raise RecordingError(
            f"{path} is a Rerun recording, but not one that this version of invtrack wrote: it has no property {PROPERTY!r}"
        )
    require_format(found.flatten()[0].as_py(), path)
    return str(identity.flatten()[0].as_py())
