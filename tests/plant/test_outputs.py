"""Outputs by name: what they read, about where they count angles, and what a run writes down of them."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import invtrack
from invtrack.errors import PlantError
from invtrack.plant.plant import Plant
from tests.plant.mechanisms import HINGE_PENDULUM, LAGGED_SLIDER
from tests.simulation.reference_loop import stepped

# A free body that carries a tilted site on a slide with a filtered motor, and a pendulum on a ball; some of it without names.
CRAFT = """
<mujoco model="craft">
  <option gravity="0 0 0" integrator="{integrator}" timestep="0.004"/>
  <worldbody>
    <site name="mark" pos="0.5 -0.2 0.3"/>
    <body name="hull" pos="0 0 1">
      <freejoint name="hull"/>
      <inertial pos="0.05 0 0" mass="3" diaginertia="0.4 0.5 0.6"/>
      <site name="a:tip" pos="0.4 0.1 0" euler="40 50 60"/>
      <body pos="0 0 0.2">
        <joint type="slide" axis="0 0 1" stiffness="30" damping="1"/>
        <inertial pos="0 0 0" mass="0.5" diaginertia="0.1 0.1 0.1"/>
        <site pos="0.1 0 0"/>
        <body name="bob" pos="0 0 0.1">
          <joint name="swing" type="ball" damping="0.1"/>
          <inertial pos="0 0 -0.3" mass="0.2" diaginertia="0.01 0.01 0.01"/>
        </body>
      </body>
    </body>
  </worldbody>
  <tendon><spatial name="rope"><site site="mark"/><site site="a:tip"/></spatial></tendon>
  <actuator>
    <motor name="thrust" site="a:tip" gear="0 0 1 0 0 0.1"/>
    <general joint="hull" gear="1 0.5 0 0.2 0.3 0.1" dyntype="filter" dynprm="0.1"/>
  </actuator>
  <sensor>
    <framepos name="hull" objtype="xbody" objname="hull"/>
    <framepos name="tip" objtype="site" objname="a:tip"/>
    <framequat name="attitude" objtype="site" objname="a:tip"/>
    <framequat name="heading" objtype="xbody" objname="hull"/>
    <framepos name="gap" objtype="site" objname="a:tip" reftype="site" refname="mark"/>
    <tendonpos name="length" tendon="rope"/>
    <ballquat name="swing" joint="swing"/>
    <ballangvel name="spin" joint="swing"/>
  </sensor>
  <keyframe><key name="banked" qpos="0 0 1  0.9 0.1 -0.3 0.3  0.02  0.9 0.2 0.3 0.1"/></keyframe>
</mujoco>"""
ALL = [
    *(f"body:hull:{c}" for c in ("x", "y", "z", "yaw", "pitch", "roll")),
    *(f"site:a:tip:{c}" for c in ("x", "y", "z", "yaw", "pitch", "roll")),
    "distance:a:tip:mark",
    "tendon:rope",
    *(f"joint:hull:{c}{rate}" for rate in ("", ":velocity") for c in ("x", "y", "z", "rx", "ry", "rz")),
    *(f"joint:swing:{c}{rate}" for rate in ("", ":velocity") for c in ("rx", "ry", "rz")),
    "joint:joint 1",
    "joint:joint 1:velocity",
    "activation:actuator 1",
    "site:site 2:y",
    "body:body 2:z",
    *(f"{sensor}[{i}]" for sensor, n in (("hull", 3), ("tip", 3), ("attitude", 4), ("heading", 4), ("gap", 3)) for i in range(n)),
    "length",
    *(f"{sensor}[{i}]" for sensor, n in (("swing", 4), ("spin", 3)) for i in range(n)),
]


def craft(outputs: list[str], *, n_outputs: int = 2, integrator: str = "RK4", **options: Any) -> Plant:
    """All of these are measured, and the first of them are the plant's outputs."""
    return Plant.from_xml(
        CRAFT.format(integrator=integrator),
        inputs=["thrust", "actuator 1"],
        outputs=outputs[:n_outputs],
        measurements=outputs,
        keyframe="banked",
        **options,
    )


def measured(plant: Plant, data: mujoco.MjData) -> dict[str, float]:
    return dict(zip(plant.measurements.names, plant.measurement_readings.values(data).tolist(), strict=True))


def moved(plant: Plant, seed: int = 0, size: float = 0.4) -> mujoco.MjData:
    """Data at a random state near the operating point."""
    rng, data = np.random.default_rng(seed), plant.new_data()
    mujoco.mj_integratePos(plant.model, data.qpos, size * rng.normal(size=plant.model.nv), 1.0)
    data.qvel[:], data.act[:] = rng.normal(size=plant.model.nv), rng.normal()
    mujoco.mj_forward(plant.model, data)
    return data


def rotation(wxyz: Any) -> Rotation:
    return Rotation.from_quat(np.roll(wxyz, -1))


def sensed(values: dict[str, float], name: str, size: int) -> np.ndarray:
    return np.array([values[f"{name}[{i}]"] for i in range(size)])


def assert_consistent(values: dict[str, float], start: dict[str, float]) -> None:
    """Expressions against MuJoCo's own sensors of the same quantities, and against scipy's rotations."""
    for frame, place, attitude in (("body:hull", "hull", "heading"), ("site:a:tip", "tip", "attitude")):
        np.testing.assert_allclose([values[f"{frame}:{axis}"] for axis in "xyz"], sensed(values, place, 3), rtol=0, atol=1e-14)
        turn = rotation(sensed(start, attitude, 4)).inv() * rotation(sensed(values, attitude, 4))
        angles = [values[f"{frame}:{angle}"] for angle in ("yaw", "pitch", "roll")]
        np.testing.assert_allclose(angles, turn.as_euler("ZYX"), rtol=0, atol=1e-13)
    assert values["distance:a:tip:mark"] == pytest.approx(float(np.linalg.norm(sensed(values, "gap", 3))), rel=1e-13)
    assert values["tendon:rope"] == pytest.approx(values["length"], rel=1e-14)
    np.testing.assert_allclose([values[f"joint:hull:{axis}"] for axis in "xyz"], sensed(values, "hull", 3), rtol=0, atol=1e-14)
    for joint, quat in (("hull", "heading"), ("swing", "swing")):
        turn = rotation(sensed(start, quat, 4)).inv() * rotation(sensed(values, quat, 4))
        np.testing.assert_allclose([values[f"joint:{joint}:r{axis}"] for axis in "xyz"], turn.as_rotvec(), rtol=0, atol=1e-13)
    spin = [values[f"joint:swing:r{axis}:velocity"] for axis in "xyz"]
    np.testing.assert_allclose(spin, sensed(values, "spin", 3), rtol=0, atol=1e-14)


def test_outputs_read_what_they_say() -> None:
    plant = craft(ALL)
    start = measured(plant, plant.new_data())
    for seed in range(5):
        data = moved(plant, seed)
        values = measured(plant, data)
        assert_consistent(values, start)
        assert values["joint:joint 1"] == data.qpos[7]
        assert values["joint:joint 1:velocity"] == data.qvel[6]
        assert values["activation:actuator 1"] == data.act[0]
        assert values["site:site 2:y"] == data.site_xpos[2, 1]
        assert values["body:body 2:z"] == data.xpos[2, 2]


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
def test_a_run_writes_down_all_outputs_at_the_same_instant(integrator: str) -> None:
    """MuJoCo leaves its arrays at different instants of a step; in every row all outputs belong to the row's state."""
    plant = craft(ALL, n_outputs=len(ALL), integrator=integrator)
    start, rng = measured(plant, plant.new_data()), np.random.default_rng(2)
    run = stepped(plant, 0.2 * rng.normal(size=plant.n_states), rng.normal(size=(20, 2)), timestep=1e-3)
    reference = plant.new_data()
    for i, row in enumerate(run.y):
        reference.qpos[:] = run.qpos[i]
        reference.qvel[:], reference.act[:] = np.split(run.x[i, plant.model.nv :], [plant.model.nv])
        mujoco.mj_forward(plant.model, reference)
        expected = plant.output_readings.values(reference)
        np.testing.assert_allclose(row, expected, rtol=0, atol=1e-13)
        values = dict(zip(plant.outputs.names, row.tolist(), strict=True))
        assert_consistent(values, start)


def test_small_angles_are_the_tangent_coordinates_of_a_free_body() -> None:
    """Yaw, pitch, roll of the hull and its rotation vector agree to first order, and the linear model has both exactly."""
    angles = [f"body:hull:{angle}" for angle in ("roll", "pitch", "yaw")]
    vector = [f"joint:hull:r{axis}" for axis in "xyz"]
    model = invtrack.linearize(craft([*angles, *vector]), allow_nonequilibrium=True)
    expected = np.zeros((3, model.n_states))
    expected[:, 3:6] = np.eye(3)
    assert model.measurement is not None
    np.testing.assert_allclose(model.measurement.C, np.vstack([expected, expected]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(model.measurement.y0, 0, atol=1e-15)


def test_angles_count_from_the_keyframe_wherever_the_operating_point_is() -> None:
    """So that the outputs of models about several operating points are the same quantities."""
    plant = craft(["body:hull:yaw", "joint:hull:rz", "site:a:tip:pitch"])
    data = moved(plant, 1)
    there = plant.at(qpos=data.qpos, qvel=np.zeros(plant.model.nv))
    np.testing.assert_array_equal(there.measurement_readings.values(data), plant.measurement_readings.values(data))
    assert there.operating_point.y0 == pytest.approx(plant.measurement_readings.values(data)[:2], abs=1e-15)
    assert abs(there.operating_point.y0[0]) > 1e-2


def test_every_state_is_an_output_by_its_name() -> None:
    plant = craft(["site:mark:x"])
    names = list(plant.states.names)
    assert len(names) == 21
    outputs = craft(names)
    assert outputs.measurements.units == plant.states.units
    data = moved(outputs, 3)
    absolute = np.zeros(len(names))
    absolute[:3], absolute[6], absolute[-1] = outputs.configuration.qpos[:3], outputs.configuration.qpos[7], 0
    np.testing.assert_allclose(outputs.measurement_readings.values(data), outputs.state(data) + absolute, rtol=0, atol=1e-15)


def test_a_sensor_comes_before_a_state_of_the_same_name() -> None:
    text = LAGGED_SLIDER.replace('<jointpos name="position" joint="x"/>', '<jointvel name="x" joint="x"/>')
    plant = Plant.from_xml(text, inputs=["drive"], outputs=["x"], measurements=["x", "joint:x"])
    assert plant.measurements.units == ("m/s", "m")


def test_a_pendulum_follows_a_body_angle_through_a_run() -> None:
    """Pitch of the arm is its hinge's angle: the same plan and the same run by either name."""
    text = HINGE_PENDULUM.format(integrator="RK4", timestep=1e-3, limit=10.0)
    runs = {}
    for output in ("joint:swing", "body:arm:pitch", "swing"):
        plant = Plant.from_xml(text, inputs=["torque"], outputs=[output])
        model = invtrack.linearize(plant)
        plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 0.05, duration=1.0))
        controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
        runs[output] = invtrack.simulate(plant, controller, timestep=2e-3)
        assert invtrack.max_error(runs[output]) < 1e-4
    for name in ("body:arm:pitch", "swing"):
        np.testing.assert_allclose(runs[name].output.values, runs["joint:swing"].output.values, rtol=0, atol=1e-11)


def test_a_run_follows_a_yaw_over_several_turns() -> None:
    """A turntable by 9 rad: the yaw of what stands on it is its hinge's angle throughout."""
    text = """
<mujoco><option integrator="RK4"/><worldbody><body name="table" euler="20 30 40"><joint name="turn" axis="0 0 1" damping="0.1"/>
<geom type="cylinder" size="0.5 0.1" mass="2"/><site name="guest" pos="0.3 0 0"/></body></worldbody>
<actuator><motor name="drive" joint="turn"/></actuator></mujoco>"""
    plant = Plant.from_xml(text, inputs=["drive"], outputs=["site:guest:yaw"], measurements=["joint:turn", "site:guest:yaw"])
    model = invtrack.linearize(plant)
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 9.0, duration=2.0))
    for controller in (
        invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0)),
        invtrack.OutputFeedbackController(
            plan, invtrack.lqr(model, Q=1.0, R=1.0), invtrack.KalmanFilter(input_noise=1e-3, measurement_noise=1e-3), period=0.02
        ),
    ):
        run = invtrack.simulate(plant, controller, timestep=1e-2)
        np.testing.assert_allclose(run.output.values[:, 0], run.state.values[:, 0], rtol=0, atol=1e-12)
        assert invtrack.max_error(run) < 1e-3


@pytest.mark.parametrize(
    ("output", "qpos", "message"),
    [
        ("body:arm:yaw", np.pi / 2, "has pitched by a quarter turn from the reference configuration"),
        ("distance:end:pin", 0.0, "is 0, where a distance has a kink"),
    ],
)
def test_where_an_output_is_not_smooth_there_is_no_linear_model(output: str, qpos: float, message: str) -> None:
    text = HINGE_PENDULUM.format(integrator="RK4", timestep=1e-3, limit=10.0)
    text = text.replace("<worldbody>", '<worldbody><site name="pin" pos="0 0 -0.5"/>')
    plant = Plant.from_xml(text, inputs=["torque"], outputs=[output]).at(qpos=[qpos])
    with pytest.raises(PlantError, match=message):
        invtrack.linearize(plant, allow_nonequilibrium=True)


@pytest.mark.parametrize(
    ("output", "message"),
    [
        ("hull", r"sensor 'hull' has 3 components; choose one, for instance 'hull\[0\]'"),
        (
            "nothing",
            r"no sensor or state is named 'nothing'; the sensors are: attitude, .*; the states are: hull.x, .* An output is",
        ),
        ("joint:hull", r"of this element there are: joint:hull:x, .*joint:hull:rz:velocity"),
        ("joint:joint 1:x", r"of this element there are: joint:joint 1, joint:joint 1:velocity"),
        ("joint:elbow", r"no joint named 'elbow'; there are: hull, joint 1, swing"),
        ("body:hull:w", r"of this element there are: body:hull:x, .*body:hull:roll"),
        ("body:2:x", r"no body named '2'; there are: world, hull, body 2, bob"),
        ("site:site 1:x", r"no site named 'site 1'; there are: mark, a:tip, site 2"),
        ("activation:thrust", r"actuator 'thrust' has no activation; those that have one are: actuator 1"),
        ("activation:nothing", r"no actuator named 'nothing'; there are: thrust, actuator 1"),
        ("activation:actuator 1[1]", r"beyond the 1 component"),
        ("distance:mark", r'does not name two sites as "distance:SITE:SITE"; the sites are: mark, a:tip, site 2'),
        ("distance:mark:mark", r"distance of a site from itself"),
        ("tendon:wire", r"no tendon named 'wire'; there are: rope"),
    ],
)
def test_what_is_no_output_is_answered_with_those_there_are(output: str, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        craft([output])


def test_angles_of_a_diverging_run_do_no_harm() -> None:
    text = HINGE_PENDULUM.format(integrator="Euler", timestep=1e-3, limit=1e9).replace('damping="0.3"', 'damping="-900"')
    plant = Plant.from_xml(text, inputs=["torque"], outputs=["body:arm:yaw"], measurements=["body:arm:pitch", "body:arm:yaw"])
    assert "QACC" in stepped(plant, np.array([0.1, 1.0]), np.zeros((3000, 1)), timestep=1e-3).cause
