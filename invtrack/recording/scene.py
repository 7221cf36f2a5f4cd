"""The moving mechanism in 3-D: geoms, spatial tendons, and bodies that change with a parameter."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray

from invtrack.errors import RecordingError
from invtrack.recording.layout import entity_path, time_columns
from invtrack.recording.payload import send_labels, send_sized_geom, size_factors
from invtrack.recording.shapes import (
    body_name,
    colored_shape,
    geom_name,
    geom_transform,
    tendon_name,
    tendon_rgba,
    to_bytes,
    visible_geoms,
)
from invtrack.results.result import Array, RunResult

FRAME_RATE = 60.0
"""Frames per second of simulated time."""

FEWEST_FRAMES = 300
"""Frames of a run that is too short for this many at FRAME_RATE, if it has as many samples."""

PULLEY = -2
"""What MuJoCo writes into wrap_obj where a tendon's path is interrupted."""


@dataclass(frozen=True)
class Scene:
    """World poses of a mechanism over the frames that are drawn.

    frames: (F,) numbers of the samples. positions: (F, bodies, 3) [m]. quaternions: (F, bodies, 4), x y z w as Rerun wants them.
    tendons: per spatial tendon that is to be seen its line strips at each frame.
    """

    model: mujoco.MjModel
    frames: NDArray[np.int64]
    positions: Array
    quaternions: Array
    tendons: dict[int, list[list[Array]]]


def make_scene(result: RunResult) -> Scene | None:
    """The scene of a run, None where it has no MuJoCo model or no positions.

    Raises RecordingError where the model cannot be loaded or does not fit the positions.
    """
    if not result.mjb or not result.qpos.size:
        return None
    model = _load(result)
    frames = frame_samples(result)
    if not frames.size:
        return None
    data = mujoco.MjData(model)
    shown = [tendon for tendon in range(model.ntendon) if tendon_rgba(model, tendon)[3] > 0]
    positions, quaternions = np.empty((frames.size, model.nbody, 3)), np.empty((frames.size, model.nbody, 4))
    tendons: dict[int, list[list[Array]]] = {tendon: [] for tendon in shown}
    for frame, sample in enumerate(frames):
        data.qpos[:] = result.qpos[sample]
        mujoco.mj_kinematics(model, data)
        positions[frame], quaternions[frame] = data.xpos, data.xquat[:, [1, 2, 3, 0]]
        if shown:
            mujoco.mj_comPos(model, data)
            mujoco.mj_tendon(model, data)
        for tendon in shown:
            tendons[tendon].append(_strips(data, tendon))
    spatial = {tendon: strips for tendon, strips in tendons.items() if any(strips)}
    return Scene(model, frames, positions, quaternions, spatial)


def frame_samples(result: RunResult) -> NDArray[np.int64]:
    """Numbers of the samples that are drawn: about FRAME_RATE per second, and none with positions that are not finite."""
    time = result.time
    duration = time[-1] - time[0]
    wanted = int(max(duration * FRAME_RATE, FEWEST_FRAMES)) + 1
    frames = np.unique(np.clip(np.searchsorted(time, np.linspace(time[0], time[-1], wanted)), 0, time.size - 1))
    return np.asarray(frames[np.all(np.isfinite(result.qpos[frames]), axis=1)], dtype=np.int64)


def send_scene(recording: rr.RecordingStream, result: RunResult, scene: Scene) -> None:
    """Send the scene: shapes once, poses over time; bodies whose mass is a parameter change with it."""
    root, model = (result.name, "scene"), scene.model
    recording.log(entity_path(*root), rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True, strict=True)
    indexes = time_columns(scene.frames, result.time[scene.frames])
    sizes = size_factors(result, model)
    for body in range(model.nbody):
        name = body_name(model, body)
        path, geoms = (*root, "bodies", name), visible_geoms(model, body)
        if geoms or name in result.parameter_bodies.values():
            _send_pose(recording, entity_path(*path), indexes, scene, body)
        for geom in geoms:
            geom_path = entity_path(*path, geom_name(model, geom))
            if body in sizes:
                send_sized_geom(recording, geom_path, result, model, geom, sizes[body])
            else:
                recording.log(geom_path, colored_shape(model, geom), geom_transform(model, geom), static=True, strict=True)
    send_labels(recording, result, model, root)
    for tendon, strips in scene.tendons.items():
        _send_tendon(recording, entity_path(*root, "tendons", tendon_name(model, tendon)), indexes, scene, tendon, strips)


def _send_pose(recording: rr.RecordingStream, path: str, indexes: list[rr.TimeColumn], scene: Scene, body: int) -> None:
    if scene.model.body_weldid[body] == 0:  # fixed to the world
        pose = rr.Transform3D(translation=scene.positions[0, body], quaternion=scene.quaternions[0, body])
        recording.log(path, pose, static=True, strict=True)
        return
    columns = rr.Transform3D.columns(translation=scene.positions[:, body], quaternion=scene.quaternions[:, body])
    rr.send_columns(path, indexes, columns, recording=recording, strict=True)


def _send_tendon(
    recording: rr.RecordingStream, path: str, indexes: list[rr.TimeColumn], scene: Scene, tendon: int, frames: list[list[Array]]
) -> None:
    style = rr.LineStrips3D.from_fields(
        colors=to_bytes(tendon_rgba(scene.model, tendon)[np.newaxis]), radii=[float(scene.model.tendon_width[tendon])]
    )
    recording.log(path, style, static=True, strict=True)
    columns = rr.LineStrips3D.columns(strips=[strip for strips in frames for strip in strips])
    lengths = np.array([len(strips) for strips in frames])
    rr.send_columns(path, indexes, columns.partition(lengths), recording=recording, strict=True)


def _strips(data: mujoco.MjData, tendon: int) -> list[Array]:
    """The path of a spatial tendon, cut at its pulleys."""
    path = slice(data.ten_wrapadr[tendon], data.ten_wrapadr[tendon] + data.ten_wrapnum[tendon])
    points, objects = data.wrap_xpos.reshape(-1, 3)[path].copy(), data.wrap_obj.reshape(-1)[path]
    pieces = np.split(points, np.flatnonzero(objects == PULLEY))
    pieces = [piece[1:] if number else piece for number, piece in enumerate(pieces)]  # the pulley's own row is no point
    return [piece for piece in pieces if len(piece) > 1]


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
