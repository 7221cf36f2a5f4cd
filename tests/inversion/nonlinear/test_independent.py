"""Plans on nonlinear motions against solutions by other means: scipy's collocation, closed forms, linear inverses."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_bvp

import invtrack
from tests.inversion.nonlinear.mechanisms import cart_pole, flexible_joint
from tests.simulation.rigs import JUMPS, MASSES, cantilever_plant

T1 = 6.0
"""How long before and after the motion the collocation reaches [s]: three seconds are ten time constants of the pole."""


def pole_by_collocation(plant: invtrack.Plant, reference: invtrack.PiecewiseSignal) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, angles of the pole and forces for a cart that follows the reference, by solve_bvp.

    J th'' + b th' = m a (g sin th - cos th x''), bounded: on the unstable manifold before, on the stable one after.
    """
    body = int(plant.model.body("pole").id)
    m, arm, g, b = float(plant.model.body_mass[body]), 0.5, 9.81, 0.002
    J = float(plant.model.body_inertia[body, 0]) + m * arm**2
    M, d = float(plant.model.body_mass[body - 1]), 0.1
    unstable, stable = (-b / (2 * J) + sign * np.sqrt((b / (2 * J)) ** 2 + m * g * arm / J) for sign in (1, -1))

    def rates(t: np.ndarray, s: np.ndarray) -> np.ndarray:
        acceleration = reference(t, derivative=2)[:, 0]
        return np.vstack([s[1], (m * arm * (g * np.sin(s[0]) - np.cos(s[0]) * acceleration) - b * s[1]) / J])

    def ends(first: np.ndarray, last: np.ndarray) -> np.ndarray:
        return np.array([first[1] - unstable * first[0], last[1] - stable * last[0]])

    grid = np.linspace(-T1, 2.0 + T1, 1401)  # both breakpoints of the reference among its nodes
    found = solve_bvp(rates, ends, grid, np.zeros((2, len(grid))), tol=1e-10, max_nodes=200_000)
    assert found.success
    t = np.linspace(-1.0, 3.0, 401)
    theta, speed = found.sol(t)
    _, turning = rates(t, np.vstack([theta, speed]))
    x = [reference(t, derivative=k)[:, 0] for k in range(3)]
    force = (M + m) * x[2] + d * x[1] + m * arm * (turning * np.cos(theta) - speed**2 * np.sin(theta))
    return t, theta, force


@pytest.mark.parametrize("distance", [3.0, 10.0])
def test_cart_pole_against_collocation(distance: float) -> None:
    plant, reference = cart_pole(), invtrack.rest_to_rest(0.0, distance, duration=2.0)
    plan = invtrack.invert(plant, reference, accuracy=1e-10)
    t, theta, force = pole_by_collocation(plant, reference)
    samples = plan(t)
    np.testing.assert_allclose(samples.x[:, 1], theta, atol=1e-8 * np.max(np.abs(theta)))
    # Inputs are cubics on each element of 40 ms, off by their next term at its ends; states feel no more than their integrals.
    np.testing.assert_allclose(samples.u[:, 0], force, atol=4e-7 * np.max(np.abs(force)))
    np.testing.assert_allclose(samples.y, reference(t), atol=1e-8 * distance)


def test_flexible_joint_in_closed_form() -> None:
    """J2 q'' + m g l cos q = k s + d s', J1 (m)'' = torque - b m' - (that): the link's angle gives everything."""
    plant = flexible_joint()
    model = plant.model
    reference = invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0, smoothness=6)
    plan = invtrack.invert(plant, reference)
    mass, arm, k, d, b = float(model.body_mass[2]), 0.25, 100.0, 0.02, 0.05
    J_link = float(model.body_inertia[2, 0]) + mass * arm**2
    J_motor = 0.02
    t = np.linspace(-0.1, 1.1, 241)
    q = [reference(t, derivative=n)[:, 0] for n in range(5)]
    # The spring's torque on the link is -k s - d s' = J q'' + m g l cos q, s the deflection.
    load = J_link * q[2] + mass * 9.81 * arm * np.cos(q[0])
    samples = plan(t)
    motor, spring = samples.x[:, 0] + plant.configuration.qpos[0], samples.x[:, 1] + plant.configuration.qpos[1]
    spring_speed = samples.x[:, 3]
    np.testing.assert_allclose(-k * spring - d * spring_speed, load, atol=1e-7 * np.max(np.abs(load)))
    np.testing.assert_allclose(motor + spring, q[0], atol=1e-8)
    motor_acceleration = np.gradient(samples.x[:, 2], t, edge_order=2)
    torque = J_motor * motor_acceleration + b * samples.x[:, 2] + load
    inside = slice(1, -1)
    np.testing.assert_allclose(samples.u[inside, 0], torque[inside], atol=2e-3 * np.max(np.abs(torque)))


def test_a_linear_plant_gives_the_linear_inverse_through_its_jumps() -> None:
    plant, reference = cantilever_plant(), invtrack.raised_cosine(2.0)
    schedule = [invtrack.Change(t, tip_mass=m) for t, m in zip(JUMPS, MASSES[1:], strict=True)]
    plan = invtrack.invert(plant, reference, schedule=schedule, accuracy=1e-10)
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=m) for m in MASSES], JUMPS)
    linear = invtrack.invert(model, reference)
    assert plan.schedule == linear.schedule
    t = np.linspace(-20.0, 20.0, 801)
    # Inputs are cubics on each element, off by their next term; states and outputs feel no more than their integrals.
    for name, tolerance in (("x", 2e-8), ("u", 2e-6), ("y", 2e-8)):
        ours, theirs = getattr(plan(t), name), getattr(linear(t), name)
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=tolerance * np.max(np.abs(theirs)))


def test_plans_far_outside_the_window_are_those_of_the_linear_models() -> None:
    plan = invtrack.invert(cart_pole(), invtrack.rest_to_rest(0.0, 3.0, duration=2.0))
    whole = invtrack.invert(cart_pole(), invtrack.rest_to_rest(0.0, 3.0, duration=2.0), accuracy=1e-11)
    assert plan.breakpoints[0] > whole.breakpoints[0] + 0.5  # asked for more, the window reaches further out
    t = np.linspace(-5.0, 7.0, 601)
    np.testing.assert_allclose(plan.states(t), whole.states(t), atol=1e-7)
    outside = (t < plan.breakpoints[0]) | (t > plan.breakpoints[-1])
    np.testing.assert_allclose(plan.inputs(t[outside]), whole.inputs(t[outside]), atol=1e-7)
    # Within, inputs are cubics on each element, off by their next term.
    np.testing.assert_allclose(plan.inputs(t), whole.inputs(t), atol=4e-7 * np.max(np.abs(whole.inputs(t))))
