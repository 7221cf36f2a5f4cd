"""Triangles with textures: meshes, height fields and patterned planes."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array

TEXTURED = (mujoco.mjtGeom.mjGEOM_PLANE, mujoco.mjtGeom.mjGEOM_MESH)
"""Geom types whose flat textures are drawn; of others the mean colour stands for the pattern."""


def texture_of(model: mujoco.MjModel, material: int) -> int | None:
    """The colour texture of a material, None where it has none."""
    if material < 0:
        return None
    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    return texture if texture >= 0 else None


def pixels_of(model: mujoco.MjModel, texture: int) -> NDArray[np.uint8]:
    """Of a texture (height, width, channels); the six sides of a cube stand below each other."""
    height, width, channels = (int(getattr(model, name)[texture]) for name in ("tex_height", "tex_width", "tex_nchannel"))
    start = int(model.tex_adr[texture])
    return np.array(model.tex_data[start : start + height * width * channels]).reshape(height, width, channels)


def drawn_texture(model: mujoco.MjModel, geom: int) -> int | None:
    """The texture that a geom is drawn with, None where it is drawn in one colour."""
    texture = texture_of(model, int(model.geom_matid[geom]))
    kind = mujoco.mjtGeom(model.geom_type[geom])
    if texture is None or kind not in TEXTURED or model.tex_type[texture] != mujoco.mjtTexture.mjTEXTURE_2D:
        return None
    has_places = kind == mujoco.mjtGeom.mjGEOM_PLANE or model.mesh_texcoordadr[model.geom_dataid[geom]] >= 0
    return texture if has_places else None


def plane_fields(model: mujoco.MjModel, geom: int, half: tuple[float, float]) -> dict[str, Any]:
    """A plane of these half widths [m] with its texture, as fields of a Rerun mesh."""
    material = int(model.geom_matid[geom])
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    sides = np.array(half)
    finite = np.where(np.array(model.geom_size[geom, :2]) > 0, 2 * sides, 1.0)  # an unlimited plane repeats its texture every metre
    per_metre = np.array(model.mat_texrepeat[material]) / (1.0 if model.mat_texuniform[material] else finite)
    return {
        "vertex_positions": np.column_stack([corners * sides, np.zeros(4)]),
        "vertex_normals": np.tile([0.0, 0.0, 1.0], (4, 1)),
        "vertex_texcoords": corners * sides * per_metre,
        "triangle_indices": [[0, 1, 2], [0, 2, 3]],
        "albedo_texture": _image(model, material),
    }


def mesh_fields(model: mujoco.MjModel, geom: int) -> dict[str, Any]:
    """A mesh, with its texture if it has one, as fields of a Rerun mesh."""
    mesh = int(model.geom_dataid[geom])
    vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
    faces = slice(model.mesh_faceadr[mesh], model.mesh_faceadr[mesh] + model.mesh_facenum[mesh])
    fields = _triangles(np.array(model.mesh_vert[vertices], dtype=float)[model.mesh_face[faces]])
    if drawn_texture(model, geom) is not None:
        places = slice(model.mesh_texcoordadr[mesh], model.mesh_texcoordadr[mesh] + model.mesh_texcoordnum[mesh])
        fields["vertex_texcoords"] = np.array(model.mesh_texcoord[places])[model.mesh_facetexcoord[faces]].reshape(-1, 2)
        fields["albedo_texture"] = _image(model, int(model.geom_matid[geom]))
    return fields


def height_field_fields(model: mujoco.MjModel, geom: int) -> dict[str, Any]:
    """The surface of a height field, as fields of a Rerun mesh."""
    return _triangles(height_field(model, geom))


def height_field(model: mujoco.MjModel, geom: int) -> Array:
    """Triangles of the surface of a height field (faces, 3 corners, 3), in the geom's frame."""
    field = int(model.geom_dataid[geom])
    rows, columns, start = (int(getattr(model, name)[field]) for name in ("hfield_nrow", "hfield_ncol", "hfield_adr"))
    radius_x, radius_y, top, _ = model.hfield_size[field]
    heights = top * np.array(model.hfield_data[start : start + rows * columns], dtype=float).reshape(rows, columns)
    x, y = np.meshgrid(np.linspace(-radius_x, radius_x, columns), np.linspace(-radius_y, radius_y, rows))
    grid = np.stack([x, y, heights], axis=-1)
    lower, right, upper, left = grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]
    halves = [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((lower, right, upper), (lower, upper, left))]
    return np.concatenate(halves)


def _triangles(corners: Array) -> dict[str, Any]:
    """Triangles (faces, 3 corners, 3) as fields of a Rerun mesh."""
    # One vertex per corner of a triangle, with the triangle's normal: flat shading, which needs no smoothing groups.
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    return {"vertex_positions": corners.reshape(-1, 3), "vertex_normals": np.repeat(normals, 3, axis=0)}


def _image(model: mujoco.MjModel, material: int) -> NDArray[np.uint8]:
    texture = texture_of(model, material)
    assert texture is not None
    pixels = pixels_of(model, texture)
    return np.repeat(pixels, 3, axis=2) if pixels.shape[2] == 1 else pixels
