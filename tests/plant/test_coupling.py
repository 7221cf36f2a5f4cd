"""Velocity couplings: seen alike wherever MuJoCo computes accelerations, confined to their plant, refused where they do not fit."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import mujoco
import mujoco.rollout
import numpy as np
import pytest
import scipy.linalg

import invtrack
from invtrack.errors import PlantError
from tests.plant.mechanisms import FREE_BODY, plant_of

# Two carts of 2 and 5 kg that only the coupling connects: v' = M^-1 K v + [1/2, 0]' u.
CARTS = """
<mujoco model="carts">
  <option gravity="0 0 0" integrator="RK4" timestep="0.01"/>
  <worldbody>
    <body name="left">
      <joint name="a" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
    </body>
    <body name="right" pos="0 1 0">
      <joint name="b" type="slide" axis="1 0 0"/><inertial pos="0 0 0" mass="5" diaginertia="1 1 1"/>
    </body>
    <body name="top" pos="0 2 0">
      <joint name="ball" type="ball"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
    </body>
    <body name="pillar"/>
  </worldbody>
  <actuator><motor name="push" joint="a"/></actuator>
  <sensor><jointpos name="b" joint="b"/></sensor>
  <custom>{custom}</custom>
</mujoco>"""
K = np.array([[-0.4, 3.0], [-2.0, 0.7]])
MASSES = np.diag([2.0, 5.0])
JOINTS = ("joint a", "joint b")


@pytest.fixture(autouse=True)
def _no_callback_is_left() -> Iterator[None]:
    yield
    left = mujoco.get_mjcb_passive()
    mujoco.set_mjcb_passive(None)
    assert left is None


def coupling_of(elements: tuple[str, ...], matrix: Any, name: str = "velocity_coupling") -> str:
    named = "".join('<element objtype="{}" objname="{}"/>'.format(*element.split()) for element in elements)
    data = " ".join(map(repr, np.ravel(matrix).tolist()))
    return f'<tuple name="{name}">{named}</tuple><numeric name="{name}" data="{data}"/>'


def carts(folder: Path, *custom: str, **options: Any) -> invtrack.Plant:
    text = CARTS.format(custom="".join(custom or [coupling_of(JOINTS, K)]))
    return plant_of(folder, text, **{"inputs": ["push"], "outputs": ["b"], **options})


def craft(folder: Path, matrix: np.ndarray) -> invtrack.Plant:
    custom = f"<custom>{coupling_of(('body craft',), matrix)}</custom></mujoco>"
    return plant_of(folder, FREE_BODY.replace("</mujoco>", custom), inputs=["thrust"], outputs=["site:centre:z"])


def moving(plant: invtrack.Plant, model: mujoco.MjModel) -> mujoco.MjData:
    data = plant.new_data(model)
    data.qvel[:2] = [0.5, -1.2]
    return data


def after_one_step(plant: invtrack.Plant, model: mujoco.MjModel) -> np.ndarray:
    data = moving(plant, model)
    mujoco.mj_step(model, data)
    return np.array(data.qvel[:2])


def assert_same_dynamics(first: invtrack.Plant, second: invtrack.Plant) -> None:
    assert np.max(np.abs(invtrack.linearize(first).A - invtrack.linearize(second).A)) < 1e-12


def test_forward_linearize_step_and_rollout_see_the_same_forces(tmp_path: Path) -> None:
    plant = carts(tmp_path)
    model = plant.model_with()
    rate, h, v0 = np.linalg.solve(MASSES, K), model.opt.timestep, np.array([0.5, -1.2])
    linear = invtrack.linearize(plant)
    assert linear.A[5:7, 5:7] == pytest.approx(rate, abs=1e-11)
    data, before = moving(plant, model), np.empty((1, mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS)))
    mujoco.mj_getState(model, data, before[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
    with plant.forces(model):
        mujoco.mj_forward(model, data)
        assert data.qacc[:2] == pytest.approx(rate @ v0, abs=1e-13)
        stepped = after_one_step(plant, model)
        rolled = [
            mujoco.rollout.rollout([model] * 8, [mujoco.MjData(model) for _ in range(n)], np.tile(before, (8, 1)), nstep=1)[0]
            for n in (1, 2)  # one thread, two threads
        ]
    assert stepped == pytest.approx(scipy.linalg.expm(h * rate) @ v0, abs=1e-10)  # RK4 misses by (h |rate|)^5 / 120
    for states in rolled:
        v = states[:, 0, 1 + model.nq :][:, :2]
        assert np.array_equal(v, np.tile(stepped, (8, 1)))


def test_inverse_dynamics_see_them_too(tmp_path: Path) -> None:
    plant = carts(tmp_path)
    data = moving(plant, plant.model)
    with plant.forces():
        mujoco.mj_inverse(plant.model, data)
    assert data.qfrc_inverse[:2] == pytest.approx(MASSES @ data.qacc[:2] - K @ data.qvel[:2], abs=1e-13)


def test_operating_point_and_new_data_see_them(tmp_path: Path) -> None:
    plant = carts(tmp_path).at(qvel=[1.0, 2.0, 0, 0, 0])
    assert plant.new_data().qacc[:2] == pytest.approx(np.linalg.solve(MASSES, K @ [1.0, 2.0]))


def test_changed_parameters_leave_the_coupling(tmp_path: Path) -> None:
    plant = carts(tmp_path, parameters={"mass": "body:left:mass"})
    expected = np.linalg.solve(np.diag([8.0, 5.0]), K)
    assert invtrack.linearize(plant, mass=8.0).A[5:7, 5:7] == pytest.approx(expected, abs=1e-11)
    compiled = plant.compiled_with({"mass": 8.0})
    data = moving(plant, compiled)
    with plant.forces(compiled):
        mujoco.mj_forward(compiled, data)
    assert data.qacc[:2] == pytest.approx(expected @ data.qvel[:2], abs=1e-13)


def test_copies_and_other_models_need_their_own_block(tmp_path: Path) -> None:
    plant = carts(tmp_path)
    model = plant.model_with()
    with plant.forces(model):
        other = copy.copy(model)
        assert after_one_step(plant, other) == pytest.approx([0.5, -1.2])
        with plant.forces(other):
            assert np.array_equal(after_one_step(plant, other), after_one_step(plant, model))


def test_two_plants_interleaved_keep_their_own_couplings(tmp_path: Path) -> None:
    plants = [carts(tmp_path), carts(tmp_path, coupling_of(JOINTS, -2 * K))]
    models = [plant.model_with() for plant in plants]
    alone = []
    for plant, model in zip(plants, models, strict=True):
        with plant.forces(model):
            alone.append(after_one_step(plant, model))
    with plants[0].forces(models[0]), plants[1].forces(models[1]):
        pairs = list(zip(plants, models, strict=True))
        together = [after_one_step(plant, model) for plant, model in [*pairs, *pairs]]
        invtrack.linearize(plants[1])  # on a model of its own
    assert np.array_equal(together, [*alone, *alone])
    assert np.max(np.abs(alone[0] - alone[1])) > 1e-2


def test_several_couplings_add_up(tmp_path: Path) -> None:
    whole = carts(tmp_path)
    rows = [coupling_of(JOINTS, np.diag(keep) @ K, f"velocity_coupling:{i}") for i, keep in enumerate(([1, 0], [0, 1]))]
    parts = carts(tmp_path, *rows)
    assert [coupling.name for coupling in parts.couplings] == ["velocity_coupling:0", "velocity_coupling:1"]
    assert_same_dynamics(parts, whole)


def test_order_of_the_elements_is_the_order_of_rows_and_columns(tmp_path: Path) -> None:
    turned = carts(tmp_path, coupling_of(JOINTS[::-1], K[::-1, ::-1]))
    assert_same_dynamics(turned, carts(tmp_path))


def test_a_body_and_its_joint_are_coupled_alike(tmp_path: Path) -> None:
    """The velocity of a slide along x is the first entry of its body's twist, also where bodies and joints are mixed."""
    wide = np.zeros((7, 7))
    wide[np.ix_([0, 6], [0, 6])] = K
    mixed = carts(tmp_path, coupling_of(("body left", "joint b"), wide))
    assert_same_dynamics(mixed, carts(tmp_path))


def test_prefixes_of_names_do_not_hide_a_coupling(tmp_path: Path) -> None:
    plant = carts(tmp_path, coupling_of(JOINTS, K, "left_velocity_coupling"))
    assert_same_dynamics(plant, carts(tmp_path))


def random_pose(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A quaternion and its rotation matrix."""
    quaternion, R = rng.normal(size=4), np.empty(9)
    quaternion /= np.linalg.norm(quaternion)
    mujoco.mju_quat2Mat(R, quaternion)
    return quaternion, R.reshape(3, 3)


def test_wrench_of_a_free_body_acts_in_its_own_frame(tmp_path: Path) -> None:
    """Newton and Euler: m v' = R f, I w' + w x I w = t with (f, t) = K (R' v, w), in any pose and motion."""
    rng = np.random.default_rng(11)
    matrix = rng.normal(size=(6, 6))
    plant, mass, inertia = craft(tmp_path, matrix), 3.0, np.array([0.4, 0.5, 0.6])
    for _ in range(10):
        quaternion, R = random_pose(rng)
        v_body, w = rng.normal(size=3), rng.normal(size=3)
        data = plant.at(qpos=[*rng.normal(size=3), *quaternion], qvel=[*(R @ v_body), *w]).new_data()
        force, torque = np.split(matrix @ [*v_body, *w], 2)
        assert data.qacc[:3] == pytest.approx(R @ force / mass, abs=1e-12)
        assert data.qacc[3:] == pytest.approx((torque - np.cross(w, inertia * w)) / inertia, abs=1e-12)


def test_wrench_acts_at_the_origin_of_a_body_whose_mass_lies_elsewhere(tmp_path: Path) -> None:
    """The power of the forces is the twist of the frame's origin times the wrench there."""
    rng = np.random.default_rng(12)
    matrix = rng.normal(size=(6, 6))
    text = FREE_BODY.replace('inertial pos="0 0 0"', 'inertial pos="0.3 -0.2 0.5"').replace(
        "</mujoco>", f"<custom>{coupling_of(('body craft',), matrix)}</custom></mujoco>"
    )
    plant = plant_of(tmp_path, text, inputs=["thrust"], outputs=["site:centre:z"])
    quaternion, R = random_pose(rng)
    v_body, w = rng.normal(size=3), rng.normal(size=3)
    data = plant.at(qpos=[0, 0, 0, *quaternion], qvel=[*(R @ v_body), *w]).new_data()
    twist = np.r_[v_body, w]
    assert float(data.qfrc_passive @ data.qvel) == pytest.approx(float(twist @ matrix @ twist), abs=1e-12)
    assert R.T @ data.qfrc_passive[:3] == pytest.approx((matrix @ twist)[:3], abs=1e-12)


def test_yaw_turns_the_physics_with_the_body(tmp_path: Path) -> None:
    """Turned by 90 degrees about z, positions and velocities in the world's axes are those of the unturned body, turned."""
    plant = craft(tmp_path, np.random.default_rng(13).normal(size=(6, 6)))
    straight, turned = (
        invtrack.linearize(plant.at(qpos=[0, 0, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)])) for yaw in (0.0, np.pi / 2)
    )
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    T = scipy.linalg.block_diag(quarter, np.eye(3), quarter, np.eye(3))  # rotations are in the body's frame already
    assert np.max(np.abs(turned.A - straight.transformed(T).A)) < 1e-9
    assert np.max(np.abs(turned.A - straight.A)) > 0.1


def test_callback_is_cleared_after_an_exception(tmp_path: Path) -> None:
    with pytest.raises(KeyError, match="stop"), carts(tmp_path).forces():
        raise KeyError("stop")
    assert mujoco.get_mjcb_passive() is None


def test_a_run_that_is_interrupted_leaves_no_callback() -> None:
    plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
    plan = invtrack.invert(invtrack.linearize(plant), invtrack.rest_to_rest(0.0, 1.0, 10.0), max_preactuation=5.0)

    def interrupt(share: float) -> None:
        raise RuntimeError("stop here")

    with pytest.raises(RuntimeError, match="stop here"):
        invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=0.01, end=10.0, progress=interrupt)
    assert mujoco.get_mjcb_passive() is None


def test_other_files_can_be_loaded_and_linearized_within_the_block(tmp_path: Path) -> None:
    plant = carts(tmp_path)
    with plant.forces():
        inside = invtrack.linearize(carts(tmp_path, coupling_of(JOINTS, 2 * K)))
        assert mujoco.get_mjcb_passive() is not None
    assert inside.A[5:7, 5:7] == pytest.approx(np.linalg.solve(MASSES, 2 * K), abs=1e-11)


def test_plants_without_couplings_install_no_callback(monkeypatch: pytest.MonkeyPatch) -> None:
    plant = invtrack.Plant.from_xml(invtrack.model_path("cantilever"), inputs=["base_force"], outputs=["tip_position"])

    def forbidden(callback: object) -> None:
        raise AssertionError("a callback was installed")

    monkeypatch.setattr(mujoco, "set_mjcb_passive", forbidden)
    plan = invtrack.invert(invtrack.linearize(plant), invtrack.rest_to_rest(0.0, 1.0, 1.0), max_preactuation=0.1)
    begin = plan.states(plan.start)[0]
    result = invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=0.01, end=1.0, initial_state=begin)
    assert result.status == "completed"
    with plant.forces():
        mujoco.mj_forward(plant.model, plant.new_data())


PAIR = coupling_of(JOINTS, K)
TWO_FLAGS = '</custom><option><flag spring="disable" damper="disable"/></option><custom>'


@pytest.mark.parametrize(
    ("custom", "message"),
    [
        (coupling_of(JOINTS, [1, 2, 3]), r"of joint a, joint b expects a matrix of 2 x 2 = 4 entries .*, got 3"),
        (coupling_of(("body left",), K), r"of body left expects a matrix of 6 x 6 = 36 entries .*, got 4"),
        (coupling_of(("joint a", "joint c"), K), r"no joint named 'c'; there are: a, b, ball"),
        (coupling_of(("body craft",), K), r"no body named 'craft'; there are: left, right, top, pillar"),
        (coupling_of(("joint a", "joint a"), K), r"names an element twice: joint a, joint a"),
        (coupling_of(("joint ball",), [1]), r"joint 'ball' is a ball or free joint: name its body"),
        (coupling_of(("body pillar",), np.eye(6)), r"body 'pillar' does not move; those that do are: left, right, top"),
        (coupling_of(("sensor b",), [1]), r'expects elements of objtype "joint" or "body", got "sensor"'),
        (coupling_of(("joint a",), [np.inf]), r"entries that are not finite"),
        (PAIR.partition("<numeric")[0], r"the tuples velocity_coupling and the numerics none"),
        ('<numeric name="velocity_coupling" data="1"/>', r"the tuples none and the numerics velocity_coupling"),
        (PAIR + TWO_FLAGS, r"MuJoCo leaves out the velocity coupling velocity_coupling"),
    ],
)
def test_couplings_that_do_not_fit_are_refused(tmp_path: Path, custom: str, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        carts(tmp_path, custom)


def test_models_of_other_plants_are_refused(tmp_path: Path) -> None:
    plant = carts(tmp_path)
    with pytest.raises(PlantError, match=r"expected a model that came from plant 'carts'"):
        plant.forces(craft(tmp_path, np.eye(6)).model)
