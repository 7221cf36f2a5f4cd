"""MuJoCo geoms as Rerun shapes."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array

VISIBLE_GROUPS = range(3)
"""Geom groups that MuJoCo's own viewer shows unless told otherwise."""

DRAWN_TYPES = (
    mujoco.mjtGeom.mjGEOM_PLANE,
    mujoco.mjtGeom.mjGEOM_SPHERE,
    mujoco.mjtGeom.mjGEOM_CAPSULE,
    mujoco.mjtGeom.mjGEOM_ELLIPSOID,
    mujoco.mjtGeom.mjGEOM_CYLINDER,
    mujoco.mjtGeom.mjGEOM_BOX,
    mujoco.mjtGeom.mjGEOM_MESH,
)
"""Geom types with a Rerun shape; height fields and signed distance fields have none."""

DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's colour of what names none; only then does the material's colour show."""

INFINITE_PLANE = 3.0
"""Half width of a plane of unlimited size, relative to the extent of the model."""


@dataclass(frozen=True)
class Shape:
    """A geom in its own frame: the archetype without colour, and the name of the field that gives it one."""

    archetype: type[rr.AsComponents]
    fields: dict[str, object]
    color_field: str = "colors"

    def colored(self, rgba: ArrayLike) -> rr.AsComponents:
        """The archetype in one colour, RGBA from 0 to 1."""
        colors = to_bytes(np.reshape(rgba, (1, 4)))
        return self.archetype(**self.fields, **{self.color_field: colors if self.color_field == "colors" else colors[0]})

    def color_columns(self, rgba: Array) -> rr.ComponentColumnList:
        """A colour per row of `rgba` (rows, 4), to be sent over time."""
        return self.archetype.columns(**{self.color_field: to_bytes(rgba)})  # type: ignore[attr-defined, no-any-return]


def to_bytes(rgba: Array) -> NDArray[np.uint8]:
    """Colours from 0 to 1 as bytes."""
    return np.round(255 * np.clip(rgba, 0.0, 1.0)).astype(np.uint8)


def body_name(model: mujoco.MjModel, body: int) -> str:
    """Name of a body in the recording."""
    return str(model.body(body).name) or f"body {body}"


def geom_name(model: mujoco.MjModel, geom: int) -> str:
    """Name of a geom in the recording."""
    return str(model.geom(geom).name) or f"geom {geom}"


def tendon_name(model: mujoco.MjModel, tendon: int) -> str:
    """Name of a tendon in the recording."""
    return str(model.tendon(tendon).name) or f"tendon {tendon}"


def visible_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Geoms of a body that are to be seen: not fully transparent, in a group shown by default, and of a type that can be drawn."""
    geoms = range(model.body_geomadr[body], model.body_geomadr[body] + model.body_geomnum[body])
    return [
        geom
        for geom in geoms
        if model.geom_group[geom] in VISIBLE_GROUPS
        and mujoco.mjtGeom(model.geom_type[geom]) in DRAWN_TYPES
        and geom_rgba(model, geom)[3] > 0
    ]


def geom_rgba(model: mujoco.MjModel, geom: int) -> Array:
    """Colour of a geom."""
    return _rgba(model, model.geom_rgba[geom], model.geom_matid[geom])


def tendon_rgba(model: mujoco.MjModel, tendon: int) -> Array:
    """Colour of a tendon."""
    return _rgba(model, model.tendon_rgba[tendon], model.tendon_matid[tendon])


def _rgba(model: mujoco.MjModel, own: Array, material: int) -> Array:
    if material < 0 or not np.allclose(own, DEFAULT_RGBA):
        return np.array(own, dtype=float)
    rgba = np.array(model.mat_rgba[material], dtype=float)
    texture = model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB]
    if texture >= 0:  # patterns are not drawn: their mean colour stands for them
        start, channels = model.tex_adr[texture], model.tex_nchannel[texture]
        size = model.tex_height[texture] * model.tex_width[texture] * channels
        pixels = model.tex_data[start : start + size].reshape(-1, channels)
        rgba[:3] *= pixels[:, :3].mean(axis=0) / 255
    return rgba


def geom_transform(model: mujoco.MjModel, geom: int) -> rr.Transform3D:
    """Pose of a geom in its body."""
    return rr.Transform3D(translation=model.geom_pos[geom], quaternion=model.geom_quat[geom, [1, 2, 3, 0]])


def colored_shape(model: mujoco.MjModel, geom: int) -> rr.AsComponents:
    """A visible geom as it is in the model."""
    return geom_shape(model, geom).colored(geom_rgba(model, geom))


def geom_shape(model: mujoco.MjModel, geom: int) -> Shape:
    """The shape of a geom in its own frame, for the types that `visible_geoms` lets through."""
    kind, size = mujoco.mjtGeom(model.geom_type[geom]), model.geom_size[geom]
    solid = {"fill_mode": rr.components.FillMode.Solid}
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        unlimited = INFINITE_PLANE * model.stat.extent
        half = [size[0] if size[0] > 0 else unlimited, size[1] if size[1] > 0 else unlimited, 1e-4 * model.stat.extent]
        return Shape(rr.Boxes3D, {"half_sizes": [half], "centers": [[0.0, 0.0, -half[2]]], **solid})
    if kind == mujoco.mjtGeom.mjGEOM_SPHERE:
        return Shape(rr.Ellipsoids3D, {"half_sizes": [[size[0]] * 3], **solid})
    if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID:
        return Shape(rr.Ellipsoids3D, {"half_sizes": [size], **solid})
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:  # Rerun's starts at the origin, MuJoCo's is centred there
        return Shape(rr.Capsules3D, {"lengths": [2 * size[1]], "radii": [size[0]], "translations": [[0.0, 0.0, -size[1]]], **solid})
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return Shape(rr.Cylinders3D, {"lengths": [2 * size[1]], "radii": [size[0]], **solid})
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Shape(rr.Boxes3D, {"half_sizes": [size], **solid})
    return _mesh(model, model.geom_dataid[geom])


def _mesh(model: mujoco.MjModel, mesh: int) -> Shape:
    vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    # One vertex per corner of a triangle, with the triangle's normal: flat shading, which needs no smoothing groups.
    corners = model.mesh_vert[vertices][model.mesh_face[faces]]  # (faces, 3 corners, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    fields = {"vertex_positions": corners.reshape(-1, 3), "vertex_normals": np.repeat(normals, 3, axis=0)}
    return Shape(rr.Mesh3D, fields, color_field="albedo_factor")
