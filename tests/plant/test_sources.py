"""One plant from a file, MJCF text, a specification and a compiled model."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.errors import PlantError
from invtrack.plant.loading import model_path
from invtrack.plant.plant import Plant
from invtrack.plant.variants import with_coupling_scaled, with_input_limits

PATH = model_path("two_disc")
OPTIONS: dict[str, Any] = {"inputs": ["motor"], "outputs": ["body:disc2:yaw"], "parameters": ["body:disc2:mass:scaled"]}
SOURCES = {
    "path": lambda: PATH,
    "text of a path": lambda: str(PATH),
    "MJCF text": PATH.read_text,
    "MjSpec": lambda: mujoco.MjSpec.from_file(str(PATH)),
    "MjModel": lambda: mujoco.MjModel.from_xml_path(str(PATH)),
}
UNNAMED = """
<mujoco>
  <worldbody><body><joint type="slide" axis="1 0 0"/><geom size=".1" mass="2"/><site/></body></worldbody>
  <tendon><fixed><joint joint="{joint}" coef="1"/></fixed></tendon>
</mujoco>"""


@pytest.mark.parametrize("source", SOURCES)
def test_every_source_gives_the_same_plant(source: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(PATH.parent)  # where the text looks for the file that it includes
    expected, plant = Plant.from_xml(PATH, **OPTIONS), Plant.from_xml(SOURCES[source](), **OPTIONS)
    assert plant.name == expected.name == "two_disc"
    assert (plant.inputs, plant.outputs, plant.states) == (expected.inputs, expected.outputs, expected.states)
    assert plant.parameter_values == expected.parameter_values
    changes = {"body:disc2:mass:scaled": 2.0}
    first, second = (invtrack.linearize(p, **changes) for p in (expected, plant))
    for name in "ABCD":
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    limited = with_coupling_scaled(with_input_limits(plant, {"motor": 0.5}), "velocity_coupling", 1.1)
    assert limited.input_limits.tolist() == [[-0.5, 0.5]]
    np.testing.assert_allclose(limited.couplings[0].K, 1.1 * expected.couplings[0].K)


def test_a_compiled_model_runs_and_changes_in_mid_run_but_cannot_be_compiled_again() -> None:
    plant = Plant.from_xml(mujoco.MjModel.from_xml_path(str(PATH)), **OPTIONS)
    model = invtrack.linearize(plant)
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 0.1, duration=4.0), tolerance=1e-3)
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
    change = invtrack.Change(2.0, **{"body:disc2:mass:scaled": 2.0})
    run = invtrack.simulate(plant, controller, timestep=2e-2, schedule=[change])
    assert run.status == "completed"
    with pytest.raises(PlantError, match=r"came as an MjModel, which MuJoCo cannot compile again; give Plant.from_xml its MJCF or"):
        plant.compiled_with({})
    again = Plant.from_xml(PATH, **OPTIONS)
    assert np.all(again.compiled_with(change.parameters).body_mass == plant.model_with(change.parameters).body_mass)


@pytest.mark.parametrize("kind", [mujoco.MjSpec, mujoco.MjModel])
def test_what_is_given_is_copied(kind: type) -> None:
    spec = mujoco.MjSpec.from_file(str(PATH))
    given = spec if kind is mujoco.MjSpec else spec.compile()
    plant = Plant.from_xml(given, **OPTIONS)
    before = invtrack.linearize(plant).A
    if kind is mujoco.MjSpec:
        assert not any("body:" in sensor.name for sensor in spec.sensors)
        given.body("disc2").mass *= 2
    else:
        given.body_mass[:] *= 2
        given.dof_damping[:] += 1
    np.testing.assert_array_equal(invtrack.linearize(plant).A, before)
    assert kind is mujoco.MjModel or not np.any(plant.compiled_with({}).body_mass != plant.model.body_mass)


def test_elements_without_a_name_go_by_kind_and_index() -> None:
    spec = mujoco.MjSpec.from_string(UNNAMED.format(joint="j").replace("<joint type", '<joint name="j" type'))
    spec.add_actuator(target="j", trntype=mujoco.mjtTrn.mjTRN_JOINT)
    spec.add_sensor(type=mujoco.mjtSensor.mjSENS_JOINTPOS, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname="j")
    everything = ["site:site 0:x", "sensor 0", "tendon:tendon 0", "body:body 1:yaw"]
    plant = Plant.from_xml(spec, inputs=["actuator 0"], outputs=["site:site 0:x"], measurements=everything)
    assert plant.at(qpos={"j": 0.7}).measurement_readings.values(plant.at(qpos={"j": 0.7}).new_data()).tolist() == [
        0.7,
        0.7,
        0.7,
        0,
    ]
    assert plant.inputs.names == ("actuator 0",)
    assert invtrack.linearize(plant).B[1, 0] == pytest.approx(0.5)
    limited = with_input_limits(plant, {"actuator 0": 3.0})
    assert limited.compiled_with({}).actuator_ctrlrange.tolist() == limited.model.actuator_ctrlrange.tolist() == [[-3.0, 3.0]]
    for name in ("0", "actuator 1", "actuator -1", "actuator ²", "joint 0"):
        with pytest.raises(PlantError, match=rf"no actuator named {name!r}; there are: actuator 0"):
            Plant.from_xml(spec, inputs=[name], outputs=["site:site 0:x"])


def test_a_name_of_the_file_comes_before_an_index() -> None:
    """An element that is really called "joint 0" is that one, wherever it stands."""
    text = """
<mujoco><worldbody><body>
  <joint name="first" type="slide" axis="1 0 0"/><joint name="joint 0" type="slide" axis="0 1 0"/><geom size=".1"/>
</body></worldbody><actuator><motor name="u" joint="first"/></actuator></mujoco>"""
    plant = Plant.from_xml(text, inputs=["u"], outputs=["joint:joint 0"])
    assert plant.operating_point.y0.shape == (1,)
    assert plant.at(qpos=[1.0, 2.0]).operating_point.y0.tolist() == [2.0]


@pytest.mark.parametrize(
    ("source", "message"),
    [
        ("<mujoco><boddy/></mujoco>", r"the MJCF text cannot be read: (.|\n)*boddy"),
        ('<mujoco><worldbody><body><joint name="x"/></body></worldbody></mujoco>', r"the MJCF text does not compile: .*mass"),
        (
            "nowhere.xml",
            r"there is no file nowhere.xml; give the path of an MJCF file, MJCF text, a mujoco.MjSpec or .*begins with '<'",
        ),
        ("mujoco " * 1000, r"there is no file a str; give the path of an MJCF file"),
        ("", r"expected the path of an MJCF file, MJCF text, a mujoco.MjSpec or a mujoco.MjModel, got ''"),
        (3, r"expected the path of an MJCF file, MJCF text, .* got 3"),
        (Path(), r"expected the path of an MJCF file"),
    ],
)
def test_what_is_no_source_is_refused(source: Any, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        Plant.from_xml(source, inputs=["u"], outputs=["y"])
