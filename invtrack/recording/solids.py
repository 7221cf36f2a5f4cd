"""Geoms as flat faces, for pictures that are drawn without a graphics library."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.recording.surfaces import height_field

AROUND, ALONG = 16, 6
"""Faces around a round geom, and from pole to pole of a hemisphere."""

TILES = 12
"""Faces along either side of a plane."""

Solid = tuple[Array, list[NDArray[np.int64]]]
"""Vertices (v, 3) in the geom's frame, and the faces: numbers of their corners, counterclockwise from outside."""


def solid(model: mujoco.MjModel, geom: int, *, unlimited: float) -> Solid:
    """The faces of a geom of a type that `visible_geoms` lets through. unlimited: half width of a plane without a size [m]."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), np.array(model.geom_size[geom], dtype=float)
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        return _plane(*(side if side > 0 else unlimited for side in size[:2]))
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return _prism(np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * size[:2], size[2])
    angles = np.arange(AROUND) * 2 * np.pi / AROUND
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return _prism(size[0] * circle, size[1])
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        corners_of = height_field(model, geom)
        return corners_of.reshape(-1, 3), [np.arange(first, first + 3) for first in range(0, 3 * len(corners_of), 3)]
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    radii = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else np.full(3, size[0])
    return _round(circle, radii, size[1] if kind == mujoco.mjtGeom.mjGEOM_CAPSULE else 0.0)


def _plane(length: float, width: float) -> Solid:
    x, y = np.meshgrid(np.linspace(-length, length, TILES + 1), np.linspace(-width, width, TILES + 1))
    corners = np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)])
    first = np.arange(TILES * (TILES + 1)).reshape(TILES, TILES + 1)[:, :-1].ravel()
    return corners, [np.array([i, i + 1, i + TILES + 2, i + TILES + 1]) for i in first]


def _prism(base: Array, half_height: float) -> Solid:
    """A base (k, 2), counterclockwise, from -half_height to half_height along z."""
    count = len(base)
    corners = np.vstack([np.column_stack([base, np.full(count, sign * half_height)]) for sign in (-1.0, 1.0)])
    sides = [np.array([i, (i + 1) % count, count + (i + 1) % count, count + i]) for i in range(count)]
    return corners, [*sides, np.arange(count)[::-1], count + np.arange(count)]


def _round(circle: Array, radii: Array, half_length: float) -> Solid:
    """An ellipsoid, cut in half and drawn out along z by half_length to both sides."""
    south_half, north_half = np.linspace(-np.pi / 2, 0.0, ALONG + 1)[1:], np.linspace(0.0, np.pi / 2, ALONG + 1)[:-1]
    if half_length == 0:
        north_half = north_half[1:]  # one equator
    latitudes = np.concatenate([south_half, north_half])
    sign = np.concatenate([np.full(len(south_half), -1.0), np.full(len(north_half), 1.0)])
    rings = [
        np.column_stack([radii[:2] * np.cos(angle) * circle, np.full(AROUND, radii[2] * np.sin(angle) + side * half_length)])
        for angle, side in zip(latitudes, sign, strict=True)
    ]
    poles = np.array([[0.0, 0.0, -radii[2] - half_length], [0.0, 0.0, radii[2] + half_length]])
    corners = np.vstack([*rings, poles])
    faces = [
        np.array([r * AROUND + i, r * AROUND + (i + 1) % AROUND, (r + 1) * AROUND + (i + 1) % AROUND, (r + 1) * AROUND + i])
        for r in range(len(rings) - 1)
        for i in range(AROUND)
    ]
    south, north, last = len(corners) - 2, len(corners) - 1, (len(rings) - 1) * AROUND
    faces += [np.array([south, (i + 1) % AROUND, i]) for i in range(AROUND)]
    faces += [np.array([north, last + i, last + (i + 1) % AROUND]) for i in range(AROUND)]
    return corners, faces


def _mesh(model: mujoco.MjModel, mesh: int) -> Solid:
    vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    return np.array(model.mesh_vert[vertices], dtype=float), list(np.array(model.mesh_face[faces], dtype=np.int64))


def normals(corners: Array, faces: Sequence[NDArray[np.int64]]) -> Array:
    """Unit normals of faces (k, 3), pointing outwards; zero for a face without area."""
    crossed = np.array([np.cross(corners[face[1]] - corners[face[0]], corners[face[2]] - corners[face[0]]) for face in faces])
    return np.asarray(crossed / np.maximum(np.linalg.norm(crossed, axis=1, keepdims=True), np.finfo(float).tiny))
