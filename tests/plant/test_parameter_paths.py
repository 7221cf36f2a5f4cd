"""Every kind of parameter by its path, against models compiled afresh: by the plant, and from MJCF that states the value."""

from __future__ import annotations

import math
import re
from typing import Any

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.errors import PlantError
from invtrack.plant.plant import Plant
from invtrack.plant.quantities import QUANTITIES

# Something of everything, some of it without a name; the angles of the file are degrees.
WORKSHOP = """
<mujoco model="workshop">
  <option timestep="0.001"/>
  <worldbody>
    <geom name="floor" type="plane" size="9 9 1" friction="0.4 0.01 0.001"/>
    <body name="crate" pos="0 0 0.0999"><freejoint name="crate"/><geom type="box" size=".1 .1 .1" mass="2" friction="0.1"/></body>
    <body name="arm" pos="2 0 2">
      <joint name="turn" axis="0 1 0" stiffness="3" damping="0.2" frictionloss="0.1" armature="0.01" springref="20" ref="5"/>
      <inertial pos="0.3 0 0" mass="1.5" fullinertia="0.1 0.2 0.25 0.01 0.01 0.01"/>
      <body name="hand" pos="0.6 0 0">
        <joint name="reach" type="slide" axis="1 0 0" stiffness="7" damping="0.3" frictionloss=".2" armature=".05" springref="0.1"/>
        <geom type="capsule" size="0.05 0.1" mass="0.4" contype="0" conaffinity="0"/>
        <site name="palm"/>
        <body pos="0.1 0 0"><joint type="ball" damping="0.03"/><geom size="0.04" mass="0.2" contype="0" conaffinity="0"/></body>
      </body>
    </body>
    <site name="hook" pos="2 1 3"/>
  </worldbody>
  <tendon>
    <spatial name="rope" stiffness="5" damping="0.4" frictionloss="0.1" armature="0.02" springlength="1.1">
      <site site="hook"/><site site="palm"/>
    </spatial>
    <fixed name="belt" stiffness="2" damping="0.1" springlength="0.3"><joint joint="turn" coef="1.5"/></fixed>
  </tendon>
  <actuator>
    <position name="reach" joint="reach" kp="30" kv="4"/>
    <velocity name="speed" joint="reach" kv="3" gear="0.5"/>
    <motor name="winch" tendon="rope" gear="3"/>
    <motor name="jet" site="palm" gear="0 0 1 0 0 0.1"/>
    <general joint="turn" gainprm="2" biastype="affine" biasprm="0.1 -0.5 -0.2"/>
  </actuator>
</mujoco>"""

# Path, value, and the edit of the file that states the same; without one, the plant's own compilation alone is compared with.
CASES: list[tuple[str, float, str, str]] = [
    ("body:hand:mass", 0.9, "", ""),
    ("body:hand:mass:scaled", 0.8, 'size="0.05 0.1" mass="0.4"', 'size="0.05 0.1" mass="0.8"'),
    ("body:body 4:mass:scaled", 0.5, 'size="0.04" mass="0.2"', 'size="0.04" mass="0.5"'),
    ("body:arm:inertia[1]", 0.21, "", ""),
    ("body:hand:inertia[1]", 0.0025, "", ""),
    ("joint:turn:stiffness", 4.5, 'stiffness="3"', 'stiffness="4.5"'),
    ("joint:turn:damping", 0.7, 'stiffness="3" damping="0.2"', 'stiffness="3" damping="0.7"'),
    ("joint:turn:frictionloss", 0.0, 'frictionloss="0.1" armature="0.01"', 'armature="0.01"'),
    ("joint:turn:armature", 0.3, 'armature="0.01"', 'armature="0.3"'),
    ("joint:turn:springref", math.radians(-35), 'springref="20"', 'springref="-35"'),
    ("joint:reach:springref", -0.2, 'springref="0.1"', 'springref="-0.2"'),
    ("joint:joint 3:damping", 0.5, 'type="ball" damping="0.03"', 'type="ball" damping="0.5"'),
    ("tendon:rope:stiffness", 9.0, 'stiffness="5"', 'stiffness="9"'),
    ("tendon:rope:damping", 1.4, 'damping="0.4"', 'damping="1.4"'),
    ("tendon:rope:frictionloss", 0.3, 'frictionloss="0.1" armature="0.02"', 'frictionloss="0.3" armature="0.02"'),
    ("tendon:rope:armature", 0.2, 'armature="0.02"', 'armature="0.2"'),
    ("actuator:winch:gear", -4.0, 'gear="3"', 'gear="-4"'),
    ("actuator:jet:gear[2]", 2.5, 'gear="0 0 1 0 0 0.1"', 'gear="0 0 2.5 0 0 0.1"'),
    ("actuator:actuator 4:gain", -3.0, 'gainprm="2"', 'gainprm="-3"'),
    ("actuator:actuator 4:bias[1]", -0.9, 'biasprm="0.1 -0.5 -0.2"', 'biasprm="0.1 -0.9 -0.2"'),
    ("actuator:reach:kp", 55.0, 'kp="30"', 'kp="55"'),
    ("actuator:reach:kv", 6.0, 'kv="4"', 'kv="6"'),
    ("actuator:speed:kv", 8.0, 'kv="3"', 'kv="8"'),
    ("geom:floor:friction", 0.9, 'friction="0.4 0.01 0.001"', 'friction="0.9 0.01 0.001"'),
]


def workshop(*parameters: str, mjcf: str = WORKSHOP) -> Plant:
    return Plant.from_xml(mjcf, inputs=["winch"], outputs=["joint:reach"], parameters=parameters)


def assert_same_model(first: mujoco.MjModel, second: mujoco.MjModel, *, rtol: float = 0.0) -> None:
    """Every array of both, also what MuJoCo derives from others."""
    names = [name for name in dir(second) if isinstance(getattr(second, name), np.ndarray) and not name.startswith("_")]
    assert len(names) > 100
    for name in names:
        expected = getattr(second, name)
        if expected.dtype.kind == "f":
            np.testing.assert_allclose(getattr(first, name), expected, rtol=rtol, atol=1e-15, err_msg=name)
        else:
            np.testing.assert_array_equal(getattr(first, name), expected, err_msg=name)


def acceleration(model: mujoco.MjModel) -> np.ndarray:
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    data.qpos[7:9], data.qvel[:], data.ctrl[:] = [0.3, 0.1], rng.normal(size=model.nv), rng.normal(size=model.nu)
    mujoco.mj_forward(model, data)
    return np.array(data.qacc)


@pytest.mark.parametrize(("path", "value", "old", "new"), CASES, ids=[case[0] for case in CASES])
def test_the_model_is_that_of_a_file_with_the_value(path: str, value: float, old: str, new: str) -> None:
    plant = workshop(path)
    changed = plant.model_with({path: value})
    assert plant.parameters[path].read(changed) == pytest.approx(value, rel=1e-15)
    assert_same_model(changed, plant.compiled_with({path: value}), rtol=1e-13)
    if old:
        text = WORKSHOP.replace(old, new)
        assert text != WORKSHOP
        assert_same_model(changed, mujoco.MjModel.from_xml_string(text), rtol=1e-12)
    assert np.max(np.abs(acceleration(changed) - acceleration(plant.model))) > 1e-4


def test_every_kind_of_parameter_is_among_the_cases() -> None:
    bare = {re.sub(r"\[\d\]$", "", path) for path, *_ in CASES}
    assert {(path.split(":")[0], path.split(":", 2)[2]) for path in bare} >= {
        (kind, name) for kind, quantities in QUANTITIES.items() for name in quantities
    }


def test_all_at_once_in_either_order_and_back() -> None:
    values = {path: value for path, value, *_ in CASES if "scaled" not in path}
    plant = workshop(*values)
    for chosen in (values, dict(reversed(values.items()))):
        assert_same_model(plant.model_with(chosen), plant.compiled_with(chosen), rtol=1e-13)
    model = plant.model_with(values)
    plant.apply(model, plant.parameter_values)
    assert_same_model(model, plant.model)


@pytest.mark.parametrize(
    ("path", "unit"),
    [
        ("body:hand:mass", "kg"),
        ("body:arm:inertia[0]", "kg m^2"),
        ("joint:turn:armature", "kg m^2"),
        ("joint:reach:armature", "kg"),
        ("joint:reach:frictionloss", "N"),
        ("joint:turn:springref", "rad"),
        ("joint:crate:damping", ""),
        ("joint:joint 3:damping", "N m s/rad"),
        ("tendon:rope:damping", "N s/m"),
        ("tendon:belt:stiffness", "N m/rad"),
        ("actuator:reach:kp", "N/m"),
        ("actuator:speed:kv", "x0.25 N s/m"),
        ("geom:floor:friction", "1"),
        ("geom:floor:friction[1]", "m"),
    ],
)
def test_units(path: str, unit: str) -> None:
    assert workshop(path).parameter_channels.units == (unit,)


def test_what_the_compiler_derives_from_others_stays_as_it_was() -> None:
    """Rest lengths of tendons and dampings of servos that the file leaves to the compiler."""
    text = (
        WORKSHOP.replace(' springlength="1.1"', "")
        .replace(' springlength="0.3"', "")
        .replace('kp="30" kv="4"', 'kp="30" dampratio="1"')
    )
    values = {"joint:turn:springref": 0.9, "actuator:reach:kp": 50.0, "body:hand:mass": 2.0}
    plant = workshop(*values, mjcf=text)
    model = plant.model_with(values)
    assert_same_model(model, plant.compiled_with(values), rtol=1e-13)
    np.testing.assert_array_equal(model.tendon_lengthspring, plant.model.tendon_lengthspring)
    assert model.actuator_biasprm[0, 2] == plant.model.actuator_biasprm[0, 2] < 0


def test_the_length_range_of_a_muscle_stays_as_it_was() -> None:
    """It is measured by MuJoCo's compiler along the tendon, in units of the gear."""
    text = """
<mujoco>
  <worldbody>
    <site name="top" pos="0 0 0.5"/>
    <body name="arm">
      <joint name="turn" axis="0 1 0" range="-60 60" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.5 0 -0.2" size="0.03" mass="1"/><site name="grip" pos="0.2 0 0"/>
    </body>
  </worldbody>
  <tendon><spatial name="sinew"><site site="top"/><site site="grip"/></spatial></tendon>
  <actuator><muscle name="flexor" tendon="sinew"/></actuator>
</mujoco>"""
    values = {"body:arm:mass:scaled": 7.0, "actuator:flexor:gear": 2.0}
    plant = Plant.from_xml(text, inputs=["flexor"], outputs=["tendon:sinew"], parameters=list(values))
    assert np.diff(plant.model.actuator_lengthrange)[0] > 0.1
    assert_same_model(plant.model_with(values), plant.compiled_with(values), rtol=1e-13)


def test_springs_from_a_time_constant_can_be_changed() -> None:
    text = WORKSHOP.replace(
        'type="slide" axis="1 0 0" stiffness="7" damping="0.3"', 'type="slide" axis="1 0 0" springdamper="0.1 1"'
    )
    values = {"joint:reach:stiffness": 11.0}
    plant = workshop(*values, mjcf=text)
    assert plant.parameter_values["joint:reach:stiffness"] > 50
    assert_same_model(plant.model_with(values), plant.compiled_with(values), rtol=1e-13)
    assert plant.model_with(values).dof_damping[7] == plant.model.dof_damping[7] > 1


@pytest.mark.parametrize(
    ("path", "message"),
    [
        ("hand", r"no parameter is called 'hand'; a parameter is one of: body:NAME:mass, .*geom:NAME:friction"),
        ("body:hand", r"'body:hand' names no quantity; there are: body:hand:mass, body:hand:mass:scaled, body:hand:inertia"),
        ("body:nothing:mass", r"has no body named 'nothing'; there are: world, crate, arm, hand, body 4"),
        ("joint:elbow:damping", r"has no joint named 'elbow'; there are: crate, turn, reach, joint 3"),
        ("joint:joint 2:damping", r"has no joint named 'joint 2'; there are: .*, joint 3"),
        ("actuator:4:gear", r"has no actuator named '4'; there are: reach, speed, winch, jet, actuator 4"),
        ("joint:turn:mass", r"of this joint there are: joint:turn:stiffness, joint:turn:damping"),
        ("joint:joint 3:springref", r"ball or free joint, whose spring has no springref"),
        ("body:arm:inertia", r"has 3 components; choose one, for instance 'body:arm:inertia\[0\]'"),
        ("actuator:jet:gear", r"has 6 components; choose one"),
        ("actuator:winch:gear[1]", r"beyond the 1 component"),
        ("actuator:winch:kp", r'no position servo, so it has no kp; its gain is "actuator:winch:gain"'),
        ("actuator:speed:kp", r"no position servo"),
    ],
)
def test_what_is_no_parameter_is_answered_with_those_there_are(path: str, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        workshop(path)


def test_impossible_values_are_refused_and_leave_the_model_whole() -> None:
    paths = [f"body:arm:inertia[{i}]" for i in range(3)]
    plant = workshop("joint:reach:damping", "actuator:winch:gear", *paths)
    model = plant.model_with()
    for values, message in (
        ({"joint:reach:damping": -1.0}, r"'joint:reach:damping' must be finite and not negative \[N s/m\], got -1"),
        ({"actuator:winch:gear": math.inf}, r"must be finite \[1\], got inf"),
        ({paths[0]: 5.0}, r"none may exceed the sum of the other two; change them together"),
        (dict.fromkeys(paths, 0.0), r"each of its principal moments of inertia must be positive"),
    ):
        with pytest.raises(PlantError, match=message):
            plant.apply(model, values)
        assert_same_model(model, plant.model)
    plant.apply(model, dict(zip(paths, (5.0, 6.0, 7.0), strict=True)))  # each alone would be too large for the others
    np.testing.assert_allclose(model.body_inertia[2], [5, 6, 7])


def test_paths_serve_linearization_and_changes_in_mid_run_as_names_do() -> None:
    """The same plan through the same change, by a path and by a name of one's own."""
    runs = []
    for name in ("body:tip:mass", "tip_mass"):
        parameters = {name: "body:tip:mass"} if name == "tip_mass" else [name]
        plant = Plant.from_xml(
            invtrack.model_path("cantilever"), inputs=["base_force"], outputs=["tip_position"], parameters=parameters
        )
        models = [invtrack.linearize(plant, **{name: mass}) for mass in (0.0, 50.0)]
        switched = invtrack.SwitchedSystem(models, switch_times=[0.4])
        plan = invtrack.invert(switched, invtrack.rest_to_rest(0.0, 1.0, duration=1.0), tolerance=1e-2)
        controller = invtrack.TrackingController(plan, invtrack.lqr(switched, Q=100.0, R=0.01))
        runs.append(invtrack.simulate(plant, controller, timestep=5e-3, schedule=[invtrack.Change(0.4, **{name: 50.0})]))
        assert runs[-1].parameters.channels.names == (name,)
    np.testing.assert_array_equal(runs[0].output.values, runs[1].output.values)
    assert np.unique(runs[0].parameters.values).tolist() == [0.0, 50.0]


def test_names_of_parameters_are_keywords_or_their_paths() -> None:
    with pytest.raises(PlantError, match="'tip mass' cannot be written as a keyword"):
        Plant.from_xml(WORKSHOP, inputs=["winch"], outputs=["joint:reach"], parameters={"tip mass": "body:hand:mass"})
    with pytest.raises(PlantError, match='must be a path such as "body:tip:mass", got 3'):
        Plant.from_xml(WORKSHOP, inputs=["winch"], outputs=["joint:reach"], parameters={"mass": 3})  # type: ignore[dict-item]


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        (["body:hand:mass", "body:hand:mass"], "must be distinct paths"),
        ({"m": "body:hand:mass", "load": "body:hand:mass"}, "'m' and 'load' are the same quantity"),
        (["body:hand:mass", "body:hand:mass:scaled"], "are the same quantity"),
        ("body:hand:mass", "must be paths such as"),
    ],
)
def test_each_quantity_is_named_once(parameters: Any, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        Plant.from_xml(WORKSHOP, inputs=["winch"], outputs=["joint:reach"], parameters=parameters)
    Plant.from_xml(WORKSHOP, inputs=["winch"], outputs=["joint:reach"], parameters=["actuator:reach:kp", "actuator:reach:bias[0]"])


@pytest.mark.parametrize("value", ["heavy", None, [1.0, 2.0], 1 + 2j])
def test_values_are_numbers(value: Any) -> None:
    plant = workshop("body:hand:mass")
    with pytest.raises(PlantError, match="parameter 'body:hand:mass' must be"):
        plant.model_with({"body:hand:mass": value})


def test_a_change_reads_as_it_is_written() -> None:
    change = invtrack.Change(3.0, tip_mass=2.0, **{"body:cart:mass": 1.5, "joint:x:damping": 0.0})
    assert repr(change) == "Change(3.0, tip_mass=2.0, **{'body:cart:mass': 1.5, 'joint:x:damping': 0.0})"
    assert eval(repr(change), {"Change": invtrack.Change}).parameters == change.parameters
