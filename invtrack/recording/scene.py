"""The moving mechanism in 3-D: geoms, spatial tendons, and bodies that change with a parameter.

A body whose mass is a parameter has the size and shade that follow the mass; a label beside each such body states the value.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.errors import RecordingError
from invtrack.recording.series import entity_path
from invtrack.recording.shapes import (
    body_name,
    colored_shape,
    colored_site,
    geom_name,
    geom_rgba,
    geom_shape,
    geom_transform,
    site_name,
    tendon_name,
    tendon_rgba,
    visible_geoms,
    visible_sites,
)
from invtrack.recording.stream import Stream
from invtrack.recording.tendons import TendonPath, Wrapping, is_path, send_tendon, tendon_path
from invtrack.results.result import RunResult

FRAME_RATE = 60.0
"""Frames per second of simulated time in the interval with which the plots open."""

FRAME_RATE_ELSEWHERE = 20.0
"""Frames per second of simulated time before and after it."""

FEWEST_FRAMES = 300
"""Frames of a run that is too short for this many at these rates, if it has as many samples."""

BLOCK = 1000
"""Frames of which MuJoCo's whole arrays of tendons' points are kept at a time."""

SMALLEST = 0.3
"""Size at mass zero relative to the size at the run's largest mass: still to be seen."""

PALENESS = 0.6
"""Share of white in the colour of a body without mass; none is left at the run's largest mass."""

LABEL_COLOR = (250, 250, 250, 255)


@dataclass(frozen=True)
class Scene:
    """World poses of a mechanism over the frames that are drawn.

    Args:
        model: the mechanism.
        frames: numbers of the samples that are drawn (F,).
        positions: of the bodies (F, bodies, 3) [m].
        quaternions: of the bodies (F, bodies, 4), x y z w as Rerun wants them.
        tendons: the paths of the spatial tendons that are to be seen, by their number.
    """

    model: mujoco.MjModel
    frames: NDArray[np.int64]
    positions: Array
    quaternions: Array
    tendons: dict[int, TendonPath]


def make_scene(result: RunResult, interval: tuple[float, float]) -> Scene | None:
    """The scene of a run, None where it has no MuJoCo model or no positions.

    interval: with which the plots open [s], where the frames follow one another at their full rate.

    Raises RecordingError where the model cannot be loaded or does not fit the positions.
    """
    if not result.mjb or not result.qpos.size:
        return None
    model = _load(result)
    frames = frame_samples(result, interval)
    if not frames.size:
        return None
    shown = [tendon for tendon in range(model.ntendon) if is_path(model, tendon) and tendon_rgba(model, tendon)[3] > 0]
    positions, quaternions = np.empty((frames.size, model.nbody, 3)), np.empty((frames.size, model.nbody, 4))
    pieces: dict[int, list[TendonPath]] = {tendon: [] for tendon in shown}
    for first in range(0, frames.size, BLOCK):
        block = slice(first, first + BLOCK)
        with np.errstate(over="ignore"):  # of a run that diverges
            wrapping = _play(model, result.qpos[frames[block]], positions[block], quaternions[block], tendons=bool(shown))
        for tendon in shown:
            pieces[tendon].append(tendon_path(wrapping, tendon))
    tendons = {tendon: TendonPath.joined(parts) for tendon, parts in pieces.items()}
    return Scene(model, frames, positions, quaternions[..., [1, 2, 3, 0]], tendons)


def _play(model: mujoco.MjModel, qpos: Array, positions: Array, quaternions: Array, *, tendons: bool) -> Wrapping:
    """Write the bodies' poses at the positions `qpos` (F, nq) into two arrays; return where the tendons run, if asked for."""
    data = mujoco.MjData(model)
    wrapping = Wrapping.empty(len(qpos) if tendons else 0, data)
    live, here = Wrapping.of(data), data.qpos  # views, which MuJoCo keeps up to date
    xpos, xquat = data.xpos, data.xquat
    for frame in range(len(qpos)):
        here[:] = qpos[frame]
        mujoco.mj_kinematics(model, data)
        positions[frame], quaternions[frame] = xpos, xquat
        if tendons:
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
            wrapping.firsts[frame], wrapping.counts[frame] = live.firsts, live.counts
            wrapping.points[frame], wrapping.objects[frame] = live.points, live.objects
    return wrapping


def frame_samples(result: RunResult, interval: tuple[float, float]) -> NDArray[np.int64]:
    """Numbers of the samples that are drawn, at the rates above, and none with positions that are not finite."""
    time = result.time
    begin, end = np.clip(interval, time[0], time[-1])
    parts = ((time[0], begin, FRAME_RATE_ELSEWHERE), (begin, end, FRAME_RATE), (end, time[-1], FRAME_RATE_ELSEWHERE))
    counts = [min(int((last - first) * rate), time.size) + 1 for first, last, rate in parts]
    grids = [np.linspace(first, last, count) for (first, last, _), count in zip(parts, counts, strict=True)]
    if sum(counts) < FEWEST_FRAMES:
        grids = [np.linspace(time[0], time[-1], FEWEST_FRAMES + 1)]
    frames = np.unique(np.clip(np.searchsorted(time, np.concatenate(grids)), 0, time.size - 1))
    return np.asarray(frames[np.all(np.isfinite(result.qpos[frames]), axis=1)], dtype=np.int64)


def send_scene(stream: Stream, result: RunResult, scene: Scene) -> None:
    """Send the scene: shapes once, poses over time; bodies whose mass is a parameter change with it."""
    root, model = (result.name, "scene"), scene.model
    stream.log(entity_path(*root), rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    times = result.time[scene.frames]
    sizes = _size_factors(result, model)
    for body in range(model.nbody):
        name = body_name(model, body)
        path, geoms, sites = (*root, "bodies", name), visible_geoms(model, body), visible_sites(model, body)
        if geoms or sites or name in result.parameter_bodies.values():
            _send_pose(stream, entity_path(*path), times, scene, body)
        for geom in geoms:
            geom_path = entity_path(*path, geom_name(model, geom))
            if body in sizes:
                _send_sized_geom(stream, geom_path, result, model, geom, sizes[body])
            else:
                stream.log(geom_path, colored_shape(model, geom), geom_transform(model, geom))
        for site in sites:
            stream.log(entity_path(*path, "sites", site_name(model, site)), *colored_site(model, site))
    _send_labels(stream, result, model, root)
    for tendon in scene.tendons:
        at = entity_path(*root, "tendons", tendon_name(model, tendon))
        send_tendon(stream, at, scene.frames, times, (model, tendon), scene.tendons[tendon])


def _send_pose(stream: Stream, path: str, times: Array, scene: Scene, body: int) -> None:
    if scene.model.body_weldid[body] == 0:  # fixed to the world
        pose = rr.Transform3D(translation=scene.positions[0, body], quaternion=scene.quaternions[0, body])
        stream.log(path, pose)
        return
    columns = rr.Transform3D.columns(translation=scene.positions[:, body], quaternion=scene.quaternions[:, body])
    stream.send(path, scene.frames, times, columns, held=True)


def _load(result: RunResult) -> mujoco.MjModel:
    try:
        model = mujoco.MjModel.from_binary_path("model.mjb", {"model.mjb": result.mjb})
    except ValueError as error:
        raise RecordingError(
            f"case {result.name!r} carries a compiled model that MuJoCo {mujoco.__version__} cannot load ({error}); compile it "
            "with this version, or record the case without it: dataclasses.replace(result, mjb=b'')"
        ) from error
    if model.nq != result.qpos.shape[1]:
        raise RecordingError(f"case {result.name!r} has {result.qpos.shape[1]} positions per sample, its model has {model.nq}")
    return model


@dataclass(frozen=True)
class _SizeChanges:
    """Sizes of a body relative to its geoms in the model: `factors` (K,), each from the sample in `samples` (K,) on."""

    samples: NDArray[np.int64]
    factors: Array


def _size_factors(result: RunResult, model: mujoco.MjModel) -> dict[int, _SizeChanges]:
    """For each body whose mass is a parameter (unit kg): size (m / m_max)^(1/3), m_max the largest mass in the run.

    Raises RecordingError where result.parameter_bodies names a parameter or a body that does not exist.
    """
    sizes: dict[int, _SizeChanges] = {}
    for parameter, name in result.parameter_bodies.items():
        body, column = _parameter_of(result, model, parameter, name)
        if result.parameters.channels.units[column] != "kg" or body in sizes:
            continue
        masses = np.maximum(result.parameters.values[:, column], 0.0)
        samples = _changes(result.parameters.values[:, column])
        largest = float(np.max(masses, initial=0.0))
        relative = masses[samples] / largest if largest > 0 else np.zeros(samples.size)
        sizes[body] = _SizeChanges(samples, np.maximum(np.cbrt(relative), SMALLEST))
    return sizes


def _changes(values: Array) -> NDArray[np.int64]:
    """Numbers of the steps at which a held value is new, the first included."""
    return np.flatnonzero(np.concatenate([[True], values[1:] != values[:-1]])[: values.size])


def _send_sized_geom(stream: Stream, path: str, result: RunResult, model: mujoco.MjModel, geom: int, size: _SizeChanges) -> None:
    """Send a geom whose scale and colour change at some samples: its shape once, the changes over time."""
    shape, rgba = geom_shape(model, geom), geom_rgba(model, geom)
    stream.log(path, shape.archetype(**shape.fields))
    count = size.samples.size
    white = PALENESS * (1 - size.factors[:, np.newaxis])
    colors = np.column_stack([(1 - white) * rgba[:3] + white, np.full(count, rgba[3])])
    transforms = rr.Transform3D.columns(
        translation=np.tile(model.geom_pos[geom], (count, 1)),
        quaternion=np.tile(model.geom_quat[geom, [1, 2, 3, 0]], (count, 1)),
        scale=np.tile(size.factors[:, np.newaxis], (1, 3)),
    )
    changes = [*transforms, *shape.color_columns(colors)]
    stream.send(path, size.samples, result.time[size.samples], changes, held=True)


def _send_labels(stream: Stream, result: RunResult, model: mujoco.MjModel, root: tuple[str, ...]) -> None:
    """Send the value of each parameter that belongs to a body as a text beside that body."""
    for number, (parameter, name) in enumerate(result.parameter_bodies.items()):
        body, column = _parameter_of(result, model, parameter, name)
        reach = max((float(model.geom_rbound[geom]) for geom in visible_geoms(model, body)), default=0.0)
        place = [0.0, 0.0, -(1.5 + number) * (reach or 0.05 * model.stat.extent)]
        path = entity_path(*root, "bodies", name, f"{parameter}_label")
        dot = rr.Points3D([place], radii=[1e-3 * reach], colors=[LABEL_COLOR], show_labels=True)
        stream.log(path, dot)
        values, unit = result.parameters.values[:, column], result.parameters.channels.units[column]
        samples = _changes(values)
        labels = rr.Points3D.columns(labels=[f"{parameter} = {value:.6g} {unit}" for value in values[samples]])
        stream.send(path, samples, result.time[samples], labels, held=True)


def _parameter_of(result: RunResult, model: mujoco.MjModel, parameter: str, body: str) -> tuple[int, int]:
    """Number of the body, and column of the parameter."""
    if parameter not in result.parameters.channels.names:
        known = ", ".join(result.parameters.channels.names)
        raise RecordingError(f"case {result.name!r} has no parameter {parameter!r}; there are: {known}")
    bodies = [body_name(model, number) for number in range(model.nbody)]
    if body not in bodies:
        raise RecordingError(
            f"no body {body!r}, to which parameter {parameter!r} belongs, in the model; it has: {', '.join(bodies)}"
        )
    return bodies.index(body), result.parameters.channels.index(parameter)
