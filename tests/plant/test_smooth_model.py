"""Dry friction and actuator delays: left out of linear models by name, whatever else the mechanism is."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import invtrack
from invtrack.errors import PlantError
from tests.plant.mechanisms import plant_of

# A pendulum on a slide: friction in both joints and along a tendon between them, a motor that acts 20 ms late, another at once.
ROUGH = """
<mujoco model="rough">
  <option gravity="0 0 -9.81" integrator="RK4"/>
  <worldbody>
    <body name="cart">
      <joint name="rail" type="slide" axis="1 0 0" damping="3" {rail}/>
      <inertial pos="0 0 0" mass="2" diaginertia="1 1 1"/>
      <body name="bob">
        <joint name="swing" axis="0 1 0" damping="0.1" {swing}/>
        <inertial pos="0 0 -0.6" mass="0.5" diaginertia="0.01 0.01 0.01"/>
      </body>
    </body>
  </worldbody>
  <tendon><fixed name="line" {line}><joint joint="rail" coef="1"/><joint joint="swing" coef="0.1"/></fixed></tendon>
  <actuator><motor name="push" joint="rail" {push}/><motor name="twist" joint="swing"/></actuator>
</mujoco>"""
LEFT_OUT = {
    "rail": ('frictionloss="0.3"', "dry friction of joint rail: 0.3 N"),
    "swing": ('frictionloss="0.02"', "dry friction of joint swing: 0.02 N m"),
    "line": ('frictionloss="0.1"', "dry friction of tendon line: 0.1"),
    "push": ('delay="0.02" nsample="50"', "delay of actuator push: 0.02 s"),
}


def rough(folder: Path, *parts: str, **options: object) -> invtrack.Plant:
    text = ROUGH.format(**{name: LEFT_OUT[name][0] if name in parts else "" for name in LEFT_OUT})
    return plant_of(folder, text, inputs=["push", "twist"], outputs=["joint:rail", "joint:swing"], **options)


@pytest.mark.parametrize("part", list(LEFT_OUT))
def test_each_is_left_out_by_name(tmp_path: Path, part: str) -> None:
    smooth, found = invtrack.linearize(rough(tmp_path)), invtrack.linearize(rough(tmp_path, part))
    assert smooth.left_out == ()
    assert found.left_out == (LEFT_OUT[part][1],)
    for name in "ABCD":
        np.testing.assert_allclose(getattr(found, name), getattr(smooth, name), atol=1e-9)


def test_names_go_with_the_model_wherever_it_goes(tmp_path: Path) -> None:
    plant = rough(tmp_path, "rail", "push", parameters={"loss": "joint:rail:frictionloss", "mass": "body:bob:mass"})
    model = invtrack.linearize(plant)
    both = (LEFT_OUT["rail"][1], LEFT_OUT["push"][1])
    assert model.left_out == both
    chosen = model.with_outputs(["joint:rail"]).with_inputs(["push"])
    assert chosen.left_out == both
    assert chosen.transformed(2 * np.eye(4)).left_out == both
    assert invtrack.linear.without_hidden_modes(chosen).left_out == both
    smoother = invtrack.linearize(plant, loss=0.1)
    switched = invtrack.SwitchedSystem([model, smoother], [1.0])
    assert switched.left_out == (*both, "dry friction of joint rail: 0.1 N")
    plan = invtrack.invert(model, invtrack.rest_to_rest([0.0, 0.0], [0.2, 0.0], duration=2.0))
    assert plan.remarks == (f"planned without what the linear model leaves out: {'; '.join(both)}",)
    invtrack.export_plan(plan, tmp_path / "plan.csv", rate=100.0)
    read = invtrack.read_plan(tmp_path / "plan.csv")
    assert read.model.left_out == both
    assert plan.remarks[0] in read.remarks


def test_friction_that_the_file_disables_is_none(tmp_path: Path) -> None:
    text = ROUGH.format(rail='frictionloss="0.3"', swing="", line="", push="").replace(
        'integrator="RK4"/>', 'integrator="RK4"><flag frictionloss="disable"/></option>'
    )
    plant = plant_of(tmp_path, text, inputs=["push", "twist"], outputs=["joint:rail", "joint:swing"])
    assert invtrack.linearize(plant).left_out == ()


def test_what_friction_alone_holds_is_no_equilibrium(tmp_path: Path) -> None:
    """5 mrad of tilt pull with 0.5 kg * 9.81 * 0.6 m * 0.005 = 0.0147 N m, less than the friction of 0.02 N m."""
    tilted = rough(tmp_path, "swing").at(qpos={"swing": 0.005})
    with pytest.raises(
        PlantError, match=r"no equilibrium without what .* leaves out \(dry friction of joint swing: 0.02 N m\): .*trim\("
    ):
        invtrack.linearize(tilted)
    assert invtrack.linearize(invtrack.trim(tilted).plant).left_out == (LEFT_OUT["swing"][1],)


def test_the_operating_point_of_a_delayed_actuator_is_what_it_holds(tmp_path: Path) -> None:
    plant = rough(tmp_path, "push").at(ctrl={"push": 4.0})
    assert plant.new_data().qacc[0] == pytest.approx(rough(tmp_path).at(ctrl={"push": 4.0}).new_data().qacc[0], rel=1e-12)
