"""Pictures of a mechanism, painted from back to front: no graphics library, display or driver, and the same pixels everywhere."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from invtrack.arrays import Array
from invtrack.recording.camera import FIELD_OF_VIEW, Camera
from invtrack.recording.shapes import mean_rgba, visible_geoms
from invtrack.recording.solids import normals, solid

Color = tuple[int, int, int]

SKY: Color = (238, 242, 246)
LIGHT = np.array([-0.35, -0.55, 0.76])
"""Towards the light."""

AMBIENT = 0.55
"""Share of the light that comes from everywhere."""

FINER = 2
"""Pixels that are painted for each one of the picture, either way."""

NEAREST = 1e-3
"""Depth relative to the distance of the target from which on something is seen."""


@dataclass(frozen=True, eq=False)
class _Part:
    """A geom: corners (v, 3) and normals (f, 3) in its body's frame, faces, colour from 0 to 1."""

    body: int
    corners: Array
    faces: list[NDArray[np.int64]]
    normals: Array
    rgba: Array
    is_ground: bool


class Painter:
    """Paints a mechanism as a camera sees it.

    Args:
        model: the mechanism.
        camera: from where it is seen; its field of view is as high as the picture.
        size: (width, height) of the picture [pixels].
    """

    def __init__(self, model: mujoco.MjModel, camera: Camera, size: tuple[int, int]) -> None:
        self.size = size
        self._eye, toward = camera.position, camera.target - camera.position
        self._distance = float(np.linalg.norm(toward))
        forward = toward / self._distance
        right = np.cross(forward, camera.up)
        right /= np.linalg.norm(right)
        self._axes = np.array([right, np.cross(right, forward), forward])
        self._parts = [self._part(model, body, geom) for body in range(model.nbody) for geom in visible_geoms(model, body)]

    def _part(self, model: mujoco.MjModel, body: int, geom: int) -> _Part:
        corners, faces = solid(model, geom, unlimited=2 * self._distance)
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, model.geom_quat[geom])
        placed = corners @ turn.reshape(3, 3).T + model.geom_pos[geom]
        is_ground = model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_PLANE
        return _Part(body, placed, faces, normals(placed, faces), mean_rgba(model, geom), is_ground)

    def picture(self, positions: Array, quaternions: Array) -> Image.Image:
        """The mechanism with its bodies at positions (bodies, 3) [m] and quaternions (bodies, 4), x y z w; `FINER` times finer."""
        canvas = Image.new("RGB", (FINER * self.size[0], FINER * self.size[1]), SKY)
        draw = ImageDraw.Draw(canvas)
        polygons: list[tuple[tuple[bool, float, float], list[tuple[float, float]], Color]] = []
        for part in self._parts:
            turn = np.empty(9)
            mujoco.mju_quat2Mat(turn, quaternions[part.body, [3, 0, 1, 2]])
            corners = part.corners @ turn.reshape(3, 3).T + positions[part.body]
            facing = part.normals @ turn.reshape(3, 3).T
            places, depths = self.place(corners)
            middle = float(np.mean(depths))
            for face, normal in zip(part.faces, facing, strict=True):
                if normal @ (self._eye - corners[face[0]]) <= 0 or np.min(depths[face]) < NEAREST * self._distance:
                    continue
                bright = AMBIENT + (1 - AMBIENT) * max(float(normal @ LIGHT), 0.0)
                shade = part.rgba[3] * bright * part.rgba[:3] * 255 + (1 - part.rgba[3]) * np.array(SKY)
                red, green, blue = (int(value) for value in np.clip(shade, 0, 255))
                order = (not part.is_ground, -middle, -float(np.mean(depths[face])))
                polygons.append((order, [(float(x), float(y)) for x, y in places[face]], (red, green, blue)))
        for _, corners_seen, color in sorted(polygons, key=lambda each: each[0]):
            draw.polygon(corners_seen, fill=color)
        return canvas

    def place(self, points: Array) -> tuple[Array, Array]:
        """Where points (k, 3) are in the finer picture (k, 2), right and down [pixels], and how far ahead (k,) [m]."""
        seen = (points - self._eye) @ self._axes.T
        depth = np.maximum(seen[:, 2], NEAREST * self._distance)
        scale = FINER * self.size[1] / 2 / np.tan(FIELD_OF_VIEW / 2) / depth
        middle = FINER * np.array(self.size) / 2
        return np.column_stack([middle[0] + scale * seen[:, 0], middle[1] - scale * seen[:, 1]]), seen[:, 2]

    def line(self, canvas: Image.Image, points: Array, color: Color, width: float) -> None:
        """A line through points (k, 3) [m], `width` pixels wide."""
        if len(points) > 1:
            places = [(float(x), float(y)) for x, y in self.place(points)[0]]
            ImageDraw.Draw(canvas).line(places, fill=color, width=round(FINER * width), joint="curve")

    def ring(self, canvas: Image.Image, point: Array, color: Color, radius: float) -> None:
        """A circle around a point (3,) [m], of so many pixels."""
        ((x, y),), _ = self.place(point[np.newaxis])
        r = FINER * radius
        ImageDraw.Draw(canvas).ellipse([x - r, y - r, x + r, y + r], outline=color, width=round(1.6 * FINER))
