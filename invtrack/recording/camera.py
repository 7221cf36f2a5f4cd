"""From where a mechanism is looked at: a camera of its MJCF, or where its motion is seen best.

Without a camera, the view is along the horizontal direction in which what moves moves least (the points that outputs follow, or the
bodies where there are none), as of a principal component, with gravity down and the motion from left to right; the
more of the motion is along that direction and not up and down, the steeper the view.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RecordingError
from invtrack.recording.followed import followed_points
from invtrack.recording.scene import Scene
from invtrack.recording.shapes import visible_geoms
from invtrack.results.result import RunResult

FIELD_OF_VIEW = np.radians(55.0)
"""Of the viewer, from top to bottom; it cannot be set, so an eye with another one stands farther away or nearer."""

ROOM = 1.15
"""What is seen, relative to what moves."""

LEAST, MOST = np.radians(11.0), np.radians(60.0)
"""How far down the eye looks where all of the motion is upright, and where all of it is flat."""


@dataclass(frozen=True, eq=False)
class Camera:
    """An eye with `FIELD_OF_VIEW`: its position, what it looks at, and the direction that is up in the picture, (3,) each."""

    position: Array
    target: Array
    up: Array


def camera_of(
    runs: Sequence[RunResult],
    scenes: Sequence[Scene | None],
    interval: tuple[float, float],
    name: str | None = None,
    *,
    aspect: float = 1.0,
) -> Camera | None:
    """The camera for all runs of one mechanism; None where no run has a scene.

    Args:
        runs, scenes: the runs, and what is drawn of them.
        interval: the time [s] whose motion is to be seen.
        name: of a camera of the MJCF; unless given it is the first one that is fixed to the world, or where there is none the view
            is computed.
        aspect: width of the picture over its height, for which the view is computed.

    Raises RecordingError for a name that no camera has.
    """
    shown = [(run, scene) for run, scene in zip(runs, scenes, strict=True) if scene is not None]
    if not shown:
        if name is not None:
            raise RecordingError(f"camera {name!r} was asked for, but no run carries a model with cameras")
        return None
    model = shown[0][1].model
    chosen = _camera_named(model, name) if name is not None else _first_fixed(model)
    if chosen is not None:
        return _placed(*shown[0], chosen, interval)
    return _computed(shown, interval, aspect)


def _camera_named(model: mujoco.MjModel, name: str) -> int:
    camera = int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_CAMERA, name))
    if camera < 0:
        known = ", ".join(repr(str(model.camera(i).name)) for i in range(model.ncam)) or "none"
        raise RecordingError(f"the model has no camera {name!r}; it has: {known}")
    return camera


def _first_fixed(model: mujoco.MjModel) -> int | None:
    fixed = [
        camera
        for camera in range(model.ncam)
        if model.cam_mode[camera] == mujoco.mjtCamLight.mjCAMLIGHT_FIXED and model.body_weldid[model.cam_bodyid[camera]] == 0
    ]
    return fixed[0] if fixed else None


def _placed(run: RunResult, scene: Scene, camera: int, interval: tuple[float, float]) -> Camera:
    """A camera of the MJCF as it stands when the interval begins, moved along its axis to show as much in the viewer's field."""
    data = mujoco.MjData(scene.model)
    data.qpos[:] = run.qpos[scene.frames[_first_shown(run, scene, interval)]]
    mujoco.mj_kinematics(scene.model, data)
    mujoco.mj_comPos(scene.model, data)
    mujoco.mj_camlight(scene.model, data)
    position, axes = np.array(data.cam_xpos[camera]), np.array(data.cam_xmat[camera]).reshape(3, 3)
    forward = -axes[:, 2]
    middle = sum(_range(_seen([(run, scene)], interval), forward)) / 2
    distance = max(middle - float(forward @ position), 0.05 * float(scene.model.stat.extent))
    target = position + distance * forward
    fovy = np.radians(float(scene.model.cam_fovy[camera]))
    return Camera(target - distance * np.tan(fovy / 2) / np.tan(FIELD_OF_VIEW / 2) * forward, target, axes[:, 1])


def _first_shown(run: RunResult, scene: Scene, interval: tuple[float, float]) -> int:
    times = run.time[scene.frames]
    return min(int(np.searchsorted(times, interval[0])), len(times) - 1)


def _computed(shown: list[tuple[RunResult, Scene]], interval: tuple[float, float], aspect: float) -> Camera:
    model = shown[0][1].model
    gravity = np.array(model.opt.gravity)
    size = float(np.linalg.norm(gravity))
    up = -gravity / size if size > 0 else np.array([0.0, 0.0, 1.0])
    paths, seen = _paths(shown, interval), _seen(shown, interval)
    spread = sum((path - path.mean(axis=0)).T @ (path - path.mean(axis=0)) / len(path) for path in paths)
    spread = np.asarray(spread) + 1e-6 * max(float(np.trace(spread)), np.finfo(float).tiny) * np.diag([1.0, 0.5, 1.0])
    level = np.linalg.svd(up[np.newaxis])[2][1:]  # (2, 3), horizontal directions
    variances, directions = np.linalg.eigh(level @ spread @ level.T)
    along = directions[:, 0] @ level  # in which what moves moves least
    right = np.cross(along, up)
    way = sum((path[-1] - path[0]) @ right for path in paths)
    if way < -1e-3 * np.sqrt(np.trace(spread)) or (abs(way) <= 1e-3 * np.sqrt(np.trace(spread)) and right.sum() < 0):
        along, right = -along, -right
    flat = variances[0] / (variances[0] + up @ spread @ up)
    tilt = LEAST + (MOST - LEAST) * float(flat)
    forward = np.cos(tilt) * along - np.sin(tilt) * up
    axes = np.array([right, np.cross(right, forward), forward])
    low, high = np.array([_range(seen, axis) for axis in axes]).T
    target = (low + high) / 2 @ axes
    distance = _distance(seen, target, axes / [[aspect], [1.0], [1.0]], at_least=0.1 * float(model.stat.extent))
    return Camera(target - distance * forward, target, up)


def _distance(seen: list[tuple[Array, float]], target: Array, axes: Array, *, at_least: float) -> float:
    """How far from the target an eye sees everything in the picture.

    axes: right (over the aspect), up and forward (3, 3).
    """
    widening = ROOM / np.tan(FIELD_OF_VIEW / 2)
    found = float(at_least * widening)
    for path, reach in seen:
        placed = (path - target) @ axes.T
        found = max(found, float(np.max(widening * (np.max(np.abs(placed[:, :2]), axis=1) + reach) - placed[:, 2])))
    return found


def _paths(shown: list[tuple[RunResult, Scene]], interval: tuple[float, float]) -> list[Array]:
    """Where the followed points go and should go, or where the moving bodies go."""
    paths = []
    for run, scene in shown:
        during = _during(run, scene, interval)
        points = followed_points(run, scene)
        moving = [body for body in range(scene.model.nbody) if scene.model.body_weldid[body] != 0]
        paths += [path[during] for point in points for path in (point.wanted, point.actual)]
        if not points:
            paths += [scene.positions[during][:, body] for body in moving] or [np.zeros((1, 3))]
    return paths


def _during(run: RunResult, scene: Scene, interval: tuple[float, float]) -> slice:
    """The frames in the interval, at least one."""
    first = _first_shown(run, scene, interval)
    return slice(first, max(int(np.searchsorted(run.time[scene.frames], interval[1])), first + 1))


def _seen(shown: list[tuple[RunResult, Scene]], interval: tuple[float, float]) -> list[tuple[Array, float]]:
    """What is to be seen in the interval: places (k, 3) of moving geoms and followed points, each with the reach around them."""
    found: list[tuple[Array, float]] = []
    for run, scene in shown:
        during, model = _during(run, scene, interval), scene.model
        for body in (body for body in range(1, model.nbody) if model.body_weldid[body] != 0):
            for geom in visible_geoms(model, body):
                reach = np.linalg.norm(model.geom_pos[geom]) + model.geom_rbound[geom]  # in every direction
                found.append((scene.positions[during][:, body], float(reach)))
        found += [(path[during], 0.0) for point in followed_points(run, scene) for path in (point.wanted, point.actual)]
    model = shown[0][1].model
    return found or [(np.array(model.stat.center)[np.newaxis], float(model.stat.extent) / 2)]


def _range(seen: list[tuple[Array, float]], direction: Array) -> tuple[float, float]:
    """From where to where they reach along a direction."""
    along = [(path @ direction, reach) for path, reach in seen]
    return min(float(x.min()) - reach for x, reach in along), max(float(x.max()) + reach for x, reach in along)
