"""Equilibria of mechanisms against those known by hand."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.optimize

from invtrack.plant.equilibrium.trim import trim
from invtrack.plant.linearize import linearize
from invtrack.plant.plant import Plant
from tests.plant.loaded_mechanisms import (
    ARM_IN_UNITS,
    CART_POLE,
    GEARED,
    HOIST,
    LIMITED_SERVO,
    MUSCLES,
    QUADROTOR,
    ROTORS,
    SERVO_ARM,
    STOPPED_PENDULUM,
)
from tests.plant.mechanisms import BALL_PENDULUM, LAGGED_SLIDER, SPRINGS, hinge_pendulum, plant_of

G = 9.81
LOAD = 1.2 * G * 0.5  # [N m], of the pendulums held level


def servo_arm(folder: Path, *, shoulder: str = "", elbow: str = "", **options: Any) -> Plant:
    options = {"inputs": ["shoulder", "elbow"], "outputs": ["site:tip:x", "site:tip:z"], **options}
    return plant_of(folder, SERVO_ARM.format(shoulder=shoulder, elbow=elbow), **options)


def arm_load(q1: float, q2: float) -> np.ndarray:
    """Gravity's torque (2,) on the joints of the servo arm."""
    fore = 0.8 * G * 0.3 * np.cos(q1 + q2)
    return np.array([(1.5 + 0.8) * G * 0.4 * np.cos(q1) + fore, fore])


def quadrotor(folder: Path, *, height: float = 1.0, thrust: float = 5.0) -> Plant:
    outputs = ["site:front_left:z", "heading[0]", "heading[1]", "heading[2]"]
    return plant_of(folder, QUADROTOR.format(height=height, thrust=thrust), inputs=ROTORS, outputs=outputs)


def quaternion(rotation: Sequence[float]) -> np.ndarray:
    """Of a rotation vector [rad]."""
    angle = np.linalg.norm(rotation)
    return np.array([np.cos(angle / 2), *(np.sin(angle / 2) / angle * np.asarray(rotation))])


def axes(plant: Plant) -> np.ndarray:
    """The matrix whose columns are the axes of a free body."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, plant.configuration.qpos[3:7])
    return R.reshape(3, 3)


def stopped_pendulum(folder: Path, *, stops: str = "-3 3", actuators: str = "", friction: str = "") -> Plant:
    motors = actuators or '<motor name="torque" joint="swing"/>'
    names = {"inputs": ["first", "second"], "outputs": ["joint:swing", "site:end:z"]}
    names = names if actuators else {"inputs": ["torque"], "outputs": ["joint:swing"]}
    return plant_of(folder, STOPPED_PENDULUM.format(range=stops, friction=friction, actuators=motors), **names)


def arm_in_units(folder: Path, *, length: float, mass: float, time: float) -> Plant:
    """One mechanism in units of which `length` make a metre, `mass` a kilogram and `time` a second."""
    numbers = {
        "length": length,
        "mass": mass,
        "upper": 0.4 * length,
        "fore": 0.3 * length,
        "inertia": 0.02 * mass * length**2,
        "acceleration": G * length / time**2,
        "stiffness": 30 * mass / time**2,
        "torque": 5 * mass * (length / time) ** 2,
        "servo": 50 * mass * (length / time) ** 2,
    }
    text = ARM_IN_UNITS.format(**{name: repr(number) for name, number in numbers.items()})
    return plant_of(folder, text, inputs=["push", "servo"], outputs=["site:tip:x", "site:tip:z"])


@pytest.mark.parametrize("angle", [-2.5, -0.4, 0.0, 1e-3, 1.2, np.pi])
def test_torque_that_holds_a_pendulum(tmp_path: Path, angle: float) -> None:
    """u = m g l sin q, and about it q'' = -(g / l) cos q dq."""
    point = trim(hinge_pendulum(tmp_path), outputs={"joint:swing": angle})
    assert point.controls["torque"] == pytest.approx(LOAD * np.sin(angle), rel=1e-12, abs=1e-12)
    assert point.positions["swing"] == pytest.approx(angle, rel=1e-12, abs=1e-15)
    assert point.largest_residual < 1e-12
    assert point.open_directions == 0
    assert linearize(point.plant).A[1, 0] == pytest.approx(-G / 0.5 * np.cos(angle), rel=1e-6)


@pytest.mark.parametrize(
    ("start", "angle"), [(0.1, np.arcsin(0.5)), (2.8, np.pi - np.arcsin(0.5)), (-3.3, -np.pi - np.arcsin(0.5))]
)
def test_angle_at_which_a_torque_holds_a_pendulum_is_the_nearest(tmp_path: Path, start: float, angle: float) -> None:
    point = trim(hinge_pendulum(tmp_path).at(qpos=[start]), controls={"torque": 0.5 * LOAD})
    assert point.positions["swing"] == pytest.approx(angle, rel=1e-12)


def test_what_is_not_given_stays_where_it_is(tmp_path: Path) -> None:
    """The posture, if controls can hold it at all; and an equilibrium is its own."""
    point = trim(hinge_pendulum(tmp_path, keyframe="tilted").at(qpos=[0.4], qvel=[3.0]))
    assert point.positions["swing"] == 0.4
    assert point.controls["torque"] == pytest.approx(LOAD * np.sin(0.4), rel=1e-12)
    assert point.open_directions == 1
    again = trim(point.plant)
    assert again.controls == pytest.approx(point.controls, rel=1e-14)
    assert not np.any(point.plant.configuration.qvel)


def test_servos_sag(tmp_path: Path) -> None:
    """kp (setpoint - z) = m g."""
    plant = plant_of(tmp_path, HOIST, inputs=["servo"], outputs=["joint:z"])
    assert trim(plant, controls={"servo": 0.3}).outputs["joint:z"] == pytest.approx(0.3 - 2 * G / 400, rel=1e-12)
    assert trim(plant, outputs={"joint:z": 0.3}).controls["servo"] == pytest.approx(0.3 + 2 * G / 400, rel=1e-12)


@pytest.mark.parametrize("given", [{"shoulder": 0.3, "elbow": -0.8}, {"shoulder": -1.0, "elbow": 2.0}])
def test_servo_arm_at_given_joints_and_under_given_setpoints(tmp_path: Path, given: dict[str, float]) -> None:
    plant, stiffness = servo_arm(tmp_path), np.array([120.0, 60.0])
    q = np.array(list(given.values()))
    point = trim(plant, positions=given)
    assert list(point.controls.values()) == pytest.approx(q + arm_load(*q) / stiffness, rel=1e-11)
    sagged = trim(plant.at(qpos=q), controls=given)
    found = np.array(list(sagged.positions.values()))
    assert stiffness * (q - found) == pytest.approx(arm_load(*found), rel=1e-9)


def test_equilibrium_of_an_arm_stays_where_it_is_when_simulated(tmp_path: Path) -> None:
    """Its tip is put where the law of cosines says, and ten seconds of MuJoCo change nothing."""
    point = trim(servo_arm(tmp_path), outputs={"site:tip:x": 0.5, "site:tip:z": 0.1})
    q2 = np.arccos((0.5**2 + 0.1**2 - 0.4**2 - 0.3**2) / (2 * 0.4 * 0.3))
    assert abs(point.positions["elbow"]) == pytest.approx(q2, rel=1e-10)
    model, data = point.plant.model_with(), point.plant.new_data()
    mujoco.mj_step(model, data, nstep=5000)
    assert data.qpos == pytest.approx(point.plant.configuration.qpos, abs=1e-9)


def test_stretched_arm_bends(tmp_path: Path) -> None:
    """At the start the wanted output is stationary: no joint moves the tip along the arm."""
    point = trim(servo_arm(tmp_path), outputs={"site:tip:x": 0.5})
    assert point.outputs["site:tip:x"] == pytest.approx(0.5, abs=1e-12)
    assert point.largest_residual < 1e-8


def test_of_many_postures_the_nearest(tmp_path: Path) -> None:
    """An independent method finds no posture nearer to the present one, with the tip as high as wanted."""
    plant = servo_arm(tmp_path).at(qpos=[0.5, -1.1])
    point = trim(plant, outputs={"site:tip:z": 0.25})
    start = np.array([0.5, -1.1])
    height = {"type": "eq", "fun": lambda q: 0.4 * np.sin(q[0]) + 0.3 * np.sin(q[0] + q[1]) - 0.25}
    nearest = scipy.optimize.minimize(lambda q: np.sum((q - start) ** 2), start, method="SLSQP", constraints=[height], tol=1e-14).x
    assert list(point.positions.values()) == pytest.approx(nearest, abs=1e-6)
    assert point.open_directions == 1


def test_redundant_motors_share_the_load(tmp_path: Path) -> None:
    """Controls are measured by the acceleration that they make: each motor takes half of it, whatever its gear."""
    motors = '<motor name="first" joint="swing"/><motor name="second" joint="swing" gear="4"/>'
    point = trim(stopped_pendulum(tmp_path, actuators=motors), positions={"swing": 0.7})
    assert point.controls["first"] == pytest.approx(LOAD * np.sin(0.7) / 2, rel=1e-9)
    assert point.controls["second"] == pytest.approx(LOAD * np.sin(0.7) / 8, rel=1e-9)


def test_four_rotors_each_carry_a_quarter(tmp_path: Path) -> None:
    point = trim(quadrotor(tmp_path))
    assert list(point.controls.values()) == pytest.approx([1.2 * G / 4] * 4, rel=1e-12)
    assert point.plant.configuration.qpos == pytest.approx([0, 0, 1, 1, 0, 0, 0], abs=1e-15)


def test_tilted_quadrotor_is_levelled_by_the_shortest_way(tmp_path: Path) -> None:
    start = quadrotor(tmp_path).at(qpos=[0.1, -0.2, 1.3, *quaternion([0.3, 0.4, 0.7])])
    point = trim(start)
    before, after = axes(start), axes(point.plant)
    assert after[:, 2] == pytest.approx([0, 0, 1], abs=1e-9)
    turned = np.arccos((np.trace(before.T @ after) - 1) / 2)
    assert turned == pytest.approx(np.arccos(before[2, 2]), abs=1e-7)  # no more than its tilt
    assert point.plant.configuration.qpos[:3] == pytest.approx([0.1, -0.2, 1.3], abs=1e-12)
    assert list(point.controls.values()) == pytest.approx([1.2 * G / 4] * 4, rel=1e-9)


def test_quadrotor_with_a_given_yaw(tmp_path: Path) -> None:
    start = quadrotor(tmp_path).at(qpos=[0, 0, 1, *quaternion([0.3, 0.4, 0.7])])
    point = trim(start, outputs={"heading[1]": np.sin(1.1), "site:front_left:z": 2.0})
    assert axes(point.plant)[:, 0] == pytest.approx([np.cos(1.1), np.sin(1.1), 0], abs=1e-9)
    assert point.plant.configuration.qpos[2] == pytest.approx(2.0, abs=1e-9)
    assert np.linalg.norm(point.plant.configuration.qpos[3:]) == pytest.approx(1.0, abs=1e-15)


def test_whole_pose_of_a_free_joint(tmp_path: Path) -> None:
    pose = [0.3, 0.2, 1.5, *quaternion([0, 0, 0.9])]
    point = trim(quadrotor(tmp_path), positions={"frame": pose})
    assert point.plant.configuration.qpos == pytest.approx(pose, abs=1e-15)
    assert point.positions["frame.rz"] == pytest.approx(0.9)
    turned = trim(quadrotor(tmp_path), positions={"frame.rz": 0.9, "frame.x": 0.3})
    assert axes(turned.plant) == pytest.approx(axes(point.plant), abs=1e-12)
    assert turned.positions["frame.x"] == 0.3


@pytest.mark.parametrize(("start", "tilt"), [(0.2, 0.0), (2.6, np.pi), (-2.9, -np.pi)])
def test_cart_pole_has_two_equilibria(tmp_path: Path, start: float, tilt: float) -> None:
    plant = plant_of(tmp_path, CART_POLE, inputs=["push"], outputs=["joint:x"]).at(qpos=[0, start])
    point = trim(plant, outputs=[0.7])
    assert point.positions == pytest.approx({"x": 0.7, "tilt": tilt}, abs=1e-9)
    assert point.controls["push"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(("x", "y"), [(0.3, -0.2), (0.0, 0.5)])
def test_ball_joint(tmp_path: Path, x: float, y: float) -> None:
    """The bob is turned about a horizontal axis; in that axis's frame torques are m g y and -m g x."""
    plant = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_x", "torque_y"], outputs=["site:bob:x", "site:bob:y"])
    point = trim(plant, outputs=[x, y])
    assert list(point.controls.values()) == pytest.approx([1.5 * G * y, -1.5 * G * x], abs=1e-9)
    axis = np.array([y, -x, 0.0]) / np.hypot(x, y)
    turned = np.arcsin(np.hypot(x, y) / 0.8) * axis
    assert list(point.positions.values()) == pytest.approx(turned, abs=1e-9)
    given = trim(plant, positions={"ball": 3 * quaternion([0.6, 0, 0])})
    assert given.controls == pytest.approx({"torque_x": 1.5 * G * 0.8 * np.sin(0.6), "torque_y": 0.0}, abs=1e-9)


def test_filtered_and_integrating_actuators(tmp_path: Path) -> None:
    """At rest a filter's activation is its control, and an integrator's control is zero, whatever it holds."""
    plant = plant_of(tmp_path, LAGGED_SLIDER, inputs=["drive"], outputs=["position"])
    point = trim(plant, outputs={"position": 0.2})
    assert point.activations == pytest.approx({"drive activation": 30 * 0.2 / 3}, rel=1e-12)
    assert point.controls == pytest.approx({"drive": 30 * 0.2 / 3}, rel=1e-12)
    assert trim(plant, controls=[2.5]).outputs["position"] == pytest.approx(3 * 2.5 / 30, rel=1e-12)
    text = LAGGED_SLIDER.replace('dyntype="filter" dynprm="0.05"', 'dyntype="integrator"')
    holding = trim(plant_of(tmp_path, text, inputs=["drive"], outputs=["position"]), outputs={"position": 0.2})
    assert holding.activations == pytest.approx({"drive activation": 30 * 0.2 / 3}, rel=1e-12)
    assert holding.controls["drive"] == pytest.approx(0.0, abs=1e-12)


def test_muscles_only_pull(tmp_path: Path) -> None:
    """The lever is held up by the upper muscle alone, and both excitations stay within [0, 1]."""
    plant = plant_of(tmp_path, MUSCLES, inputs=["flexor", "extensor"], outputs=["joint:lever", "site:upper_end:z"])
    point = trim(plant, outputs={"joint:lever": 0.1})
    assert point.largest_residual < 1e-9
    assert 0 < point.controls["flexor"] < 1
    assert point.controls["extensor"] == 0
    assert point.at_limits == ("extensor",)
    assert point.activations["flexor activation"] == pytest.approx(point.controls["flexor"], rel=1e-12)
    assert point.plant.new_data().qfrc_actuator == pytest.approx([1 * G * 0.15 * np.cos(0.1)], rel=1e-9)


def test_springs_and_tendons(tmp_path: Path) -> None:
    """The swing angle at which the potential energy is stationary for a given place of the cart."""
    plant = plant_of(tmp_path, SPRINGS, inputs=["push"], outputs=["joint:x"])
    mass, (cx, _, cz) = plant.model.body_mass[2], plant.model.body_ipos[2]
    rest = np.deg2rad(0.3)

    def torque(swing: float, x: float) -> float:
        lever = -cx * np.cos(swing) - cz * np.sin(swing)  # d(height)/d(swing) of the centre of mass
        return float(2 * (swing - rest) - 0.5 * link(x, swing) + mass * G * lever)

    def link(x: float, swing: float) -> float:
        """Force of the tendon, which is slack where the cart is at 0 and the swing at its spring's rest."""
        return 4 * (x - 0.5 * (swing - rest))

    point = trim(plant, outputs={"joint:x": 0.1})
    swing = scipy.optimize.brentq(torque, -1.0, 1.0, args=(0.1,), xtol=1e-14)
    assert point.positions["swing"] == pytest.approx(swing, rel=1e-9)
    assert point.controls["push"] == pytest.approx(5 * 0.1 + link(0.1, swing), rel=1e-9)


def test_equality_constraints(tmp_path: Path) -> None:
    """Through a gear of two the drive takes twice the lever's torque (virtual work), at the angle to which the gear yields."""
    point = trim(plant_of(tmp_path, GEARED, inputs=["drive"], outputs=["joint:lever"]), outputs=[0.4])
    assert point.controls["drive"] == pytest.approx(2 * 0.5 * G * 0.3 * np.cos(0.4), rel=1e-8)
    assert point.positions["wheel"] == pytest.approx(0.2, abs=1e-3)


def test_after_a_change_of_a_parameter(tmp_path: Path) -> None:
    """With the same output the torque grows with the mass; with the same torque the angle follows."""
    plant = trim(hinge_pendulum(tmp_path, parameters={"bob": "body:arm:mass"}), outputs=[0.4]).plant
    same_output = trim(plant, outputs=plant.operating_point.y0, bob=2.0)
    assert same_output.controls["torque"] == pytest.approx(2.0 * G * 0.5 * np.sin(0.4), rel=1e-12)
    same_control = trim(plant, controls=plant.operating_point.u0, bob=2.0)
    assert same_control.positions["swing"] == pytest.approx(np.arcsin(1.2 / 2.0 * np.sin(0.4)), rel=1e-12)
    for point in (same_output, same_control):
        assert linearize(point.plant, **point.parameters).parameters == {"bob": 2.0}


def test_held_by_a_stop(tmp_path: Path) -> None:
    """It leans on the stop with what the torque does not carry; without a stop in the way none is mentioned."""
    point = trim(stopped_pendulum(tmp_path, stops="0.5 2").at(qpos=[0.7]), controls={"torque": 0.2 * LOAD})
    assert point.held_by == ("limit of joint swing",)
    assert point.positions["swing"] == pytest.approx(0.5, abs=0.01)
    assert point.largest_residual < 1e-6
    assert "held by limit of joint swing" in str(point)
    assert trim(stopped_pendulum(tmp_path, stops="0.5 2").at(qpos=[0.7])).held_by == ()


def test_standing_on_the_floor(tmp_path: Path) -> None:
    point = trim(quadrotor(tmp_path, height=0.0299), controls=[0, 0, 0, 0])
    assert point.held_by == ("contact of floor and hull",)
    data = point.plant.new_data()
    assert np.sum(data.efc_force) == pytest.approx(1.2 * G, rel=1e-9)  # a pyramid's edges add up to the normal force


def test_dry_friction_is_left_out(tmp_path: Path) -> None:
    plant = stopped_pendulum(tmp_path, friction='frictionloss="1"')
    point = trim(plant, outputs=[0.4])
    assert point.controls["torque"] == pytest.approx(LOAD * np.sin(0.4), rel=1e-12)
    assert point.largest_residual < 1e-9  # and with friction it is one, too


@pytest.mark.parametrize(("length", "mass", "time"), [(1e3, 1e3, 1.0), (1e-3, 1.0, 1.0), (1.0, 1e-3, 1e3), (1e2, 1e3, 1e-1)])
def test_units_do_not_matter(tmp_path: Path, length: float, mass: float, time: float) -> None:
    """Of the many equilibria with the tip at one height, and of those under given controls, it is the same in all units."""
    force = mass * length / time**2
    plants = {
        (1.0, 1.0): arm_in_units(tmp_path, length=1.0, mass=1.0, time=1.0),
        (length, force): arm_in_units(tmp_path, length=length, mass=mass, time=time),
    }
    found = []
    for (metre, newton), plant in plants.items():
        raised = trim(plant, outputs={"site:tip:z": 0.2 * metre})
        pushed = trim(plant, controls={"push": 3.0 * newton, "servo": 0.2})
        found.append(
            [
                raised.controls["push"] / newton,
                raised.controls["servo"],
                *(point.positions["x"] / metre for point in (raised, pushed)),
                *(point.positions[joint] for point in (raised, pushed) for joint in ("a", "b")),
            ]
        )
    assert found[1] == pytest.approx(found[0], rel=1e-10, abs=1e-12)
    assert found[0][3] == pytest.approx(0.1, rel=1e-10)  # 3 N on a spring of 30 N/m


def test_ranges_of_joints_are_kept(tmp_path: Path) -> None:
    """Of the arm's two postures only one is within the elbow's range, on the far side."""
    plant = servo_arm(tmp_path, elbow='limited="true" range="0.2 3"').at(qpos=[0.0, 0.3])
    point = trim(plant, outputs={"site:tip:x": 0.4, "site:tip:z": -0.2})
    assert 0.2 < point.positions["elbow"] < 3
    mirrored = trim(servo_arm(tmp_path).at(qpos=[0.0, -0.3]), outputs={"site:tip:x": 0.4, "site:tip:z": -0.2})
    assert point.positions["elbow"] == pytest.approx(-mirrored.positions["elbow"], rel=1e-9)


def test_table(tmp_path: Path) -> None:
    point = trim(servo_arm(tmp_path, inputs=["shoulder"], outputs=["site:tip:z"]), outputs={"site:tip:z": 0.1})
    lines = str(point).splitlines()
    rows = {tuple(line.split()[:2]): line.split()[2:] for line in lines[2:]}
    assert rows["output", "site:tip:z"] == ["0.1", "m", "given"]
    assert rows["position", "elbow"][1:] == ["rad", "solved"]
    assert rows["control", "elbow"] == ["0", "rad", "held"]
    assert len({line.index(word) for line, word in zip(lines[2:], ["site", "shoulder", "elbow", "shoulder"], strict=False)}) == 1
    assert repr(point).startswith("TrimPoint(equilibrium of 'servo arm': ")
    assert "\n" not in repr(point)


@pytest.mark.parametrize("limits", [{"servo": 'forcerange="-40 40"'}, {"joint": 'actuatorfrcrange="-40 40"'}])
@pytest.mark.parametrize("angle", [0.1, 0.5, 1.5])
def test_a_stiff_servo_is_found_its_setpoint_however_far_it_has_to_go(limits: dict[str, str], angle: float) -> None:
    mjcf = LIMITED_SERVO.format(**{"joint": "", "servo": "", **limits})
    plant = Plant.from_xml(mjcf, inputs=["servo"], outputs=["joint:hinge"])
    point = trim(plant, positions={"hinge": angle})  # from 0.17 rad on it pushes with all its force at the start
    assert point.controls["servo"] == pytest.approx(angle - G * 0.3 * np.cos(angle) / 230, rel=1e-9)
    assert linearize(point.plant).n_states == 2


def test_a_servo_that_pushes_with_all_its_force_may_hold_an_equilibrium() -> None:
    mjcf = LIMITED_SERVO.format(joint="", servo='forcerange="-2 2"')
    plant = Plant.from_xml(mjcf, inputs=["servo"], outputs=["joint:hinge"])
    point = trim(plant, controls={"servo": -1.0})
    assert G * 0.3 * np.cos(point.outputs["joint:hinge"]) == pytest.approx(2.0, rel=1e-7)
