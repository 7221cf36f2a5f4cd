from __future__ import annotations

import dataclasses
from pathlib import Path

import mujoco
import numpy as np
import pytest

from invtrack.recording import save_recording
from invtrack.recording.scene import frame_samples
from invtrack.results.result import RunResult
from tests.recording.conftest import CHANGES, MASSES, MJCF, Recorded

BODIES = "/inversion/scene/bodies"


@pytest.fixture(scope="module")
def recorded(run: RunResult, tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    return Recorded(save_recording(run, tmp_path_factory.mktemp("scene") / "run.rrd"))


def pose(recorded: Recorded, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Translations (frames, 3) and quaternions (frames, 4), x y z w, of an entity."""
    translations = np.array(recorded.column(path, "Transform3D:translation"))
    return translations[:, 0], np.array(recorded.column(path, "Transform3D:quaternion"))[:, 0]


def test_bodies_move_with_their_joints(run: RunResult, recorded: Recorded) -> None:
    steps = recorded.column(f"{BODIES}/cart", "step")
    slide, hinge = run.qpos[steps].T
    positions, _ = pose(recorded, f"{BODIES}/cart")
    assert np.allclose(positions, np.column_stack([slide, 0 * slide, 0 * slide]), atol=1e-6)
    positions, quaternions = pose(recorded, f"{BODIES}/arm")
    assert np.allclose(positions, np.column_stack([slide, 0 * slide, 0 * slide + 0.5]), atol=1e-6)
    zero = np.zeros_like(hinge)
    assert np.allclose(quaternions, np.column_stack([zero, np.sin(hinge / 2), zero, np.cos(hinge / 2)]), atol=1e-6)


def test_poses_are_those_of_mujoco(run: RunResult, recorded: Recorded) -> None:
    model = mujoco.MjModel.from_xml_string(MJCF)
    data = mujoco.MjData(model)
    positions, quaternions = pose(recorded, f"{BODIES}/tip")
    for frame, step in enumerate(recorded.column(f"{BODIES}/tip", "step")):
        data.qpos[:] = run.qpos[step]
        mujoco.mj_kinematics(model, data)
        assert np.array_equal(positions[frame], data.body("tip").xpos.astype(np.float32))
        assert np.array_equal(np.roll(quaternions[frame], 1), data.body("tip").xquat.astype(np.float32))


def test_the_rope_joins_the_wall_and_the_cart(run: RunResult, recorded: Recorded) -> None:
    path = "/inversion/scene/tendons/rope"
    strips, slide = recorded.column(path, "LineStrips3D:strips"), run.qpos[recorded.column(path, "step"), 0]
    assert len(strips) == slide.size
    for (strip,), x in zip(strips, slide, strict=True):
        assert np.allclose(strip, [[-1, 0, 0], [x, 0, 0.5]], atol=1e-6)


def test_a_rope_over_a_pulley_is_drawn_as_two(run: RunResult, recorded: Recorded) -> None:
    path = "/inversion/scene/tendons/hoist"
    strips, slide = recorded.column(path, "LineStrips3D:strips"), run.qpos[recorded.column(path, "step"), 0]
    for (there, back), x in zip(strips, slide, strict=True):
        assert np.allclose(there, [[-1, 0, 0], [x, 0, 0.5]], atol=1e-6)
        assert np.allclose(back, there[::-1])


def test_the_tip_grows_with_the_cube_root_of_its_mass(recorded: Recorded) -> None:
    path = f"{BODIES}/tip/payload"
    scales = np.array(recorded.column(path, "Transform3D:scale"))[:, 0]
    assert recorded.column(path, "step") == list(CHANGES)
    volumes = np.prod(scales, axis=1)
    assert volumes[1] / volumes[2] == pytest.approx(MASSES[1] / MASSES[2], rel=1e-6)
    assert volumes[1] == pytest.approx(1.0)
    assert 0.0 < volumes[0] < volumes[2]  # without mass it is small, and still to be seen
    assert len(set(np.ravel(recorded.column(path, "Ellipsoids3D:colors")))) == 3
    assert np.allclose(recorded.column(path, "Ellipsoids3D:half_sizes"), 0.2)


def test_labels_state_the_parameters(recorded: Recorded) -> None:
    labels = recorded.column(f"{BODIES}/tip/tip_mass_label", "Points3D:labels")
    assert labels == [["tip_mass = 0 kg"], ["tip_mass = 8 kg"], ["tip_mass = 1 kg"]]
    assert recorded.column(f"{BODIES}/arm/damping_label", "Points3D:labels") == [["damping = 0.25 N s/m"]]
    assert len(recorded.column(f"{BODIES}/arm/rod", "Transform3D:translation")) == 1  # no mass, so its size says nothing


def test_shapes_have_the_sizes_of_the_geoms(recorded: Recorded) -> None:
    cart = f"{BODIES}/cart"
    assert np.allclose(recorded.column(f"{cart}/box", "Boxes3D:half_sizes"), [0.3, 0.2, 0.1])
    assert np.allclose(recorded.column(f"{cart}/ellipsoid", "Ellipsoids3D:half_sizes"), [0.3, 0.2, 0.1])
    assert np.allclose(recorded.column(f"{cart}/cylinder", "Cylinders3D:lengths"), 0.8)
    assert recorded.column(f"{cart}/box", "Boxes3D:colors") == [[0x1A334DFF]]
    ((half,),) = recorded.column(f"{BODIES}/world/floor", "Boxes3D:half_sizes")
    assert half[0] > 1
    assert half[2] < 0.01


def test_the_capsule_ends_where_it_was_put(recorded: Recorded) -> None:
    path = f"{BODIES}/arm/rod"
    (translation,), (quaternion,) = pose(recorded, path)
    (((start),),) = recorded.column(path, "Capsules3D:translations")
    (((length),),) = recorded.column(path, "Capsules3D:lengths")
    ends = []
    for z in (0.0, length):
        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, np.add(start, [0.0, 0.0, z]), np.roll(quaternion, 1).astype(float))
        ends.append(translation + turned)
    assert np.allclose(sorted(ends, key=lambda end: end[2]), [[0.1, 0, 0], [0.1, 0.3, 0.4]], atol=1e-6)


def test_a_mesh_keeps_its_volume(run: RunResult, tmp_path: Path) -> None:
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><asset><mesh name="wedge" vertex="0 0 0  2 0 0  0 3 0  0 0 1"/></asset>
        <worldbody><body name="cart"><joint type="slide"/><joint type="hinge"/>
        <geom name="wedge" type="mesh" mesh="wedge"/></body></worldbody></mujoco>"""
    )
    binary = np.zeros(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    other = dataclasses.replace(run, mjb=binary.tobytes(), parameter_bodies={})
    corners = np.array(
        Recorded(save_recording(other, tmp_path / "run.rrd")).column(f"{BODIES}/cart/wedge", "Mesh3D:vertex_positions")
    )
    triangles = corners.reshape(-1, 3, 3)
    assert np.linalg.det(triangles).sum() / 6 == pytest.approx(1.0, rel=1e-5)  # 2 * 3 * 1 / 6, outward normals


def test_what_is_not_to_be_seen_is_not_recorded(recorded: Recorded) -> None:
    names = {path.rsplit("/", 1)[1] for path in recorded.batches if "/scene/" in path}
    assert {"floor", "box", "rope"} <= names
    assert not {"hidden", "collision_only", "unseen"} & names


def test_sixty_frames_per_second_where_the_plots_open_and_twenty_elsewhere(run: RunResult) -> None:
    time = np.linspace(-5.0, 15.0, 20_001)
    long_run = dataclasses.replace(run, time=time, qpos=np.zeros((time.size, 2)))
    frames = time[frame_samples(long_run, (-1.0, 4.0))]
    assert frames[[0, -1]] == pytest.approx([-5.0, 15.0])
    inside = (frames >= -1.0) & (frames <= 4.0)
    assert np.allclose(np.diff(frames[inside]), 1 / 60, atol=1.1e-3)  # to the nearest sample
    for outside in (frames[frames <= -1.0], frames[frames >= 4.0]):
        assert np.allclose(np.diff(outside), 1 / 20, atol=1.1e-3)
    assert np.allclose(np.diff(time[frame_samples(long_run, (-9.0, 99.0))]), 1 / 60, atol=1.1e-3)
    assert frame_samples(run, (0.0, 0.6)).size > 250  # a short run keeps enough frames to be watched slowly


def test_samples_without_position_are_left_out(run: RunResult, tmp_path: Path) -> None:
    qpos = run.qpos.copy()
    qpos[150:] = np.nan
    recorded = Recorded(save_recording(dataclasses.replace(run, qpos=qpos, status="diverged"), tmp_path / "run.rrd"))
    assert max(recorded.column(f"{BODIES}/cart", "step")) == 149
