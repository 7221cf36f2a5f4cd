"""models/hover.xml against HE3's matrices and against Newton and Euler, at any heading; states that are dropped by name."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
import pytest
import scipy.integrate
import scipy.linalg

import invtrack
from invtrack.errors import PlantError, SimulationError
from invtrack.recording.scene import make_scene
from tests.cited_plants import HE3_A, HE3_B

INPUTS = ["collective", "longitudinal_cyclic", "lateral_cyclic", "tail_rotor"]
OUTPUTS = ["velocity[0]", "velocity[2]", "velocity[1]", "rate[2]"]  # U, W, V, R
UNSEEN = [f"helicopter.{coordinate}" for coordinate in ("x", "y", "z", "rz")]
HE3_STATES = ("U", "W", "Q", "V", "P", "R", "theta", "phi")
HEADINGS = (0.0, np.pi / 2, 2.5)  # [rad], about the vertical

MASS, INERTIA, GRAVITY = 3600.0, np.array([3800.0, 17000.0, 14600.0]), 9.81
TWIST = [HE3_STATES.index(name) for name in ("U", "V", "W", "P", "Q", "R")]


def helicopter(heading: float = 0.0, *, drop_states: Sequence[str] = UNSEEN, **options: Any) -> invtrack.Plant:
    options = {"inputs": INPUTS, "outputs": OUTPUTS, **options}
    plant = invtrack.Plant.from_xml(invtrack.model_path("hover"), drop_states=drop_states, **options)
    return plant.at(qpos=[0, 0, 6, *orientation(heading)])


def orientation(heading: float) -> np.ndarray:
    """The quaternion of level body axes: x forward, z down, turned by `heading` to the left."""
    return np.array([0.0, np.cos(heading / 2), np.sin(heading / 2), 0.0])


def rotation(quaternion: np.ndarray) -> np.ndarray:
    """The matrix that takes body axes to the world's."""
    R = np.empty(9)
    mujoco.mju_quat2Mat(R, quaternion)
    return R.reshape(3, 3)


def in_order_of_he3(model: invtrack.StateSpace, heading: float) -> invtrack.StateSpace:
    """The model in the state (U W Q V P R theta phi): velocities along the body's axes, roll about x, pitch about y."""
    to_body = rotation(orientation(heading)).T
    velocity = {name: i for i, name in enumerate("UVW")}
    T = np.zeros((8, 8))
    rows = {name: i for i, name in enumerate(HE3_STATES)}
    for name, axis in velocity.items():
        for world, column in enumerate("xyz"):
            T[rows[name], model.states.index(f"helicopter.{column} velocity")] = to_body[axis, world]
    for name, column in {"P": "rx velocity", "Q": "ry velocity", "R": "rz velocity", "phi": "rx", "theta": "ry"}.items():
        T[rows[name], model.states.index(f"helicopter.{column}")] = 1
    return model.transformed(T, HE3_STATES)


@pytest.mark.parametrize("heading", HEADINGS)
def test_linear_model_is_he3_at_any_heading(heading: float) -> None:
    model = in_order_of_he3(invtrack.linearize(helicopter(heading)), heading)
    assert model.states.names == HE3_STATES
    assert np.max(np.abs(model.A - HE3_A)) < 1e-9
    assert np.max(np.abs(model.B - HE3_B)) < 1e-9
    assert np.max(np.abs(model.C - np.eye(8)[[HE3_STATES.index(name) for name in "UWVR"]])) < 1e-9
    assert not np.any(model.D)


@pytest.mark.parametrize("heading", HEADINGS)
def test_hover_is_an_equilibrium_with_all_controls_zero(heading: float) -> None:
    plant = helicopter(heading)
    assert np.max(np.abs(plant.new_data().qacc)) < 1e-13 * GRAVITY
    assert not np.any(plant.operating_point.u0)
    assert np.max(np.abs(plant.operating_point.y0)) == 0


def test_trim_levels_a_tilted_helicopter() -> None:
    """Upright its constant thrust carries the weight, with all controls zero, wherever it stands."""
    tilted = helicopter().at(qpos=[1.0, 2.0, 6.0, *quaternion_after_roll(0.1)])
    point = invtrack.trim(tilted)
    assert list(point.controls.values()) == pytest.approx([0.0] * 5, abs=1e-9)
    assert point.positions["helicopter.rx"] == pytest.approx(-0.1, abs=1e-9)
    assert point.plant.configuration.qpos == pytest.approx([1.0, 2.0, 6.0, *orientation(0.0)], abs=1e-9)


def test_channels() -> None:
    plant = helicopter()
    assert plant.states.names[:4] == ("helicopter.rx", "helicopter.ry", "helicopter.x velocity", "helicopter.y velocity")
    assert (plant.n_states, len(plant.coordinates), plant.dropped) == (8, 12, tuple(UNSEEN))
    assert plant.states.units == ("rad",) * 2 + ("m/s",) * 3 + ("rad/s",) * 3
    assert plant.outputs.units == ("m/s", "m/s", "m/s", "rad/s")
    assert plant.inputs.units == ("",) * 4  # each is a force and a torque in directions of their own


def test_only_the_stated_mass_is_there() -> None:
    model = helicopter().model
    assert float(np.sum(model.body_mass)) == MASS
    assert model.body_inertia[1] == pytest.approx(INERTIA)
    assert not np.any(model.body_ipos[1])


def test_sensors_are_in_aeronautical_body_axes() -> None:
    """North is the world's x, east its -y, down its -z; heading east means turned to the right."""
    plant = helicopter(-np.pi / 2, outputs=[f"velocity[{i}]" for i in range(3)] + ["rate[0]"])
    forward_right_down = {"forward": [0.0, -1.0, 0.0], "right": [-1.0, 0.0, 0.0], "down": [0.0, 0.0, -1.0]}
    for axis, velocity in enumerate(forward_right_down.values()):
        data = plant.at(qvel=[*velocity, 0.3, 0.0, 0.0]).new_data()
        assert plant.measure(data) == pytest.approx([*np.eye(3)[axis], 0.3], abs=1e-15)
    data = helicopter().at(qpos=[0, 0, 6, *quaternion_after_roll(0.1)]).new_data()
    assert data.qacc[1] < -0.9  # the right side down: it is pushed to the right


def quaternion_after_roll(angle: float) -> np.ndarray:
    roll, turned = np.array([np.cos(angle / 2), np.sin(angle / 2), 0, 0]), np.empty(4)
    mujoco.mju_mulQuat(turned, orientation(0.0), roll)
    return turned


def controls(t: float) -> np.ndarray:
    return np.array([2.0 * np.sin(1.1 * t), 1.5 * np.cos(2.0 * t), -2.5 * np.sin(1.7 * t), 3.0 * np.cos(0.9 * t)])


def flown(heading: float, *, duration: float, step: float = 2e-3) -> mujoco.MjData:
    """Open loop with controls held from one step to the next, sensors up to date at the end."""
    plant = helicopter(heading)
    model, data = plant.model_with(), plant.new_data()
    model.opt.timestep = step
    with plant.forces(model):
        for k in range(round(duration / step)):
            data.ctrl[plant.input_addresses] = controls(k * step)
            mujoco.mj_step(model, data)
        mujoco.mj_forward(model, data)
    return data


def test_body_frame_response_is_the_same_at_any_heading() -> None:
    straight, *turned = (flown(heading, duration=5.0) for heading in HEADINGS)
    assert np.max(np.abs(straight.sensordata)) > 4  # far from hover: fast, tilted, and turned by more than 45 degrees
    assert rotation(straight.qpos[3:])[0, 0] < 0.5
    for heading, other in zip(HEADINGS[1:], turned, strict=True):
        assert other.sensordata == pytest.approx(straight.sensordata, abs=1e-10)
        c, s = np.cos(heading), np.sin(heading)
        about_vertical = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        assert other.qpos[:3] == pytest.approx(about_vertical @ straight.qpos[:3], abs=1e-10)
        assert rotation(other.qpos[3:]) == pytest.approx(about_vertical @ rotation(straight.qpos[3:]), abs=1e-10)


def test_large_motion_obeys_newton_and_euler() -> None:
    """m (v' + w x v) = f + R' m g - m g e_z, I w' + w x I w = t, R' = R [w x], (f, t) from HE3's rows, along the body's axes."""
    scale = np.r_[np.full(3, MASS), INERTIA]
    K, gears = scale[:, None] * HE3_A[np.ix_(TWIST, TWIST)], scale[:, None] * HE3_B[TWIST]

    def rate(t: float, state: np.ndarray) -> np.ndarray:
        v, w, R = state[:3], state[3:6], state[6:].reshape(3, 3)
        force, torque = np.split(K @ state[:6] + gears @ controls(t), 2)
        weight = MASS * GRAVITY * (R.T @ [0, 0, -1] - [0, 0, 1])
        turning = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])
        v_rate = (force + weight) / MASS - np.cross(w, v)
        return np.concatenate([v_rate, (torque - np.cross(w, INERTIA * w)) / INERTIA, (R @ turning).ravel()])

    start = np.r_[np.zeros(6), rotation(orientation(0.0)).ravel()]
    exact = scipy.integrate.solve_ivp(rate, (0.0, 4.0), start, rtol=1e-10, atol=1e-10).y[:6, -1]
    misses = [np.max(np.abs(flown(0.0, duration=4.0, step=step).sensordata[:6] - exact)) for step in (8e-3, 4e-3)]
    assert misses[1] < 0.02  # the controls are held over each step, from its start on, so the error is of the order of the step
    assert misses[0] / misses[1] == pytest.approx(2.0, abs=0.05)


@pytest.mark.parametrize(
    ("dropped", "outputs", "message"),
    [
        (["helicopter.rx"], OUTPUTS, r"'helicopter.rx' acts on 'helicopter.y velocity'\. Take"),
        ([*UNSEEN, "helicopter.ry"], OUTPUTS, r"'helicopter.ry' acts on 'helicopter.x velocity'\. Take"),
        (["helicopter.x velocity"], OUTPUTS, r"'helicopter.x velocity' acts on 'helicopter.x', .*'velocity\[0\]'\. Take"),
        (UNSEEN, [*OUTPUTS[:3], "site:centre:z"], r"'helicopter.z' acts on 'site:centre:z'\. Take"),
        (UNSEEN, [*OUTPUTS[:2], "site:centre:x", "site:centre:y"], r"'helicopter.x' .*'site:centre:x'; 'helicopter.y' acts on"),
    ],
)
def test_what_acts_cannot_be_dropped(dropped: list[str], outputs: list[str], message: str) -> None:
    with pytest.raises(PlantError, match=message):
        invtrack.linearize(helicopter(drop_states=dropped, outputs=outputs))


def test_dropped_states_must_not_act_on_measurements() -> None:
    with pytest.raises(PlantError, match=r"'helicopter.x' acts on 'site:centre:x'\. Take them out of drop_states"):
        invtrack.linearize(helicopter(measurements=["site:centre:x"]))


@pytest.mark.parametrize(
    ("dropped", "message"),
    [
        (["helicopter.x", "heading"], r"no state 'heading' to drop; the states are: helicopter.x, helicopter.y"),
        ("helicopter.x", r"expected a list of states to drop such as \[\"name\"\], got 'helicopter.x'"),
        (
            invtrack.Plant.from_xml(invtrack.model_path("hover"), inputs=INPUTS, outputs=OUTPUTS).states.names,
            r"all states are dropped",
        ),
    ],
)
def test_states_to_drop_are_checked_by_name(dropped: Any, message: str) -> None:
    with pytest.raises(PlantError, match=message):
        helicopter(drop_states=dropped)


def test_dropping_leaves_the_model_of_what_is_kept() -> None:
    whole, less = (invtrack.linearize(helicopter(drop_states=dropped)) for dropped in ((), UNSEEN))
    kept = [whole.states.index(name) for name in less.states.names]
    assert np.array_equal(less.A, whole.A[np.ix_(kept, kept)])
    assert np.array_equal(less.B, whole.B[kept])
    assert np.array_equal(less.C, whole.C[:, kept])
    assert np.array_equal(less.measurement.C, whole.measurement.C[:, kept])


def sidestep(plant: invtrack.Plant, **options: Any) -> invtrack.RunResult:
    """A run of two seconds, sideways and down, started somewhere else than at rest."""
    model = invtrack.linearize(plant)
    still = invtrack.references.constant(0.0)
    wanted = invtrack.rest_to_rest(0.0, 0.5, 2.0)
    plan = invtrack.invert(model, invtrack.references.stack([still, wanted, wanted, still]), max_preactuation=0.5)
    controller = invtrack.TrackingController(plan, invtrack.lqr(model, Q=1.0, R=1.0))
    return invtrack.simulate(plant, controller, timestep=0.01, end=2.0, initial_state=0.05 * np.ones(8), **options)


@pytest.mark.parametrize("evaluate", ["held", "stages"])
def test_simulation_runs_the_whole_body_and_shows_the_kept_states(evaluate: Any) -> None:
    plant = helicopter(np.pi / 2)
    run = sidestep(plant, evaluate=evaluate)
    assert run.status == "completed"
    assert run.state.channels.names == plant.states.names
    assert run.qpos.shape == (len(run.time), 7)
    assert run.qpos[0, :3] == pytest.approx([0, 0, 6])
    assert run.state.values[0] == pytest.approx(np.full(8, 0.05))
    kept = [plant.coordinates.index(name) for name in plant.states.names[:2]]
    for qpos, x in zip(run.qpos[::40], run.state.values[::40], strict=True):
        displacement = np.empty(6)
        mujoco.mj_differentiatePos(plant.model, displacement, 1.0, plant.configuration.qpos, qpos)
        assert x[:2] == pytest.approx(displacement[kept], abs=1e-14)
    travelled = np.trapezoid(run.state.values[:, 2:5], run.time, axis=0)
    assert run.qpos[-1, :3] - run.qpos[0, :3] == pytest.approx(travelled, abs=1e-4)
    assert np.linalg.norm(travelled) > 0.3


def test_initial_state_has_the_kept_states() -> None:
    plant = helicopter()
    model = invtrack.linearize(plant)
    plan = invtrack.invert(model, invtrack.references.stack([invtrack.rest_to_rest(0.0, 0.0, 1.0)] * 4))
    with pytest.raises(SimulationError, match=r"initial_state must be finite, \(8,\): helicopter.rx .*; got shape \(12,\)"):
        invtrack.simulate(plant, invtrack.TrackingController(plan), initial_state=np.zeros(12))


def test_recorded_scene_shows_the_body_as_it_stands() -> None:
    run = sidestep(helicopter(np.pi / 2))
    scene = make_scene(run, (run.time[0], run.time[-1]))
    assert scene is not None
    body = mujoco.mj_name2id(scene.model, mujoco.mjtObj.mjOBJ_BODY, "helicopter")
    assert scene.positions[:, body] == pytest.approx(run.qpos[scene.frames, :3])
    assert scene.quaternions[:, body] == pytest.approx(run.qpos[scene.frames][:, [4, 5, 6, 3]])
