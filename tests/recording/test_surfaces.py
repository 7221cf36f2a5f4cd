"""Textures, height fields and sites: what MuJoCo's own viewer shows of a model, a recording shows too."""

from __future__ import annotations

import dataclasses

import mujoco
import numpy as np
import pytest

from invtrack.recording import save_recording
from invtrack.recording.shapes import geom_rgba, mean_rgba, visible_sites
from invtrack.recording.surfaces import height_field, plane_fields
from tests.recording.conftest import Recorded, mechanism_run

MJCF = """
<mujoco>
  <asset>
    <texture name="checker" type="2d" builtin="checker" rgb1="0 0 0" rgb2="1 1 1" width="8" height="8"/>
    <material name="metres" texture="checker" texrepeat="2 3" texuniform="true" rgba="1 0.5 1 1"/>
    <material name="times" texture="checker" texrepeat="2 3"/>
    <hfield name="hills" nrow="3" ncol="4" size="3 2 0.5 0.1"/>
  </asset>
  <worldbody>
    <geom name="metres" type="plane" size="5 4 0.1" material="metres"/>
    <geom name="times" type="plane" size="5 4 0.1" material="times"/>
    <geom name="plain" type="plane" size="5 4 0.1"/>
    <geom name="hills" type="hfield" hfield="hills"/>
    <site name="seen" pos="0 1 0" size="0.1" rgba="1 0 0 1"/>
    <site name="hidden" group="4"/>
    <site name="clear" rgba="1 0 0 0"/>
    <body name="box">
      <joint type="slide"/>
      <geom name="box" type="box" size="1 1 1" material="times"/>
      <site name="tip" type="box" size="0.1 0.2 0.3" pos="0 0 1"/>
    </body>
  </worldbody>
</mujoco>
"""

HEIGHTS = np.array([[0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.5, 0.0], [0.0, 0.25, 0.0, 0.0]])


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    compiled = mujoco.MjModel.from_xml_string(MJCF)
    compiled.hfield_data[:] = HEIGHTS.ravel()
    return compiled


@pytest.fixture(scope="module")
def recorded(model: mujoco.MjModel, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    binary = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    run = mechanism_run()
    run = dataclasses.replace(run, qpos=run.qpos[:, :1], mjb=binary.tobytes(), parameter_bodies={})
    return Recorded(save_recording(run, tmp_path_factory.mktemp("surfaces") / "run.rrd"))


def test_a_pattern_repeats_by_the_metre_or_by_the_plane(model: mujoco.MjModel) -> None:
    for name, repeats in (("metres", (2 * 10.0, 3 * 8.0)), ("times", (2.0, 3.0))):
        places = plane_fields(model, model.geom(name).id, (5.0, 4.0))["vertex_texcoords"]
        assert np.ptp(places, axis=0) == pytest.approx(repeats)


def test_what_has_no_place_for_a_pattern_has_its_mean_colour(model: mujoco.MjModel) -> None:
    assert geom_rgba(model, model.geom("metres").id) == pytest.approx([1.0, 0.5, 1.0, 1.0])
    assert mean_rgba(model, model.geom("metres").id) == pytest.approx([0.5, 0.25, 0.5, 1.0], abs=0.01)
    assert geom_rgba(model, model.geom("box").id) == pytest.approx([0.5, 0.5, 0.5, 1.0], abs=0.01)


def test_a_height_field_is_as_high_as_mujoco_says_everywhere(model: mujoco.MjModel) -> None:
    geom, data = model.geom("hills").id, mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    for triangle in height_field(model, geom):
        place = triangle.mean(axis=0)
        down = mujoco.mj_rayHfield(model, data, geom, np.array([*place[:2], 3.0]), np.array([0.0, 0.0, -1.0]), None)
        assert 3.0 - down == pytest.approx(place[2], abs=1e-9)


def test_patterns_and_height_fields_are_in_the_recording(recorded: Recorded) -> None:
    world = "/inversion/scene/bodies/world"
    textured = recorded.having("Mesh3D:albedo_texture_buffer")
    assert sorted(textured) == [f"{world}/metres", f"{world}/times"]
    (vertices,) = recorded.column(f"{world}/hills", "Mesh3D:vertex_positions")
    assert len(vertices) == 3 * 2 * 2 * 3
    assert np.max(np.array(vertices)[:, 2]) == pytest.approx(0.5)


def test_sites_that_are_to_be_seen_move_with_their_bodies(model: mujoco.MjModel, recorded: Recorded) -> None:
    assert [str(model.site(site).name) for site in visible_sites(model, 0)] == ["seen"]
    bodies = "/inversion/scene/bodies"
    found = {path for path in recorded.batches if "/sites/" in path}
    assert found == {f"{bodies}/world/sites/seen", f"{bodies}/box/sites/tip"}
    assert np.ravel(recorded.column(f"{bodies}/box/sites/tip", "Boxes3D:half_sizes")) == pytest.approx([0.1, 0.2, 0.3])
    assert np.ravel(recorded.column(f"{bodies}/box/sites/tip", "Transform3D:translation")) == pytest.approx([0.0, 0.0, 1.0])
