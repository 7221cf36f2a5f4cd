"""Redesign on the nonlinear motion: against the linear optimum, against every neighbour, and as it is driven in MuJoCo."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

import invtrack
from invtrack.errors import PlanError, RedesignError
from invtrack.redesign import OptimalMotion, cost
from invtrack.references import stack
from tests.inversion.nonlinear.mechanisms import CART_POLE, PVTOL

Array = NDArray[np.float64]

WEIGHTS = {"R": 1e-2, "Q_y": 1.0}
GRAVITY, MASS, INERTIA, TILT = 9.81, 1.0, 0.2, 0.15  # of the PVTOL in closed form


def pvtol() -> invtrack.Plant:
    return invtrack.Plant.from_xml(PVTOL, inputs=["thrust", "turn"], outputs=["site:c:x", "site:c:z"], keyframe="hover")


def aside(distance: float) -> invtrack.PiecewiseSignal:
    return stack([invtrack.rest_to_rest(0.0, amount, duration=2.0) for amount in (distance, 0.0)])


@cache
def redesigned(distance: float = 3.0, hold: float | None = None) -> OptimalMotion:
    plan = invtrack.quadratic_redesign(pvtol(), aside(distance), hold=hold, **WEIGHTS)
    assert isinstance(plan, OptimalMotion)
    return plan


def costs_of_inputs(plan: OptimalMotion, bumps: Array) -> Array:
    """Of the plan's inputs with bumps (k, 3), a time [s] and an amount for each input, in closed form and not by MuJoCo.

    Feedback brings the aircraft back; classical RK4 in steps of 4 ms.
    """
    K, h = invtrack.lqr(invtrack.linearize(pvtol()), Q=1.0, R=1.0).gains[0], 4e-3
    times = h / 2 * np.arange(round((plan.start - 1.0) / h) * 2, round((plan.end + 6.0) / h) * 2 + 1)
    at = plan(times)
    weight = np.exp(-(((times[:, None] - bumps[:, 0]) / 0.4) ** 2))

    def rates(j: int, state: Array) -> Array:
        x, z, roll = state[:3]
        thrust, turn = at.u[j][:, None] - K @ (state[:6] - at.x[j][:, None]) + weight[j] * bumps[:, 1:].T
        # The roll axis is -y: a positive angle turns the right wing up, and the thrust to the left.
        sine, cosine, push = np.sin(roll), np.cos(roll), TILT * turn
        across, up = (cosine * push - sine * thrust) / MASS, (sine * push + cosine * thrust) / MASS - GRAVITY
        error = (x - at.y_d[j, 0]) ** 2 + (z - at.y_d[j, 1]) ** 2
        rate = WEIGHTS["R"] * ((thrust - MASS * GRAVITY) ** 2 + turn**2) + WEIGHTS["Q_y"] * error
        return np.array([*state[3:6], across, up, turn / INERTIA, rate])

    state = np.vstack([np.repeat(at.x[:1].T, len(bumps), axis=1), np.zeros(len(bumps))])
    for j in range(0, len(times) - 1, 2):
        first = rates(j, state)
        second = rates(j + 1, state + h / 2 * first)
        third = rates(j + 1, state + h / 2 * second)
        state = state + h / 6 * (first + 2 * second + 2 * third + rates(j + 2, state + h * third))
    return np.asarray(state[-1])


def test_on_a_linear_mechanism_with_jumps_it_is_the_linear_optimum() -> None:
    plant = invtrack.Plant.from_xml(
        invtrack.model_path("cantilever"),
        inputs=["base_force"],
        outputs=["tip_position"],
        parameters={"tip_mass": "body:tip:mass"},
    )
    masses, jumps = (0.0, 100.0, 10.0), (np.pi / 2, 3 * np.pi / 2)
    model = invtrack.SwitchedSystem([invtrack.linearize(plant, tip_mass=mass) for mass in masses], jumps)
    wanted, weights = invtrack.raised_cosine(2.0), {"R": 1e-5, "Q_y": 1.0}
    schedule = [invtrack.Change(t, tip_mass=mass) for t, mass in zip(jumps, masses[1:], strict=True)]
    found = invtrack.quadratic_redesign(plant, wanted, schedule=schedule, **weights)
    linear = invtrack.quadratic_redesign(model, wanted, **weights)
    assert isinstance(found, OptimalMotion)
    assert found.cost == pytest.approx(cost(linear, **weights), rel=1e-9)
    times = np.linspace(-20.0, 25.0, 400)
    np.testing.assert_allclose(found.inputs(times), linear.inputs(times), atol=2e-5 * np.max(np.abs(linear.inputs(times))))
    np.testing.assert_allclose(found(times).y, linear(times).y, atol=1e-6)


def test_a_small_motion_is_that_of_the_linear_model() -> None:
    weights = {"R": 1e-2, "Q_x": 1e-3 * np.diag([0.0, 0.0, 1.0, 0.0, 0.0, 1.0]), "Q_y": 1.0}
    found = invtrack.quadratic_redesign(pvtol(), aside(1e-4), **weights)
    linear = invtrack.quadratic_redesign(invtrack.linearize(pvtol()), aside(1e-4), **weights)
    assert isinstance(found, OptimalMotion)
    assert found.cost == pytest.approx(cost(linear, **weights), rel=1e-7)


def test_every_change_of_the_input_costs_more() -> None:
    plan = redesigned()
    bumps = np.array([[0.4, 3e-3, 1e-2], [1.2, -1e-2, 2e-3], [-0.3, 0.0, 1e-2]])
    costs = costs_of_inputs(plan, np.vstack([np.zeros((1, 3)), bumps, bumps * np.array([1.0, -1.0, -1.0])]))
    assert costs[0] == pytest.approx(plan.cost, rel=1e-7)
    rise, slope = (costs[1:4] + costs[4:]) / 2 - costs[0], costs[1:4] - costs[4:]
    assert np.all(rise > 1e-6 * plan.cost)
    assert np.all(np.abs(slope) < 0.02 * rise)  # nothing but curvature


def test_its_cost_is_that_of_its_values_and_it_says_how_far_from_stationary_it_can_be() -> None:
    plan = redesigned()
    assert cost(plan, **WEIGHTS) == pytest.approx(plan.cost, rel=1e-9)
    assert plan.optimality_gap < 1e-9
    assert plan.certificate.dynamics_residual < 1e-8


def test_it_converges_in_a_few_steps_each_of_which_lowers_the_cost() -> None:
    steps = redesigned().iterations
    first = [step for step in steps if step.mesh == 1]
    assert len(first) <= 8
    costs = [step.cost for step in first]
    assert costs == sorted(costs, reverse=True)
    assert steps[-1].decrease < 1e-7


def test_held_inputs_are_driven_as_planned_at_the_planned_cost() -> None:
    hold = 0.02
    plan = redesigned(hold=hold)
    run = invtrack.simulate(pvtol(), invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0)), timestep=hold)
    middles = (run.time[1:] + run.time[:-1]) / 2
    spent = invtrack.results.run_cost(run, u_0=plan.steady.inputs(middles), wanted=plan.reference(run.time), **WEIGHTS)
    assert spent == pytest.approx(plan.cost, rel=2e-6)  # the trapezoidal rule of run_cost, at 0.02 s
    np.testing.assert_allclose(run.output.values, plan(run.time).y, atol=1e-6)
    assert plan.cost > redesigned().cost  # held inputs are some of all inputs


def test_the_unit_of_the_cost_changes_nothing() -> None:
    scaled = invtrack.quadratic_redesign(pvtol(), aside(3.0), **{name: 2.0**40 * weight for name, weight in WEIGHTS.items()})
    times = np.linspace(-2.0, 4.0, 50)
    np.testing.assert_allclose(scaled.inputs(times), redesigned().inputs(times), rtol=1e-12)


def test_it_takes_more_outputs_than_inputs() -> None:
    plant = invtrack.Plant.from_xml(CART_POLE, inputs=["force"], outputs=["joint:cart", "joint:pole"])
    wanted = stack([invtrack.rest_to_rest(0.0, amount, duration=2.0) for amount in (1.0, 0.0)])
    plan = invtrack.quadratic_redesign(plant, wanted, R=1e-3, Q_y=np.diag([1.0, 0.1]))
    assert plan.optimality_gap < 1e-9


def test_refusals_name_their_reason() -> None:
    plant, wanted = pvtol(), aside(1.0)
    with pytest.raises(RedesignError, match="Q_y is zero"):
        invtrack.quadratic_redesign(plant, wanted, R=1.0, Q_y=0.0)
    with pytest.raises(RedesignError, match="R must be positive definite"):
        invtrack.quadratic_redesign(plant, wanted, R=0.0, Q_y=1.0)
    with pytest.raises(RedesignError, match="weighs the mode"):
        invtrack.quadratic_redesign(plant, wanted, R=1.0, Q_y=np.diag([1.0, 0.0]))
    with pytest.raises(RedesignError, match="probabilities are for a list of linear models"):
        invtrack.quadratic_redesign(plant, wanted, R=1.0, Q_y=1.0, probabilities=[1.0])
    with pytest.raises(RedesignError, match="hold is for a Plant"):
        invtrack.quadratic_redesign(invtrack.linearize(plant), wanted, R=1.0, Q_y=1.0, hold=0.1)
    with pytest.raises(PlanError, match="the reference begins at"):
        invtrack.quadratic_redesign(plant, stack([invtrack.rest_to_rest(a, a + 1.0, duration=1.0) for a in (1.0, 0.0)]), **WEIGHTS)
