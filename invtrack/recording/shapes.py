"""MuJoCo geoms as Rerun shapes."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array
from invtrack.recording.surfaces import drawn_texture, height_field_fields, mesh_fields, pixels_of, plane_fields, texture_of

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
    mujoco.mjtGeom.mjGEOM_HFIELD,
)
"""Geom types with a Rerun shape; signed distance fields have none."""

DEFAULT_RGBA = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's colour of what names none; only then does the material's colour show."""

SOLID = {"fill_mode": rr.components.FillMode.Solid}

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
    """Colour of a geom, by which its texture is multiplied if it is drawn with one."""
    textured = drawn_texture(model, geom) is not None
    return _rgba(model, model.geom_rgba[geom], model.geom_matid[geom], textured=textured)


def mean_rgba(model: mujoco.MjModel, geom: int) -> Array:
    """Colour of a geom that is drawn in one colour, whatever its pattern."""
    return _rgba(model, model.geom_rgba[geom], model.geom_matid[geom])


def tendon_rgba(model: mujoco.MjModel, tendon: int) -> Array:
    """Colour of a tendon."""
    return _rgba(model, model.tendon_rgba[tendon], model.tendon_matid[tendon])


def site_rgba(model: mujoco.MjModel, site: int) -> Array:
    """Colour of a site."""
    return _rgba(model, model.site_rgba[site], model.site_matid[site])


def _rgba(model: mujoco.MjModel, own: Array, material: int, *, textured: bool = False) -> Array:
    if material < 0 or not np.allclose(own, DEFAULT_RGBA):
        return np.array(own, dtype=float)
    rgba = np.array(model.mat_rgba[material], dtype=float)
    texture = texture_of(model, material)
    if texture is not None and not textured:  # a pattern that is not drawn: its mean colour stands for it
        rgba[:3] *= pixels_of(model, texture)[..., :3].mean(axis=(0, 1)) / 255
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
    if kind == mujoco.mjtGeom.mjGEOM_PLANE:
        unlimited = INFINITE_PLANE * model.stat.extent
        half = (size[0] if size[0] > 0 else unlimited, size[1] if size[1] > 0 else unlimited)
        if drawn_texture(model, geom) is not None:
            return Shape(rr.Mesh3D, plane_fields(model, geom, half), color_field="albedo_factor")
        thickness = 1e-4 * model.stat.extent
        return Shape(rr.Boxes3D, {"half_sizes": [[*half, thickness]], "centers": [[0.0, 0.0, -thickness]], **SOLID})
    if kind == mujoco.mjtGeom.mjGEOM_MESH:
        return Shape(rr.Mesh3D, mesh_fields(model, geom), color_field="albedo_factor")
    if kind == mujoco.mjtGeom.mjGEOM_HFIELD:
        return Shape(rr.Mesh3D, height_field_fields(model, geom), color_field="albedo_factor")
    return primitive(kind, size)


def primitive(kind: mujoco.mjtGeom, size: Array) -> Shape:
    """A sphere, ellipsoid, capsule, cylinder or box of MuJoCo's size (3,)."""
    if kind == mujoco.mjtGeom.mjGEOM_CAPSULE:  # Rerun's starts at the origin, MuJoCo's is centred there
        return Shape(rr.Capsules3D, {"lengths": [2 * size[1]], "radii": [size[0]], "translations": [[0.0, 0.0, -size[1]]], **SOLID})
    if kind == mujoco.mjtGeom.mjGEOM_CYLINDER:
        return Shape(rr.Cylinders3D, {"lengths": [2 * size[1]], "radii": [size[0]], **SOLID})
    if kind == mujoco.mjtGeom.mjGEOM_BOX:
        return Shape(rr.Boxes3D, {"half_sizes": [size], **SOLID})
    radii = [size[0]] * 3 if kind == mujoco.mjtGeom.mjGEOM_SPHERE else size
    return Shape(rr.Ellipsoids3D, {"half_sizes": [radii], **SOLID})


def visible_sites(model: mujoco.MjModel, body: int) -> list[int]:
    """Sites of a body that are to be seen: not fully transparent, and in a group shown by default."""
    return [
        site
        for site in np.flatnonzero(model.site_bodyid == body).tolist()
        if model.site_group[site] in VISIBLE_GROUPS and site_rgba(model, site)[3] > 0
    ]


def site_name(model: mujoco.MjModel, site: int) -> str:
    """Name of a site in the recording."""
    return str(model.site(site).name) or f"site {site}"


def colored_site(model: mujoco.MjModel, site: int) -> tuple[rr.AsComponents, rr.Transform3D]:
    """A visible site as it is in the model, and its pose in its body."""
    shape = primitive(mujoco.mjtGeom(model.site_type[site]), model.site_size[site])
    pose = rr.Transform3D(translation=model.site_pos[site], quaternion=model.site_quat[site, [1, 2, 3, 0]])
    return shape.colored(site_rgba(model, site)), pose
