"""Points of a mechanism that are to follow a path: where they go, where they should, and a ghost of that on its way."""

from __future__ import annotations

import re
from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr

from invtrack.arrays import Array
from invtrack.recording.scene import Scene
from invtrack.recording.series import PALETTE, REFERENCE_COLOR, entity_path
from invtrack.recording.stream import Stream
from invtrack.results.result import RunResult

COORDINATE = re.compile(r"(?P<kind>site|body):(?P<name>.+):(?P<axis>[xyz])")
"""Outputs that are coordinates of a point, as they are named."""

GHOST, LINE = 0.015, 0.003
"""Radii of a ghost and of a path, as shares of the mechanism's extent."""

OPACITY = 130
"""Of a ghost, of 255."""


@dataclass(frozen=True, eq=False)
class FollowedPoint:
    """A point whose coordinates are outputs.

    name: "site:tip". actual, wanted: where it is and should be in the world (F, 3) [m], at the scene's frames; coordinates that
    are no outputs are wanted as they are.
    """

    name: str
    actual: Array
    wanted: Array


def followed_points(run: RunResult, scene: Scene) -> list[FollowedPoint]:
    """The sites and bodies of which coordinates are outputs of a run."""
    columns: dict[tuple[str, str], dict[int, int]] = {}
    for column, output in enumerate(run.output.channels.names):
        found = COORDINATE.fullmatch(output)
        if found is not None:
            columns.setdefault((found["kind"], found["name"]), {})["xyz".index(found["axis"])] = column
    points = []
    for (kind, name), axes in columns.items():
        actual = _place(scene, kind, name)
        wanted = actual.copy()
        for axis, column in axes.items():
            wanted[:, axis] = run.reference.values[scene.frames, column]
        points.append(FollowedPoint(f"{kind}:{name}", actual, wanted))
    return points


def _place(scene: Scene, kind: str, name: str) -> Array:
    """Where a site or body is at the frames (F, 3)."""
    model = scene.model
    if kind == "body":
        return np.array(scene.positions[:, mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, name)])
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, name)
    body, local = int(model.site_bodyid[site]), np.array(model.site_pos[site])
    vector, scalar = scene.quaternions[:, body, :3], scene.quaternions[:, body, 3:]
    across = np.cross(vector, local) + scalar * local
    return np.asarray(scene.positions[:, body] + local + 2 * np.cross(vector, across))


def send_followed(stream: Stream, run: RunResult, scene: Scene) -> None:
    """Send the paths of these points once, and their ghosts over time."""
    extent = float(scene.model.stat.extent)
    for number, point in enumerate(followed_points(run, scene)):
        color, root = PALETTE[number % len(PALETTE)], (run.name, "scene", "followed", point.name)
        for kind, places, shade in (("wanted", point.wanted, REFERENCE_COLOR), ("path", point.actual, color)):
            line = rr.LineStrips3D([places], radii=[LINE * extent], colors=[shade])
            stream.log(entity_path(*root, kind), line)
        ghost = entity_path(*root, "ghost")
        looks = rr.Points3D.from_fields(radii=[GHOST * extent], colors=[(*REFERENCE_COLOR, OPACITY)])
        stream.log(ghost, looks)
        stream.send(ghost, scene.frames, run.time[scene.frames], rr.Points3D.columns(positions=point.wanted), held=True)
