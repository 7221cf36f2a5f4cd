"""Operating points and models about which there is no linear model, each with its reason."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from invtrack.errors import PlantError
from invtrack.plant.linearize import linearize
from tests.plant.mechanisms import BALL_PENDULUM, LAGGED_SLIDER, hinge_pendulum, plant_of

FLOOR_AND_LIMIT = """
<mujoco>
  <option gravity="0 0 -9.81"/>
  <worldbody>
    <geom name="floor" type="plane" size="1 1 1"/>
    <body name="ball" pos="0 0 {height}">
      <joint name="z" type="slide" axis="0 0 1" {joint}/>
      <geom name="shell" size="0.1" mass="1" {contact}/>
    </body>
  </worldbody>
  <tendon><fixed name="line" {tendon}><joint joint="z" coef="1"/></fixed></tendon>
  {equality}
  <actuator><motor name="lift" joint="z"/></actuator>
</mujoco>"""


def dropped(folder: Path, **parts: str) -> Any:
    text = FLOOR_AND_LIMIT.format(**{"height": "1", "joint": "", "contact": "", "tendon": "", "equality": "", **parts})
    return plant_of(folder, text, inputs=["lift"], outputs=["joint:z"]).at(ctrl=[9.81])


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"height": "0.099"}, r"contacts or limits are active at or near the operating point: contact of floor and shell"),
        ({"height": "0.10002"}, r"contact of floor and shell"),  # only once perturbed
        ({"joint": 'limited="true" range="0.001 1"'}, r"limit of joint z"),
        ({"tendon": 'limited="true" range="0.001 1"'}, r"limit of tendon line"),
        ({"tendon": 'stiffness="50" springlength="0 0.2"'}, r"not differentiable .* the rate of 'z velocity' with respect to 'z'"),
        ({"joint": 'springref="0"', "tendon": 'stiffness="50" springlength="-0.2 0"'}, r"jumps by 50 "),
    ],
)
def test_constraints_and_kinks(tmp_path: Path, parts: dict[str, str], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        linearize(dropped(tmp_path, **parts))


def test_clear_of_all_constraints_it_works(tmp_path: Path) -> None:
    assert linearize(dropped(tmp_path, joint='limited="true" range="-0.5 0.5"')).B[1, 0] == pytest.approx(1)


def test_nonequilibrium_is_named_with_its_rate(tmp_path: Path) -> None:
    with pytest.raises(PlantError, match=r"no equilibrium: .* swing velocity: -7\.6\d+ rad/s per s .*allow_nonequilibrium=True"):
        linearize(hinge_pendulum(tmp_path, keyframe="tilted"))


def test_steady_motion_is_no_equilibrium(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, LAGGED_SLIDER.replace("stiffness", "armature"), inputs=["drive"], outputs=["position"])
    moving = plant.at(qvel=[3.0], act=[0.7], ctrl=[0.7])  # 3 * 0.7 N against 0.7 * 3 N of damping
    with pytest.raises(PlantError, match=r"no equilibrium: its state changes at the rate x: 3 m per s \("):
        linearize(moving)


def test_activation_away_from_its_rest_is_no_equilibrium(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, LAGGED_SLIDER, inputs=["drive"], outputs=["position"]).at(ctrl=[1.0])
    with pytest.raises(PlantError, match=r"drive activation: 20 x3 N per s"):
        linearize(plant)


def test_equilibrium_may_depend_on_a_parameter(tmp_path: Path) -> None:
    plant = hinge_pendulum(tmp_path, parameters={"bob": "body:arm:mass"}).at(
        qpos=[0.4], ctrl=[1.2 * 9.81 * 0.5 * 0.3894183423086505]
    )
    linearize(plant)
    with pytest.raises(PlantError, match="no equilibrium"):
        linearize(plant, bob=2.0)


@pytest.mark.parametrize("ctrl", [1.0, -1.0, 1.5])
def test_saturated_controls(tmp_path: Path, ctrl: float) -> None:
    plant = hinge_pendulum(tmp_path, limit=1.0).at(ctrl=[ctrl])
    with pytest.raises(PlantError, match=rf"input 'torque' is {ctrl} .*ctrlrange \[-1.0, 1.0\], where it is clamped"):
        linearize(plant, allow_nonequilibrium=True)


def test_saturated_activation(tmp_path: Path) -> None:
    text = LAGGED_SLIDER.replace('dyntype="filter"', 'dyntype="filter" actlimited="true" actrange="-1 1"')
    plant = plant_of(tmp_path, text, inputs=["drive"], outputs=["position"]).at(qpos=[0.1], act=[1.0], ctrl=[1.0])
    with pytest.raises(PlantError, match=r"activation of actuator 'drive' is .* actrange \[-1.0, 1.0\]"):
        linearize(plant)


def test_spinning_ball_joint(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_x"], outputs=["site:bob:y"]).at(qvel=[0, 0, 1])
    with pytest.raises(PlantError, match="ball: a ball or free joint must be at rest"):
        linearize(plant, allow_nonequilibrium=True)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('integrator="RK4"', 'integrator="discrete"', r'with integrator="discrete" qacc is a step map'),
        ('dyntype="filter"', 'dyntype="filter" actearly="true"', r"actuators drive use the activation of the next step"),
        ('integrator="RK4"/>', '><flag sleep="enable"/></option>', r"sleeping bodies"),
    ],
)
def test_step_maps(tmp_path: Path, old: str, new: str, message: str) -> None:
    plant = plant_of(tmp_path, LAGGED_SLIDER.replace(old, new), inputs=["drive"], outputs=["position"])
    with pytest.raises(PlantError, match=message):
        linearize(plant)


@pytest.mark.parametrize("step", [0.0, -1e-3, 2.0, float("nan")])
def test_bad_steps(tmp_path: Path, step: float) -> None:
    with pytest.raises(PlantError, match="step must lie between 0 and 1"):
        linearize(hinge_pendulum(tmp_path), step=step)


def test_unknown_parameter(tmp_path: Path) -> None:
    with pytest.raises(PlantError, match="has no parameter 'tip_mass'; there are: none"):
        linearize(hinge_pendulum(tmp_path), tip_mass=3.0)


def test_parameters_named_like_options(tmp_path: Path) -> None:
    with pytest.raises(PlantError, match="cannot be called step"):
        linearize(hinge_pendulum(tmp_path, parameters={"step": "body:arm:mass"}))
