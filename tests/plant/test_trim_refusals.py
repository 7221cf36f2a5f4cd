"""Equilibria that do not exist, each refused with its reason, and advice that leads on when it is followed to the letter."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import invtrack
from invtrack.errors import PlantError
from invtrack.plant.equilibrium.trim import trim
from invtrack.plant.linearize import linearize
from invtrack.plant.variants import with_input_limits
from tests.plant.loaded_mechanisms import CART_POLE, LIMITED_SERVO, QUADROTOR, ROTORS, SERVO_ARM
from tests.plant.mechanisms import FREE_BODY, LAGGED_SLIDER, SPRINGS, hinge_pendulum, plant_of


def servo_arm(folder: Path, *, shoulder: str = "", **options: Any) -> invtrack.Plant:
    options = {"inputs": ["shoulder", "elbow"], "outputs": ["site:tip:x", "site:tip:z"], **options}
    return plant_of(folder, SERVO_ARM.format(shoulder=shoulder, elbow=""), **options)


def quadrotor(folder: Path, **options: Any) -> invtrack.Plant:
    outputs = ["site:front_left:z", "heading[0]", "heading[1]", "heading[2]"]
    return plant_of(folder, QUADROTOR.format(**{"height": 1.0, "thrust": 5.0, **options}), inputs=ROTORS, outputs=outputs)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"outputs": {"tip": 1.0}}, r"outputs: there is no 'tip'; there are: site:tip:x, site:tip:z"),
        ({"positions": {"wrist": 1.0}}, r"positions: there is no 'wrist'; there are: shoulder, elbow"),
        ({"controls": {"wrist": 1.0}}, r"controls: there is no 'wrist'; there are: shoulder, elbow"),
        ({"free": ["wrist"]}, r"free: there is no 'wrist'; there are: shoulder, elbow"),
        ({"outputs": [1.0]}, r"outputs must be finite, one number for each of \['site:tip:x', 'site:tip:z'\]"),
        ({"positions": {"elbow": [1.0, 2.0]}}, r"position 'elbow' must be one number, got an array of shape \(2,\)"),
        ({"positions": {"elbow": float("nan")}}, r"position 'elbow' must be a finite number"),
        ({"positions": {"shoulder": 0.6}}, r"position 'shoulder' is given as 0\.6, beyond the joint's range \[-0\.5, 0\.5\]"),
        ({"controls": {"elbow": 0.0}, "free": ["elbow"]}, r"control 'elbow' is given twice, or both given and free"),
        ({"load": 1.0}, r"plant 'servo arm' has no parameter 'load'; there are: none"),
        ({"tolerance": 0.0}, r"tolerance must lie between 0 and 1"),
        ({"outputs": {"site:tip:x": 0.8}}, r"site:tip:x = 0\.8 m is out of reach, the nearest found is site:tip:x = 0\.7 m"),
        ({"outputs": [0.62, 0.4]}, r"no posture is found in which site:tip:x = 0\.62 m, site:tip:z = 0\.4 m hold together"),
        ({"outputs": {"site:tip:z": 0.6}}, r"site:tip:z = 0\.6 m would take position shoulder = \S+ rad \(range"),
        (
            {"outputs": [-0.1, 0.6]},
            r"site:tip:x = -0\.1 m, site:tip:z = 0\.6 m would take position shoulder = \S+ rad \(range \[-0\.5, 0\.5\]\)",
        ),
    ],
)
def test_what_an_arm_cannot_do(tmp_path: Path, given: dict[str, Any], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        trim(servo_arm(tmp_path, shoulder='limited="true" range="-0.5 0.5"'), **given)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"frame": [0, 0, 1]}, r"position 'frame' must be \(x, y, z\) \[m\] and a quaternion \(w, x, y, z\), 7 finite numbers"),
        ({"frame": [0, 0, 1, 0, 0, 0, 0]}, r"position 'frame' must be"),
        ({"frame": [0, 0, 1, 1, 0, 0, 0], "frame.rz": 0.1}, r"position 'frame.rz' is given twice"),
        ({"frame.yaw": 0.1}, r"no 'frame.yaw'; there are: frame, frame\.x, frame\.y, frame\.z, frame\.rx, frame\.ry, frame\.rz"),
        ({"frame.rx": 0.3}, r"the nearest point to one leaves the rates"),  # tilted, it cannot but fly away
    ],
)
def test_what_a_quadrotor_cannot_do(tmp_path: Path, given: dict[str, Any], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        trim(quadrotor(tmp_path), positions=given)


def test_outputs_that_contradict_what_is_given(tmp_path: Path) -> None:
    with pytest.raises(PlantError, match=r"nothing that is free acts on joint:swing = 0\.5 rad at rest, and 0\.4 is asked for"):
        trim(hinge_pendulum(tmp_path), outputs=[0.4], positions={"swing": 0.5})


def test_velocities_are_zero(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, SPRINGS, inputs=["push"], outputs=["joint:x:velocity"])
    with pytest.raises(PlantError, match=r"nothing that is free acts on joint:x:velocity = 0 m/s at rest, and 1 is asked for"):
        trim(plant, outputs=[1.0])


def test_saturation_says_what_it_would_take(tmp_path: Path) -> None:
    """m g l sin 0.4 = 2.29 N m; with a range as wide as that, it is the equilibrium."""
    plant = hinge_pendulum(tmp_path, limit=1.0)
    with pytest.raises(PlantError, match=r"it would take control torque = 2\.29212 N m \(range \[-1, 1\]\)") as refusal:
        trim(plant, outputs=[0.4])
    needed = float(re.findall(r"torque = (\S+)", str(refusal.value))[0])
    point = trim(with_input_limits(plant, {"torque": 1.001 * needed}), outputs=[0.4])
    assert point.controls["torque"] == pytest.approx(needed, rel=1e-5)


def test_rotors_that_are_too_weak(tmp_path: Path) -> None:
    with pytest.raises(PlantError, match=r"control front_left = 2\.943 \S*\s?\(range \[0, 2\]\), control rear_left = 2\.943"):
        trim(quadrotor(tmp_path, thrust=2.0))


def test_saturated_activation(tmp_path: Path) -> None:
    text = LAGGED_SLIDER.replace('dyntype="filter"', 'dyntype="filter" actlimited="true" actrange="-1 1"')
    plant = plant_of(tmp_path, text, inputs=["drive"], outputs=["position"])
    with pytest.raises(PlantError, match=r"it would take activation drive activation = 2 x3 N \(range \[-1, 1\]\)"):
        trim(plant, outputs=[0.2])


def test_nothing_lifts_a_free_body(tmp_path: Path) -> None:
    heavy = FREE_BODY.replace('gravity="0 0 0"', 'gravity="0 0 -9.81"')
    plant = plant_of(tmp_path, heavy, inputs=["thrust"], outputs=["site:centre:z"])
    with pytest.raises(PlantError, match=r"craft\.z velocity: -9\.81 m/s per s, and no control or position that is free acts on"):
        trim(plant, controls={"thrust": 0.0})
    assert trim(plant).controls["thrust"] == pytest.approx(3 * 9.81)


def test_what_hangs_above_a_floor_is_told_to_start_on_it() -> None:
    mjcf = """
    <mujoco>
      <worldbody>
        <geom name="floor" type="plane" size="1 1 1"/>
        <body name="sledge" pos="0 0 0.5">
          <joint name="x" type="slide" axis="1 0 0"/>
          <joint name="z" type="slide" axis="0 0 1"/>
          <geom name="runner" type="box" size="0.1 0.1 0.05" mass="2"/>
        </body>
      </worldbody>
      <actuator><motor name="push" joint="x"/></actuator>
    </mujoco>"""
    plant = invtrack.Plant.from_xml(mjcf, inputs=["push"], outputs=["body:sledge:x"])
    with pytest.raises(PlantError, match=r"acts on z velocity\. .*; or start where it touches .* \(plant\.at\(qpos=\.\.\.\)\)"):
        trim(plant)
    assert trim(plant.at(qpos={"z": -0.451})).held_by == ("contact of floor and runner",)
    alone = invtrack.Plant.from_xml(
        mjcf.replace('<geom name="floor" type="plane" size="1 1 1"/>', ""), inputs=["push"], outputs=["body:sledge:x"]
    )
    with pytest.raises(PlantError, match=r"or an actuator for it$"):
        trim(alone)


def test_actuators_that_are_no_inputs(tmp_path: Path) -> None:
    plant = servo_arm(tmp_path, inputs=["shoulder"], outputs=["joint:shoulder"])
    given: dict[str, Any] = {"outputs": [0.3], "positions": {"elbow": 0.5}}
    with pytest.raises(PlantError, match=r"actuators that are no inputs hold their controls, and it would take control") as refusal:
        trim(plant, **given)
    advice = re.findall(r"free=\[.*?\]", str(refusal.value))[0]
    assert advice == "free=['elbow']"
    point = eval(f"trim(plant, **given, {advice})")
    assert point.positions == pytest.approx({"shoulder": 0.3, "elbow": 0.5})


def test_a_contact_that_pushes_away(tmp_path: Path) -> None:
    """Within the floor, rotors that only lift do not hold it."""
    with pytest.raises(PlantError, match=r"only where contact of floor and hull pushes it away; start from a configuration"):
        trim(quadrotor(tmp_path), positions={"frame": [0, 0, 0.02, 1, 0, 0, 0]})


def test_a_pole_does_not_stand_aslant(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, CART_POLE, inputs=["push"], outputs=["joint:x"])
    with pytest.raises(PlantError, match=r"the nearest point to one leaves the rates tilt velocity: \S+ rad/s per s"):
        trim(plant, positions={"tilt": 1.0})


def test_parameters_named_like_options(tmp_path: Path) -> None:
    plant = hinge_pendulum(tmp_path, parameters={"outputs": "body:arm:mass"})
    with pytest.raises(PlantError, match="parameters cannot be called outputs, which are options of trim"):
        trim(plant)


@pytest.mark.parametrize("values", [{}, {"bob": 2.5}])
def test_the_refusal_of_linearize_leads_to_an_equilibrium(tmp_path: Path, values: dict[str, float]) -> None:
    plant = hinge_pendulum(tmp_path, keyframe="tilted", parameters={"bob": "body:arm:mass"})
    with pytest.raises(PlantError, match=r"no equilibrium: .*\(equilibrium_tolerance=1e-06\)") as refusal:
        linearize(plant, **values)
    advice = re.findall(r"invtrack\.trim\(.*?\)\.plant", str(refusal.value))[0]
    model = linearize(eval(advice, {"invtrack": invtrack, "plant": plant}), **values)
    mass = values.get("bob", 1.2)
    assert model.operating_point.u0 == pytest.approx([mass * 9.81 * 0.5 * 0.3894183423086505], rel=1e-12)


@pytest.mark.parametrize(
    ("limits", "where"),
    [
        ({"servo": 'forcerange="-2 2"'}, r"actuator servo, beyond its forcerange \[-2, 2\]"),
        ({"joint": 'actuatorfrcrange="-2 2"'}, r"joint hinge, beyond its actuatorfrcrange \[-2, 2\]"),
    ],
)
def test_a_force_beyond_its_range_is_named(limits: dict[str, str], where: str) -> None:
    plant = invtrack.Plant.from_xml(
        LIMITED_SERVO.format(**{"joint": "", "servo": "", **limits}), inputs=["servo"], outputs=["joint:hinge"]
    )
    with pytest.raises(PlantError, match=rf"it would take -2\.81156 of {where}"):  # -9.81 * 0.3 * cos(0.3)
        trim(plant, positions={"hinge": 0.3})
    assert trim(plant, positions={"hinge": 1.0}).largest_residual < 1e-6  # 1.59 is within
