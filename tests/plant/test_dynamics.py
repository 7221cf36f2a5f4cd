"""A plant's nonlinear dynamics, evaluated in compiled loops, against linearize, mj_step and independent integration."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import invtrack
from invtrack.plans.dynamics import Dynamics, mechanism
from invtrack.plans.runge_kutta import CLASSICAL, EIGHTH_ORDER, RungeKutta, Steps
from tests.inversion.nonlinear.mechanisms import cart_pole, link

BODY = """<mujoco><option integrator="RK4" gravity="0 0 -9.81"><flag contact="disable"/></option>
<worldbody><body name="b"><freejoint name="f"/><inertial pos="0.01 0.02 0" mass="1.5" diaginertia=".3 .2 .1"/>
<site name="c" pos=".1 0 0"/><body pos=".2 0 0"><joint name="arm" type="ball" stiffness="2" damping=".05"/>
<inertial pos="0 0 -.1" mass=".2" diaginertia=".01 .02 .01"/></body></body></worldbody>
<actuator><motor name="lift" site="c" gear="0 0 1 0 0 0"/><motor name="turn" site="c" gear="0 0 0 .1 1 .3"/>
<general name="lag" site="c" gear="1 0 0 0 0 0" dyntype="filter" dynprm=".1"/></actuator></mujoco>"""


def dynamics_of(plant: invtrack.Plant, **values: float) -> Dynamics:
    moving = mechanism(plant)
    assert moving is not None
    return moving.dynamics(values)


def free_body() -> invtrack.Plant:
    return invtrack.Plant.from_xml(BODY, inputs=["lift", "turn", "lag"], outputs=["site:c:x", "body:b:yaw", "joint:arm:ry"])


def somewhere(plant: invtrack.Plant, count: int) -> tuple[np.ndarray, np.ndarray]:
    """States off the operating point, moving, and inputs."""
    rng, dynamics = np.random.default_rng(0), dynamics_of(plant)
    points = np.repeat(plant.configuration.x0[None], count, axis=0)
    tangents = rng.normal(size=(count, dynamics.size)) * 0.5
    return dynamics.retract(points, tangents), rng.normal(size=(count, len(plant.inputs)))


@pytest.mark.parametrize("make", [cart_pole, link, free_body])
def test_at_the_operating_point_they_are_those_of_linearize(make: object) -> None:
    plant = make()  # type: ignore[operator]
    model = invtrack.linearize(plant, allow_nonequilibrium=True)
    found = dynamics_of(plant).derivatives(plant.configuration.x0[None], model.operating_point.u0[None])
    np.testing.assert_allclose(found.outputs[0], model.operating_point.y0, atol=1e-15)
    for name in "ABCD":
        wanted = getattr(model, name)
        np.testing.assert_allclose(getattr(found, name)[0], wanted, atol=1e-8 * max(1.0, np.max(np.abs(wanted))))


@pytest.mark.parametrize("make", [cart_pole, link, free_body])
def test_one_sided_differences_are_near_central_ones(make: object) -> None:
    plant = make()  # type: ignore[operator]
    points, u = somewhere(plant, 5)
    dynamics = dynamics_of(plant)
    rough, found = dynamics.derivatives(points, u, rough=True), dynamics.derivatives(points, u)
    for name in "ABCD":
        ours, wanted = getattr(rough, name), getattr(found, name)
        np.testing.assert_allclose(ours, wanted, atol=1e-5 * max(1.0, np.max(np.abs(wanted))))


@pytest.mark.parametrize("make", [cart_pole, free_body])
def test_derivatives_carry_a_neighbouring_motion(make: object) -> None:
    """d' = A d + B v: the difference of two motions, each by mj_step, after a short time."""
    plant = make()  # type: ignore[operator]
    dynamics = dynamics_of(plant)
    points, u = somewhere(plant, 1)
    rng = np.random.default_rng(1)
    d, v = rng.normal(size=(1, dynamics.size)), rng.normal(size=u.shape)
    found, h, small = dynamics.derivatives(points, u), 1e-3, 1e-4
    ends = []
    for sign in (1.0, -1.0):
        moved, inputs = dynamics.retract(points, sign * small * d), u + sign * small * v
        ends.append([dynamics.replay(moved, inputs[:, None], np.array([t]), 1)[0][:, 0] for t in (h, 2 * h)])
    far = [dynamics.difference(ends[0][k], ends[1][k]) / (2 * small) for k in range(2)]
    rate = (4 * (far[0] - d) - (far[1] - d)) / (2 * h)  # of second order in h
    expected = found.A[0] @ d[0] + found.B[0] @ v[0]
    np.testing.assert_allclose(rate[0], expected, atol=2e-3 * np.max(np.abs(expected)))


@pytest.mark.parametrize("make", [cart_pole, link])
def test_steps_of_a_motion_are_those_of_mujoco(make: object) -> None:
    """Classical RK4 on slides and hinges, bit for bit but for the order of sums."""
    plant = make()  # type: ignore[operator]
    dynamics = dynamics_of(plant)
    points, _ = somewhere(plant, 3)
    coefficients = np.random.default_rng(2).normal(size=(3, 3, 1))
    ours = dynamics.motion(points, coefficients, Steps(CLASSICAL, 4, 3), np.array([0.02, 0.03, 0.05]))
    theirs, _ = dynamics.replay(points, coefficients, np.array([0.02, 0.03, 0.05]), 4)
    np.testing.assert_allclose(ours[:, 1:], theirs, atol=1e-13)


@pytest.mark.parametrize(("method", "numbers"), [(CLASSICAL, (10, 20, 40)), (EIGHTH_ORDER, (3, 6, 12))])
def test_a_tumbling_body_is_integrated_to_the_order_of_the_method(method: RungeKutta, numbers: tuple[int, ...]) -> None:
    """Against solve_ivp on the quaternions themselves: rotations in the chart of each step lose no order."""
    plant = free_body()
    dynamics, model = dynamics_of(plant), plant.model
    points, u = somewhere(plant, 1)
    data = mujoco.MjData(model)

    def rates(t: float, s: np.ndarray) -> np.ndarray:
        data.qpos[:], data.qvel[:], data.act[:] = np.split(s, [model.nq, model.nq + model.nv])
        data.ctrl[:] = u[0]
        mujoco.mj_forward(model, data)
        turned = []
        for address, dof in ((3, 3), (7, 6)):
            half = np.zeros(4)
            mujoco.mju_mulQuat(half, data.qpos[address : address + 4], np.concatenate([[0.0], data.qvel[dof : dof + 3] / 2]))
            turned.append(half)
        return np.concatenate([data.qvel[:3], turned[0], turned[1], data.qacc, data.act_dot])

    T = 0.4
    exact = solve_ivp(rates, (0.0, T), points[0], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1:].T
    errors = []
    for number in numbers:
        reached = dynamics.motion(points, u[:, None], Steps(method, number, 1), np.array([T]))[:, -1]
        errors.append(np.max(np.abs(dynamics.difference(reached, exact))))
    slopes = -np.diff(np.log2(errors))
    np.testing.assert_allclose(slopes, method.order, atol=0.1 * method.order)


def test_tangents_lead_where_they_say_and_states_are_the_plants() -> None:
    plant = free_body()
    dynamics = dynamics_of(plant)
    points, _ = somewhere(plant, 4)
    others, _ = somewhere(plant, 8)
    tangents = dynamics.difference(others[4:], points)
    again = dynamics.retract(points, tangents)
    np.testing.assert_allclose(dynamics.difference(again, others[4:]), 0, atol=1e-12)
    data = plant.new_data()
    data.qpos[:], data.qvel[:], data.act[:] = np.split(points[0], [plant.model.nq, plant.model.nq + plant.model.nv])
    np.testing.assert_allclose(dynamics.states(points)[0], plant.state(data), atol=1e-15)


def test_rates_of_states_are_those_of_the_moving_states() -> None:
    plant = free_body()
    dynamics = dynamics_of(plant)
    points, u = somewhere(plant, 2)
    rates, _ = dynamics.evaluate(points, u)
    ends = [dynamics.replay(points, u[:, None], np.full(2, h), 1)[0][:, 0] for h in (1e-4, 2e-4)]
    x, near, far = (dynamics.states(each) for each in (points, *ends))
    np.testing.assert_allclose(dynamics.state_rates(points, rates), (4 * near - far - 3 * x) / 2e-4, atol=1e-3)


def test_velocity_couplings_and_parameters_count() -> None:
    plant = invtrack.Plant.from_xml(invtrack.model_path("two_disc"), inputs=["motor"], outputs=["disc2_angle"])
    assert plant.couplings
    model = invtrack.linearize(plant)
    found = dynamics_of(plant).derivatives(plant.configuration.x0[None], model.operating_point.u0[None])
    np.testing.assert_allclose(found.A[0], model.A, atol=1e-8 * np.max(np.abs(model.A)))
    laden = link()
    heavy = dynamics_of(laden, payload=0.6).derivatives(laden.configuration.x0[None], np.zeros((1, 1)))
    np.testing.assert_allclose(heavy.B[0], invtrack.linearize(laden, payload=0.6).B, rtol=1e-7)


def test_what_mujoco_would_warn_of_is_no_number() -> None:
    plant = cart_pole()
    points, u = somewhere(plant, 2)
    points[1, 2] = np.inf
    rates, outputs = dynamics_of(plant).evaluate(points, u)
    assert np.all(np.isfinite(rates[0]))
    assert np.all(np.isnan(rates[1, 2:]))
    assert np.isnan(outputs[1, 0])


def test_limits_are_left_out_of_iterations_and_refused_afterwards() -> None:
    text = """<mujoco><worldbody><body><joint name="q" type="slide" axis="1 0 0" range="-1 1" limited="true"/>
    <geom size=".1" mass="1"/></body></worldbody>
    <actuator><motor name="u" joint="q" ctrlrange="-1 1" ctrllimited="true"/></actuator></mujoco>"""
    plant = invtrack.Plant.from_xml(text, inputs=["u"], outputs=["joint:q"])
    dynamics = dynamics_of(plant)
    beyond, strong = np.array([[1.5, 0.0]]), np.array([[7.0]])
    np.testing.assert_allclose(dynamics.evaluate(beyond, strong)[0], [[0.0, 7.0]])
    with pytest.raises(invtrack.errors.PlantError, match="limit of joint q"):
        dynamics.require_free(beyond, strong)
    dynamics.require_free(np.zeros((1, 2)), np.zeros((1, 1)))
