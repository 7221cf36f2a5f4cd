"""Units of controls, activations and actuator sensors against what MuJoCo does: forces that act, positions that servos hold."""

from __future__ import annotations

import re

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.plant.plant import Plant

BENCH = """
<mujoco model="bench">
  <option gravity="0 0 0"/>
  <worldbody>
    <site name="ground"/>
    <body><joint name="slide" type="slide" axis="1 0 0"/><geom size="0.1" mass="1"/><site name="block"/></body>
    <body pos="0 1 0"><joint name="hinge" axis="0 1 0"/><geom size="0.1" mass="1" pos="0.3 0 0"/></body>
    <body pos="0 2 0"><joint name="ball" type="ball"/><geom size="0.1" mass="1"/></body>
    <body name="craft" pos="0 3 0"><freejoint name="free"/><geom size="0.1" mass="1"/><site name="craft"/></body>
    <body pos="0 4 0">
      <joint name="slider" type="slide" axis="0 0 1"/><geom size="0.1" mass="1"/><site name="slider" zaxis="0 0 1"/>
    </body>
    <site name="crank" pos="0 4 1"/>
  </worldbody>
  <tendon>
    <fixed name="twist"><joint joint="hinge" coef="2"/></fixed>
    <fixed name="mixed"><joint joint="hinge" coef="1"/><joint joint="slide" coef="1"/></fixed>
    <spatial name="rope"><site site="ground"/><site site="craft"/></spatial>
  </tendon>
  <actuator>{}</actuator>
  <sensor>
    <actuatorpos name="length" actuator="a"/><actuatorvel name="speed" actuator="a"/><actuatorfrc name="force" actuator="a"/>
  </sensor>
</mujoco>"""


def bench(actuator: str, **options: object) -> Plant:
    return Plant.from_xml(
        BENCH.format(actuator), inputs=["a"], outputs=["joint:slide"], measurements=["length", "speed", "force"], **options
    )  # type: ignore[arg-type]


def parsed(unit: str) -> tuple[float, str]:
    """(10, "N") of "x10 N"."""
    match = re.fullmatch(r"(?:x([-+.e\d]+) )?(.+)", unit)
    assert match
    return float(match[1] or 1), match[2]


def force(plant: Plant, control: float, *, act: float | None = None) -> np.ndarray:
    """Generalized force of the actuator."""
    data = plant.new_data()
    data.ctrl[0] = control
    if act is not None:
        data.act[0] = act
    mujoco.mj_forward(plant.model, data)
    return np.array(data.qfrc_actuator)


@pytest.mark.parametrize(
    ("actuator", "unit", "dofs"),
    [
        ('<motor name="a" joint="slide"/>', "N", [0]),
        ('<motor name="a" joint="slide" gear="10"/>', "x10 N", [0]),
        ('<motor name="a" joint="slide" gear="-0.5"/>', "x0.5 N", [0]),
        ('<motor name="a" joint="hinge" gear="100"/>', "x100 N m", [1]),
        ('<general name="a" joint="hinge" gear="3" gainprm="4"/>', "x12 N m", [1]),
        ('<general name="a" joint="slide" gaintype="affine" gainprm="4 0 0" biastype="affine" biasprm="1 -2 -3"/>', "x4 N", [0]),
        ('<motor name="a" joint="ball" gear="0 3 4"/>', "x5 N m", [2, 3, 4]),
        ('<motor name="a" joint="free" gear="0 0 2 0 0 0"/>', "x2 N", [5, 6, 7]),
        ('<motor name="a" site="craft" gear="0 0 1 0 0 0.1"/>', "N", [5, 6, 7]),
        ('<motor name="a" site="craft" gear="1 0 0 0 0 0"/>', "N", [5, 6, 7]),
        ('<motor name="a" site="craft" gear="0 0 0 0 0.2 0"/>', "x0.2 N m", [8, 9, 10]),
        ('<position name="a" site="craft" kp="7" gear="0 0 1 0 0 0"/>', "x7 N", [5, 6, 7]),  # a site alone has no length to hold
        ('<motor name="a" cranksite="crank" slidersite="slider" cranklength="2" gear="3"/>', "x3 N", [11]),
        ('<cylinder name="a" joint="slide" area="0.02" timeconst="0"/>', "x0.02 N", [0]),
    ],
)
def test_a_motors_control_is_so_much_force_at_the_mechanism(actuator: str, unit: str, dofs: list[int]) -> None:
    plant = bench(actuator)
    assert plant.inputs.units == (unit,)
    state = {"act": 1.0} if plant.model.na else {}
    change = force(plant, 1.0, **state) - force(plant, 0.0, **({"act": 0.0} if state else {}))
    # The crank's rod is upright: it pushes the slider along with it; elsewhere the directions are those of joints.
    assert np.linalg.norm(change[dofs]) == pytest.approx(parsed(unit)[0], rel=1e-6)
    assert parsed(plant.measurements.units[2])[1] == parsed(unit)[1]


@pytest.mark.parametrize(
    ("actuator", "unit", "dof"),
    [
        ('<position name="a" joint="slide" kp="50"/>', "m", 0),
        ('<position name="a" joint="slide" kp="50" kv="3" gear="10"/>', "x0.1 m", 0),
        ('<position name="a" joint="hinge" kp="50" gear="-4"/>', "x0.25 rad", 1),
        ('<position name="a" joint="hinge" kp="50" timeconst="0.1"/>', "rad", 1),
        ('<position name="a" tendon="twist" kp="50" gear="2"/>', "x0.5 rad", 1),
        ('<position name="a" site="block" refsite="ground" kp="50" gear="5 0 0 0 0 0"/>', "x0.2 m", 0),
        ('<position name="a" joint="ball" kp="50" gear="2 0 0"/>', "x0.5 rad", 2),
    ],
)
def test_a_position_servo_holds_its_control(actuator: str, unit: str, dof: int) -> None:
    """The position, in the control's unit, at which no force is left; the tendon's length is twice the hinge's angle."""
    plant = bench(actuator)
    assert plant.inputs.units == (unit,)
    model, data, control = plant.model, plant.new_data(), 0.3
    held = control * parsed(unit)[0] * np.sign(model.actuator_gear[0, 0]) / (2 if "tendon" in actuator else 1)
    velocity = np.zeros(model.nv)
    velocity[dof] = held
    mujoco.mj_integratePos(model, data.qpos, velocity, 1.0)
    data.ctrl[0] = control
    data.act[:] = control
    mujoco.mj_forward(model, data)
    assert abs(data.qfrc_actuator[dof]) < 1e-12
    assert abs(force(plant, control, act=control if model.na else None)[dof]) > 1
    assert plant.measurements.units[0] == unit
    assert data.actuator_length[0] == pytest.approx(control)


@pytest.mark.parametrize(
    ("actuator", "unit"),
    [
        ('<velocity name="a" joint="slide" kv="5"/>', "m/s"),
        ('<velocity name="a" joint="slide" kv="5" gear="10"/>', "x0.1 m/s"),
        ('<intvelocity name="a" joint="slide" kp="5" gear="10" actrange="-9 9"/>', "x0.1 m/s"),
    ],
)
def test_a_velocity_servo_settles_at_its_control(actuator: str, unit: str) -> None:
    plant = bench(actuator)
    assert plant.inputs.units == (unit,)
    model = plant.model_with()
    model.dof_damping[0] = 30.0 if model.na else 0.0  # against what the position servo behind the integrator would swing
    data = mujoco.MjData(model)
    data.ctrl[0] = 0.3
    mujoco.mj_step(model, data, 5000)
    assert data.qvel[0] == pytest.approx(0.3 * parsed(unit)[0], rel=1e-3)
    assert plant.measurements.units[1] == unit


@pytest.mark.parametrize(
    ("actuator", "control", "activation"),
    [
        ('<general name="a" joint="slide" gear="3" dyntype="filter" dynprm="0.05"/>', "x3 N", "x3 N"),
        ('<general name="a" joint="slide" gear="3" dyntype="integrator"/>', "x3 N/s", "x3 N"),
        ('<position name="a" joint="hinge" kp="5" gear="4" timeconst="0.1"/>', "x0.25 rad", "x0.25 rad"),
        ('<intvelocity name="a" joint="hinge" kp="5" actrange="-9 9"/>', "rad/s", "rad"),
        ('<muscle name="a" joint="slide" lengthrange="0 1"/>', "1", "1"),
    ],
)
def test_activations_have_the_unit_of_what_the_gain_multiplies(actuator: str, control: str, activation: str) -> None:
    plant = bench(actuator)
    assert (plant.inputs.units, plant.coordinates.units[-1:]) == ((control,), (activation,))
    if "filter" in actuator or "integrator" in actuator:
        change = force(plant, 0.0, act=1.0) - force(plant, 0.0, act=0.0)
        assert change[0] == pytest.approx(parsed(activation)[0])


@pytest.mark.parametrize(
    "actuator",
    [
        '<motor name="a" tendon="mixed"/>',  # a length of radians and metres
        '<motor name="a" site="craft" gear="1 0 0 0 2 0"/>',  # a force and a torque across it
        '<damper name="a" joint="slide" kv="2" ctrlrange="0 1"/>',
        '<general name="a" joint="slide" dyntype="user" actdim="1"/>',
        '<motor name="a" joint="slide" gear="0"/>',
    ],
)
def test_a_unit_that_the_model_does_not_tell_is_left_open(actuator: str) -> None:
    assert bench(actuator).inputs.units == ("",)


def test_the_unit_reaches_the_warning_beforehand() -> None:
    plant = bench('<motor name="a" joint="slide" gear="10" ctrlrange="-1 1"/>', drop_states=STILL)
    model = invtrack.linearize(plant)
    assert model.B[1, 0] == pytest.approx(10)  # the mass is 1 kg: the control's unit of 10 N accelerates it by 10 m/s^2
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 10.0, duration=1.0))
    with pytest.warns(RuntimeWarning, match=r"a from -5\.774 to 5\.774 x10 N"):
        invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=1e-2)


STILL = [
    f"{name}{rate}"
    for name in ("hinge", *(f"ball.r{a}" for a in "xyz"), *(f"free.{r}{a}" for r in ("", "r") for a in "xyz"), "slider")
    for rate in ("", " velocity")
]
