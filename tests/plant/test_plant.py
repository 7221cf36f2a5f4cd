"""Plants: channels by name, operating points, refusals."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from invtrack.errors import PlantError
from invtrack.plant.plant import Plant
from tests.plant.mechanisms import BALL_PENDULUM, FREE_BODY, LAGGED_SLIDER, cantilever, hinge_pendulum, plant_of


def slider(folder: Path, mjcf: str = LAGGED_SLIDER, **options: Any) -> Plant:
    return plant_of(folder, mjcf, **{"inputs": ["drive"], "outputs": ["position"], **options})


def test_channels_of_the_cantilever() -> None:
    plant = cantilever()
    assert plant.name == "cantilever"
    assert (plant.inputs.names, plant.inputs.units) == (("base_force",), ("N",))
    assert (plant.outputs.names, plant.outputs.units) == (("tip_position",), ("m",))
    assert plant.states.names == ("base", "deflection", "rotation", "base velocity", "deflection velocity", "rotation velocity")
    assert plant.states.units == ("m", "m", "rad", "m/s", "m/s", "rad/s")
    assert plant.n_states == 6
    assert plant.parameter_values == {"tip_mass": 0.0}


def test_outputs_are_what_they_say(tmp_path: Path) -> None:
    outputs = ["joint:x", "joint:x:velocity", "site:mark:x", "site:mark:y", "place[0]", "place[1]", "position"]
    plant = slider(tmp_path, outputs=outputs)
    assert plant.outputs.names == tuple(outputs)
    assert plant.outputs.units == ("m", "m/s", "m", "m", "m", "m", "m")
    data = plant.at(qpos=[0.25], qvel=[-2.0]).new_data()
    assert plant.measure(data) == pytest.approx([0.25, -2.0, 0.25, 0.5, 0.25, 0.5, 0.25])


def test_activations_are_states(tmp_path: Path) -> None:
    plant = slider(tmp_path).at(qpos=[0.1], act=[0.4])
    assert plant.states.names == ("x", "x velocity", "drive activation")
    data = plant.new_data()
    data.qpos[:], data.qvel[:], data.act[:] = 0.3, 0.5, 0.1
    assert plant.state(data) == pytest.approx([0.2, 0.5, -0.3])


def test_ball_and_free_joints_have_named_components(tmp_path: Path) -> None:
    ball = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_x"], outputs=["site:bob:y"])
    assert ball.states.names[:4] == ("ball.rx", "ball.ry", "ball.rz", "ball.rx velocity")
    assert ball.states.units[2:4] == ("rad", "rad/s")
    assert ball.inputs.units == ("N m",)
    free = plant_of(tmp_path, FREE_BODY, inputs=["thrust"], outputs=["site:centre:z"])
    assert free.states.names[:6] == ("craft.x", "craft.y", "craft.z", "craft.rx", "craft.ry", "craft.rz")
    assert (free.n_states, free.states.units[5:7], free.inputs.units) == (12, ("rad", "m/s"), ("N",))


def test_units_can_be_overridden(tmp_path: Path) -> None:
    plant = slider(tmp_path, units={"drive": "V", "position": "mm", "drive activation": "A"})
    assert (plant.inputs.units, plant.outputs.units, plant.states.units) == (("V",), ("mm",), ("m", "m/s", "A"))


def test_operating_point_holds_everything_absolute(tmp_path: Path) -> None:
    point = slider(tmp_path).at(qpos=[0.1], act=[1.0], ctrl=[1.0]).operating_point
    assert point.x0 == pytest.approx([0.1, 0.0, 1.0])
    assert point.u0 == pytest.approx([1.0])
    assert point.y0 == pytest.approx([0.1])


def test_keyframe_is_the_operating_point(tmp_path: Path) -> None:
    plant = hinge_pendulum(tmp_path, keyframe="tilted")
    assert plant.operating_point.y0 == pytest.approx([0.4])
    assert hinge_pendulum(tmp_path).at(keyframe="tilted", ctrl=[2.0]).operating_point.u0 == pytest.approx([2.0])


def test_another_operating_point_leaves_the_first_alone(tmp_path: Path) -> None:
    plant = slider(tmp_path)
    plant.at(qpos=[5.0])
    assert plant.operating_point.y0 == pytest.approx([0.0])
    with pytest.raises(dataclasses.FrozenInstanceError):
        plant.source = ""  # type: ignore[misc]
    with pytest.raises(ValueError, match="read-only"):
        plant.configuration.qpos[:] = 1


def test_quaternions_of_the_operating_point_are_normalized(tmp_path: Path) -> None:
    plant = plant_of(tmp_path, BALL_PENDULUM, inputs=["torque_x"], outputs=["site:bob:y"]).at(qpos=[2, 0, 0, 0])
    assert plant.operating_point.x0[:4] == pytest.approx([1, 0, 0, 0])


def test_copies_do_not_touch_the_plant() -> None:
    plant = cantilever()
    plant.model_with({"tip_mass": 7.0}).opt.timestep = 1.0
    assert plant.parameter_values == {"tip_mass": 0.0}
    assert plant.model.opt.timestep == pytest.approx(1e-3)


def test_a_model_with_another_timestep_is_still_the_plants() -> None:
    plant = cantilever()
    model = plant.model_with()
    model.opt.timestep = 1e-4
    plant.apply(model, {"tip_mass": 1.0})
    assert plant.parameters["tip_mass"].read(model) == 1.0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"inputs": ["motor"]}, r"no actuator named 'motor'; there are: drive"),
        ({"inputs": []}, r"expected a list of distinct input names"),
        ({"inputs": "drive"}, r"expected a list of distinct input names"),
        ({"inputs": ["drive", "drive"]}, r"expected a list of distinct input names"),
        ({"inputs": ["drive[1]"]}, r"'drive\[1\]' is beyond the 1 component"),
        (
            {"outputs": ["tip"]},
            r"no sensor or state is named 'tip'; the sensors are: acceleration, place, position; the states are: x, x vel",
        ),
        ({"outputs": ["place"]}, r"sensor 'place' has 3 components; choose one, for instance 'place\[0\]'"),
        ({"outputs": ["place[3]"]}, r"'place\[3\]' is beyond the 3 component"),
        ({"outputs": ["joint:y"]}, r"no joint named 'y'; there are: x"),
        ({"outputs": ["joint:y:velocity"]}, r"no joint named 'y'; there are: x"),
        ({"outputs": ["site:end:x"]}, r"no site named 'end'; there are: mark"),
        (
            {"outputs": ["site:mark:w"]},
            r"no output is named 'site:mark:w'; of this element there are: site:mark:x, .*site:mark:roll",
        ),
        ({"units": {"drve": "V"}}, r"units are given for drve; the channels and parameters are: drive, drive activation"),
        ({"keyframe": "start"}, r"no keyframe named 'start'; there are: none"),
        ({"parameters": {"tip mass": None}}, r"'tip mass' cannot be written as a keyword"),
    ],
)
def test_bad_names_are_answered_with_the_known_ones(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        slider(tmp_path, **options)


@pytest.mark.parametrize(
    ("old", "new", "options", "message"),
    [
        ("</mujoco>", "<boddy/></mujoco>", {}, r"model.xml cannot be read as MJCF"),
        ('mass="2"', 'mass="0"', {}, r"does not compile.*mass"),
        (
            'joint="x"/>\n    <framepos',
            'joint="x" delay="0.01" nsample="20"/>\n    <framepos',
            {},
            r"sensors position have delays .*Sensor\(delay=0.01\)",
        ),
        ('<option gravity="0 0 0" integrator="RK4"/>', '<option><flag sensor="disable"/></option>', {}, r"disables sensors"),
        ("</sensor>", '<user name="own" dim="1"/></sensor>', {"outputs": ["own"]}, r"'own' is a user sensor"),
    ],
)
def test_unusable_models_are_refused(tmp_path: Path, old: str, new: str, options: dict[str, Any], message: str) -> None:
    text = LAGGED_SLIDER.replace(old, new)
    assert text != LAGGED_SLIDER
    with pytest.raises(PlantError, match=message):
        slider(tmp_path, text, **options)


def test_missing_file(tmp_path: Path) -> None:
    with pytest.raises(PlantError, match=r"there is no file .*nowhere.xml; give the path"):
        Plant.from_xml(tmp_path / "nowhere.xml", inputs=["u"], outputs=["y"])


def test_an_operating_point_by_the_names_of_joints_and_actuators(tmp_path: Path) -> None:
    free = plant_of(tmp_path, FREE_BODY, inputs=["thrust"], outputs=["site:centre:z"])
    assert free.at(qpos={"craft": [1, 2, 3, 2, 0, 0, 0]}, ctrl={"thrust": 4.0}).configuration.qpos.tolist() == [1, 2, 3, 1, 0, 0, 0]
    moved = slider(tmp_path).at(qpos={"x": 0.1}, qvel={"x": 2.0}).at(act={"drive": 0.4}, ctrl={"drive": [0.7]})
    assert moved.operating_point.x0 == pytest.approx([0.1, 2.0, 0.4])
    assert moved.operating_point.u0 == pytest.approx([0.7])
    for arrays, message in (
        ({"qpos": {"y": 1.0}}, r"no joint named 'y'; there are: x"),
        ({"ctrl": {"x": 1.0}}, r"no actuator named 'x'; there are: drive"),
        ({"qpos": {"x": [1.0, 2.0]}}, r"qpos of joint 'x' must hold 1 finite numbers, got"),
        ({"qvel": {"x": np.nan}}, r"qvel of joint 'x' must hold 1 finite numbers, got"),
    ):
        with pytest.raises(PlantError, match=message):
            slider(tmp_path).at(**arrays)


@pytest.mark.parametrize("arrays", [{"qpos": [1, 2]}, {"qvel": [np.nan]}, {"act": []}, {"ctrl": [1, 2]}])
def test_wrong_operating_points_are_refused(tmp_path: Path, arrays: dict[str, Any]) -> None:
    with pytest.raises(PlantError, match=rf"{next(iter(arrays))} must hold 1 finite numbers, got"):
        slider(tmp_path).at(**arrays)


def test_new_data_is_ready_to_read(tmp_path: Path) -> None:
    data = slider(tmp_path).at(qpos=[0.2]).new_data()
    assert isinstance(data, mujoco.MjData)
    assert data.qacc == pytest.approx([-30 * 0.2 / 2])
