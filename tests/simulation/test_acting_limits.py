"""Limits that act in a run: what is applied, against MuJoCo's own forces, and one event for each time that one acts."""

from __future__ import annotations

import copy
import warnings
from pathlib import Path

import mujoco
import numpy as np
import pytest

import invtrack
from invtrack.results.result import Event, RunResult
from invtrack.simulation.acting_limits import MOST_EPISODES, ActingLimit, Stretches, limit_events

CART = """
<mujoco model="cart">
  <option gravity="0 0 0" integrator="{integrator}"/>
  <worldbody>
    {world}
    <body name="cart"><joint name="x" type="slide" axis="1 0 0" {joint}/><geom name="ball" size="0.1" mass="1"/></body>
  </worldbody>
  <tendon>{tendon}</tendon>
  <actuator>{actuators}</actuator>
</mujoco>"""
MOTOR = '<motor name="u" joint="x"/>'
SLEW = invtrack.rest_to_rest(0.0, 1.0, duration=1.0)  # needs 5.7735 N of a mass of 1 kg
FIXED = '<fixed name="rope" {}><joint joint="x" coef="1"/></fixed>'


def cart(
    actuators: str = MOTOR,
    *,
    inputs: tuple[str, ...] = ("u",),
    integrator: str = "RK4",
    joint: str = "",
    tendon: str = "",
    world: str = "",
) -> invtrack.Plant:
    xml = CART.format(actuators=actuators, joint=joint, tendon=tendon, world=world, integrator=integrator)
    return invtrack.Plant.from_xml(xml, inputs=inputs, outputs=["joint:x"])


def run(plant: invtrack.Plant, gain: float = 10.0, **options: object) -> tuple[RunResult, list[str]]:
    """The slew, with feedback that pushes against whatever is in the way; and what was said beforehand."""
    model = invtrack.linearize(plant)
    plan = invtrack.invert(model, SLEW, R=1.0) if model.n_inputs > 1 else invtrack.invert(model, SLEW)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always", RuntimeWarning)
        result = invtrack.simulate(plant, invtrack.TrackingController(plan, invtrack.lqr(model, Q=gain, R=1.0)), **options)  # type: ignore[arg-type]
    return result, [str(each.message) for each in said]


def acted(result: RunResult) -> list[Event]:
    return [event for event in result.events if event.kind in ("limit", "contact")]


def forces(model: mujoco.MjModel, plant: invtrack.Plant, result: RunResult, inputs: np.ndarray, steps: range) -> np.ndarray:
    """MuJoCo's own actuator force on the cart at the starts of these steps, with these inputs (N, p)."""
    data, n = mujoco.MjData(model), model.nv
    found = []
    for k in steps:
        data.qpos[:], data.qvel[:], data.act[:] = np.split(result.state.values[k], [n, 2 * n])
        data.ctrl[plant.input_addresses] = inputs[k]
        mujoco.mj_forward(model, data)
        found.append(float(data.qfrc_actuator[0]))
    return np.array(found)


def unlimited(plant: invtrack.Plant) -> mujoco.MjModel:
    """The model without the limits of its inputs, tendons and joints."""
    free = copy.copy(plant.model)
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL
    free.actuator_forcelimited[plant.input_addresses] = False  # one control each
    free.tendon_actfrclimited[:] = free.jnt_actfrclimited[:] = False
    return free


SERVO = '<position name="u" joint="x" kp="100" kv="5" {}/>'
BENT = '<general name="u" joint="x" gainprm="2 0.5 0.1" gaintype="affine" biastype="affine" biasprm="0 -2 -1" {}/>'

FORCES = [
    pytest.param({"actuators": '<motor name="u" joint="x" ctrlrange="-2 2"/>'}, "ctrlrange of u", id="ctrlrange"),
    pytest.param({"actuators": '<motor name="u" joint="x" forcerange="-2 2"/>'}, "forcerange of u", id="forcerange"),
    pytest.param({"joint": 'actuatorfrcrange="-2 2"'}, "actuatorfrcrange of joint x at u", id="joint"),
    pytest.param({"actuators": SERVO.format('forcerange="-2 2"')}, "forcerange of u", id="servo"),
    pytest.param({"actuators": BENT.format('forcerange="-2 2"')}, "forcerange of u", id="gain of the state"),
    pytest.param(
        {"actuators": SERVO.format(""), "joint": 'actuatorfrcrange="-2 2"'}, "actuatorfrcrange of joint x", id="servo at joint"
    ),
    pytest.param(
        {"actuators": SERVO.format("") + '<position joint="x" kp="30" forcerange="-1 1"/>', "joint": 'actuatorfrcrange="-2 2"'},
        "actuatorfrcrange of joint x",
        id="another servo",
    ),
    pytest.param(
        {"actuators": '<motor name="u" tendon="rope" gear="0.5"/>', "tendon": FIXED.format('actuatorfrcrange="-4 4"')},
        "actuatorfrcrange of tendon rope",
        id="tendon",
    ),
    pytest.param(
        {
            "actuators": '<motor name="u" joint="x"/><motor name="v" joint="x" gear="3"/>',
            "joint": 'actuatorfrcrange="-2 2"',
            "inputs": ("u", "v"),
        },
        "actuatorfrcrange of joint x",
        id="two motors",
    ),
]


@pytest.mark.parametrize(("plant", "text"), FORCES)
@pytest.mark.parametrize("integrator", ["RK4", "Euler"])
def test_applied_is_the_control_that_gives_the_force_that_acts(plant: dict[str, object], text: str, integrator: str) -> None:
    limited = cart(**plant, integrator=integrator)  # type: ignore[arg-type]
    result, said = run(limited, timestep=2e-3)
    applied, commanded = result.applied.values, result.commanded.values
    steps = range(0, len(applied), 7)
    acting = forces(limited.model, limited, result, commanded, steps)
    np.testing.assert_allclose(forces(unlimited(limited), limited, result, applied, steps), acting, rtol=1e-10, atol=1e-10)
    assert np.sum(np.any(np.abs(applied - commanded)[steps] > 1e-6, axis=1)) > 10
    assert any(event.text.startswith(f"{text}, exceeded by up to ") for event in acted(result))
    assert all(event.kind == "limit" for event in acted(result))
    assert any("expect" in warning for warning in said)


@pytest.mark.parametrize(("plant", "text"), FORCES)
def test_each_event_spans_the_steps_in_which_the_input_is_clamped(plant: dict[str, object], text: str) -> None:
    result, _ = run(cart(**plant), timestep=2e-3)  # type: ignore[arg-type]
    differs = np.any(np.abs(result.applied.values - result.commanded.values) > 1e-5, axis=1)
    begins, ends = (np.flatnonzero(np.diff(differs, prepend=False, append=False))[half::2] for half in (0, 1))
    spans = [event for event in acted(result) if event.text.startswith(text)]
    first = min(event.time for event in spans)
    last = max(event.until for event in spans if event.until is not None)
    assert first == result.time[begins[0]]
    assert last == result.time[ends[-1]]
    assert len(spans) <= 4


def test_a_muscle_and_a_filter_are_events_and_their_controls_stay_as_they_were() -> None:
    """A force that follows an activation answers to no control at once."""
    plant = cart('<general name="u" joint="x" dyntype="filter" dynprm="0.01" forcerange="-2 2"/>')
    result, said = run(plant, timestep=2e-3)
    assert np.array_equal(result.applied.values, result.commanded.values)
    (first, *_) = acted(result)
    force = result.state["u activation"][:-1]
    assert first.time == result.time[int(np.flatnonzero(np.abs(force) > 2.0)[0])]
    assert first.text == f"forcerange of u, exceeded by up to {np.max(np.abs(force)) - 2:.3g}, until t = {first.until:.6g} s"
    assert any("the plan goes beyond the forcerange of u by up to 3.77, from t = 0.0" in warning for warning in said)


@pytest.mark.parametrize("kind", ["integrator", "filter", "filterexact"])
@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
def test_a_clamped_activation_is_an_event_as_long_as_it_stays_at_its_bound(kind: str, integrator: str) -> None:
    plant = cart(
        f'<general name="u" joint="x" dyntype="{kind}" dynprm="0.01" actlimited="true" actrange="-2 2"/>', integrator=integrator
    )
    result, said = run(plant, timestep=2e-3)
    at_bound = np.flatnonzero(np.abs(result.state["u activation"]) == 2.0)
    events = acted(result)
    assert {event.text.partition(",")[0] for event in events} == {"actrange of u"}
    assert abs(events[0].time - result.time[at_bound[0]]) <= 2.1e-3
    assert any("beyond the actrange of u by up to 3.77 N" in warning for warning in said)
    if kind != "integrator":  # it would settle where its control is
        most = max(float(event.text.split("up to ")[1].split(" N")[0]) for event in events)
        assert most == pytest.approx(np.max(np.abs(result.commanded.values)) - 2.0, rel=5e-3)


def test_a_filter_that_settles_at_the_end_of_its_range_is_not_clamped() -> None:
    xml = CART.format(
        actuators='<general name="u" joint="x" dyntype="filter" dynprm="0.01" actlimited="true" actrange="-2 2"/>',
        joint='stiffness="100"', tendon="", world="", integrator="RK4",
    )  # fmt: skip
    plant = invtrack.Plant.from_xml(xml, inputs=["u"], outputs=["joint:x"])
    model = invtrack.linearize(plant)
    plan = invtrack.invert(model, invtrack.rest_to_rest(0.0, 0.02, duration=2.0))  # held by 2 N
    result = invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=1e-3, end=4.0)
    assert result.state["u activation"][-1] == pytest.approx(2.0, rel=1e-6)
    assert not acted(result)


@pytest.mark.parametrize("integrator", ["RK4", "Euler", "implicitfast"])
@pytest.mark.parametrize(
    ("plant", "text", "bound"),
    [
        ({"joint": 'range="-0.5 0.5"'}, "range of joint x by up to 0.5 m", 0.5),
        ({"tendon": FIXED.format('range="-0.6 0.6"')}, "range of tendon rope by up to 0.4 m", 0.6),
        ({"world": '<geom name="wall" type="box" size="0.1 1 1" pos="1.1 0 0"/>'}, "contact of wall and ball, 0.1 m deep", 0.9),
    ],
)
def test_ranges_and_contacts_are_events_from_where_they_are_reached(
    plant: dict[str, str], text: str, bound: float, integrator: str
) -> None:
    result, said = run(cart(**plant, integrator=integrator), timestep=1e-3)  # type: ignore[arg-type]
    reached = result.time[int(np.flatnonzero(result.state["x"] > bound)[0])]
    (first, *_) = acted(result)
    assert abs(first.time - reached) <= 1.1e-3
    assert first.text.partition(",")[0] in text
    assert first.kind == ("contact" if "contact" in text else "limit")
    (warning,) = said
    assert text in warning


def test_contacts_on_the_way_are_one_warning_and_an_event_each() -> None:
    walls = "".join(f'<geom name="{name}" type="box" size="0.1 1 1" pos="{x} 0 0"/>' for name, x in (("soft", 0.9), ("hard", 1.1)))
    result, (warning,) = run(cart(world=walls), timestep=1e-3)
    assert warning.startswith("the plan leads into a contact of soft and ball, 0.199 m deep, from t = 0.6")
    assert warning.endswith("s on (and into 1 more): expect it to be stopped")
    assert acted(result)[0].text.startswith("contact of soft and ball, up to 0.")


def test_a_ball_that_bounces_is_one_event_for_each_time_that_it_touches() -> None:
    hop = """
    <mujoco><option timestep="1e-3"/>
      <worldbody><geom name="floor" type="plane" size="1 1 0.1" solref="-50000 -2"/>
        <body pos="0 0 0.4"><joint name="z" type="slide" axis="0 0 1"/><geom name="ball" size="0.1" mass="1"/></body>
        <body pos="3 0 1"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1" mass="1"/></body></worldbody>
      <actuator><motor name="u" joint="x"/></actuator></mujoco>"""
    plant = invtrack.Plant.from_xml(hop, inputs=["u"], outputs=["joint:x"], drop_states=["z", "z velocity"])
    model = invtrack.linearize(plant, allow_nonequilibrium=True)
    plan = invtrack.invert(model, SLEW)
    result = invtrack.simulate(plant, invtrack.TrackingController(plan), timestep=1e-3, end=2.0)
    height = result.qpos[:, 0] + 0.4
    touches = int(np.sum(np.diff((height < 0.1).astype(int)) == 1))
    assert touches >= 3
    assert [event.kind for event in acted(result)] == ["contact"] * touches


def test_limits_that_are_never_reached_change_nothing_and_are_not_spoken_of() -> None:
    plain, _ = run(cart(), timestep=2e-3)
    wide = cart(
        '<motor name="u" joint="x" ctrlrange="-90 90" forcerange="-80 80"/><position joint="x" kp="0" forcerange="-1 1"/>',
        joint='range="-5 5" actuatorfrcrange="-50 50"',
        world='<geom name="wall" type="box" size="0.1 1 1" pos="9 0 0"/>',
        tendon=FIXED.format('range="-5 5" actuatorfrcrange="-70 70"'),
    )
    limited, said = run(wide, timestep=2e-3)
    assert not said
    assert not acted(limited)
    for name in ("state", "output", "commanded", "applied"):
        assert np.array_equal(getattr(limited, name).values, getattr(plain, name).values)


@pytest.mark.parametrize("scale", [1.0, 1e-6, 1e6])
def test_a_motion_that_ends_on_a_limit_is_no_alarm(scale: float) -> None:
    """The range ends where the motion does, and the actuator passes on just the plan's peak, in any unit."""
    free = cart(f'<motor name="u" joint="x" gear="{scale!r}"/>')
    low, high = (float(bound[0]) for bound in invtrack.invert(invtrack.linearize(free), SLEW).input_range)
    near = f'<motor name="u" joint="x" gear="{scale!r}" ctrlrange="{low * (1 - 1e-12)!r} {high * (1 - 1e-12)!r}"/>'
    plant = cart(near, joint='range="-0.5 1"', world='<geom name="wall" type="box" size="0.1 1 1" pos="1.2 0 0"/>')
    model = invtrack.linearize(plant)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = invtrack.simulate(plant, invtrack.TrackingController(invtrack.invert(model, SLEW)), evaluate="stages")
    assert not acted(result)


def test_gains_that_change_in_mid_run_are_those_that_count() -> None:
    plant = invtrack.Plant.from_xml(
        CART.format(actuators=SERVO.format('forcerange="-9 9"'), joint="", tendon="", world="", integrator="RK4"),
        inputs=["u"], outputs=["joint:x"], parameters={"mass": "body:cart:mass"},
    )  # fmt: skip
    model = invtrack.linearize(plant)
    controller = invtrack.TrackingController(invtrack.invert(model, SLEW), invtrack.lqr(model, Q=100.0, R=1.0))
    result = invtrack.simulate(plant, controller, schedule=[invtrack.Change(0.4, mass=4.0)], timestep=1e-3)
    assert min(event.time for event in acted(result)) > 0.4


def test_events_of_limits_survive_a_recording(tmp_path: Path) -> None:
    result, _ = run(cart('<motor name="u" joint="x" forcerange="-2 2"/>'), timestep=5e-3)
    path = invtrack.save_recording(result, tmp_path / "run.rrd")
    (loaded,) = invtrack.load_recording(path).values()
    assert loaded.equals(result)
    assert acted(loaded)[0].until is not None


def test_a_chattering_limit_is_told_in_few_events_that_cover_it() -> None:
    time = np.linspace(0.0, 10.0, 10_001)
    chatter, rare = np.zeros(10_000), np.zeros(10_000)
    chatter[::2], rare[::200] = 1.0, np.linspace(0.1, 5.0, 50)
    (one,) = limit_events({ActingLimit("chatter", "N"): Stretches.of_excess(chatter)}, time, (0.0, 10.0))
    assert (one.time, one.until) == (0.0, time[9_999])
    assert one.text == "chatter, exceeded by up to 1 N, until t = 9.999 s"
    events = limit_events({ActingLimit("rare"): Stretches.of_excess(rare)}, time, (0.0, 10.0))
    assert len(events) <= MOST_EPISODES
    assert all(any(event.time <= time[k] < (event.until or 0.0) for event in events) for k in range(0, 10_000, 200))
    assert max(event.text for event in events).startswith("rare, exceeded by up to 5, ")


def test_a_limit_of_a_linear_plant_is_an_event_too() -> None:
    model = invtrack.StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]], input_limits=[[-2.0, 2.0]])
    plan = invtrack.invert(model, SLEW)
    with pytest.warns(RuntimeWarning, match="expect saturation"):
        result = invtrack.simulate(invtrack.LinearPlant(model), invtrack.TrackingController(plan), timestep=1e-3)
    assert [event.text.partition(",")[0] for event in acted(result)] == ["limit of u1"] * 2
