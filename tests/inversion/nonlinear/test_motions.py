"""Plans on nonlinear motions, driven in MuJoCo: RK4, 1 ms, feedback by LQR about the start."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

import invtrack
from invtrack.references import stack
from tests.inversion.nonlinear.mechanisms import (
    cart_pole,
    flexible_joint,
    link,
    pvtol,
    satellite,
    sideways,
    two_flexible_joints,
)

PAYLOADS = [invtrack.Change(0.3, payload=0.5), invtrack.Change(0.7, payload=0.1)]


def driven(plant: invtrack.Plant, plan: invtrack.Plan, timestep: float = 1e-3) -> float:
    """The largest error of a closed-loop run from rest, as a share of the motion."""
    gains = invtrack.lqr(invtrack.linearize(plant), Q=1.0, R=1.0)
    run = invtrack.simulate(plant, invtrack.TrackingController(plan, gains), timestep=timestep)
    assert run.status == "completed"
    return invtrack.max_error(run) / float(np.max(np.ptp(run.reference.values, axis=0)))


CASES = {
    # 2.4e-2 of the motion with the linear inverse.
    "cart-pole, 3 m": (cart_pole, invtrack.rest_to_rest(0.0, 3.0, duration=2.0), (), 1e-6),
    # Diverges with the linear inverse.
    "cart-pole, 10 m": (cart_pole, invtrack.rest_to_rest(0.0, 10.0, duration=2.0), (), 3e-6),
    "flexible joint, raised": (flexible_joint, invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0, smoothness=5), (), 4e-5),
    "two flexible joints": (
        two_flexible_joints,
        stack([invtrack.rest_to_rest(0.0, a, duration=1.0, smoothness=5) for a in (1.0, -0.7)]),
        (),
        4e-5,
    ),
    "pvtol, 3 m": (pvtol, sideways(3.0), (), 3e-6),
    "flexible link": (link, invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0), (), 2e-5),
    "flexible link, raised": (
        lambda: link(hanging=True),
        invtrack.rest_to_rest(-np.pi / 3, np.pi / 6, duration=1.0),
        (),
        5e-5,
    ),
    "flexible link, payloads": (link, invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0), PAYLOADS, 2e-4),
    "flexible link, raised with payloads": (
        lambda: link(hanging=True),
        invtrack.rest_to_rest(-np.pi / 3, np.pi / 6, duration=1.0),
        PAYLOADS,
        4e-4,
    ),
}

STEPS = 6
"""Of Newton's method, from rest to the plan, on all meshes together."""


@pytest.mark.parametrize("case", CASES)
def test_a_plan_with_its_inputs_averaged_over_each_step(case: str) -> None:
    make, reference, schedule, limit = CASES[case]
    plant = make()
    plan = invtrack.invert(plant, reference, schedule=schedule)
    assert driven(plant, plan) <= limit
    assert len(plan.iterations) <= STEPS  # type: ignore[attr-defined]
    assert plan.certificate.worst(exact=True) <= 1e-7
    assert plan.certificate.rest_residual <= 1e-8
    assert len(plan.schedule) == len(schedule)


@pytest.mark.parametrize("case", ["cart-pole, 3 m", "two flexible joints", "pvtol, 3 m", "flexible link, raised"])
def test_a_plan_for_the_hold_that_drives_it(case: str) -> None:
    make, reference, schedule, _ = CASES[case]
    plant = make()
    plan = invtrack.invert(plant, reference, schedule=schedule, hold=1e-3)
    assert isinstance(plan, invtrack.inversion.MotionPlan)
    assert driven(plant, plan) <= 1e-7
    assert len(plan.iterations) <= STEPS
    assert plan.iterations[0].coefficients > plan.iterations[-1].coefficients == 1
    assert any("zero-order hold of 0.001 s" in remark for remark in plan.remarks)


def test_beside_a_jump_a_hold_leaves_what_it_cannot_follow() -> None:
    """Zeros at 660 rad/s ask for an input that changes within a hold of 1 ms: what they leave is spread over middles and ends."""
    make, reference, schedule, _ = CASES["flexible link, raised with payloads"]
    plant, errors = make(), []
    for hold in (1e-3, 5e-4):
        plan = invtrack.invert(plant, reference, schedule=schedule, hold=hold)
        assert isinstance(plan, invtrack.inversion.MotionPlan)
        assert len(plan.iterations) <= STEPS
        controller = invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0))
        run = invtrack.simulate(plant, controller, timestep=hold)
        error = np.abs(run.output.values - run.reference.values)[:, 0] / (np.pi / 2)
        beside = np.any([np.abs(run.time - change.time) < 8 * hold for change in schedule], axis=0)
        assert np.max(error[~beside]) <= 0.5 * np.max(error[beside])
        assert np.max(error) == pytest.approx(plan.certificate.output_error, rel=0.2)
        errors.append(np.max(error[beside]))
    assert errors[0] <= 1e-7
    assert np.log2(errors[0] / errors[1]) > 2.5


def test_averaging_over_each_step_costs_its_square() -> None:
    plant = cart_pole()
    plan = invtrack.invert(plant, invtrack.rest_to_rest(0.0, 3.0, duration=2.0))
    steps = [8e-3, 4e-3, 2e-3]
    errors = [driven(plant, plan, step) for step in steps]
    np.testing.assert_allclose(np.diff(np.log(errors)) / np.diff(np.log(steps)), 2.0, atol=0.1)


def test_newton_converges_quadratically_and_says_so() -> None:
    seen: list[float] = []
    plan = invtrack.invert(cart_pole(), invtrack.rest_to_rest(0.0, 10.0, duration=2.0), progress=seen.append)
    assert isinstance(plan, invtrack.inversion.MotionPlan)
    assert set(seen) == {1.0}
    steps = [iteration.step for iteration in plan.iterations]
    assert steps[0] == pytest.approx(1.0)  # from rest: this one is the linear inverse on the same elements
    assert steps[1] > 0.1
    assert all(after <= before**2 for before, after in pairwise(steps[1:]))
    assert plan.iterations[-1].mesh > 1  # although the mesh has changed on the way
    assert plan.iterations[-1].elements > plan.iterations[0].elements


def test_a_motion_that_newton_does_not_reach_at_once_is_followed() -> None:
    seen: list[float] = []
    plan = invtrack.invert(cart_pole(), invtrack.rest_to_rest(0.0, 40.0, duration=2.0), progress=seen.append)
    assert isinstance(plan, invtrack.inversion.MotionPlan)
    assert seen == sorted(seen)
    assert seen[-1] == 1.0
    assert {iteration.amplitude for iteration in plan.iterations} >= {0.5, 1.0}
    pole = plan.states(np.linspace(0.0, 2.0, 401))[:, 1]
    assert np.max(np.abs(pole)) > np.radians(70)
    assert plan.certificate.worst(exact=True) <= 1e-7


def test_the_equilibria_of_both_ends_are_met_by_gravity() -> None:
    plant = flexible_joint()
    plan = invtrack.invert(plant, invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0, smoothness=5))
    weight = plant.model.body_mass[-1] * 9.81 * 0.25
    np.testing.assert_allclose(plan.rest_inputs[:, 0], [weight, 0.0], atol=1e-8 * weight)


def test_preactuation_may_be_cut_and_is_told() -> None:
    reference = invtrack.rest_to_rest(0.0, 1.0, duration=2.0)
    plan = invtrack.invert(cart_pole(), reference, max_preactuation=1.5)
    assert plan.preactuation == pytest.approx(1.5)
    assert any("preactuation limited" in remark for remark in plan.remarks)


def test_a_body_that_turns_in_space_as_it_moves() -> None:
    """By two radians about a skew axis: gains of both ends, and states that differ as rotations do."""
    plant, distances = satellite(), (0.5, -1.0, 0.3, 1.5, -1.0, 0.8)
    plan = invtrack.invert(plant, stack([invtrack.rest_to_rest(0.0, a, duration=2.0) for a in distances]))
    assert plan.certificate.worst(exact=True) <= 1e-9
    controller = invtrack.TrackingController(plan, invtrack.lqr(plan.model, Q=1.0, R=1.0))
    run = invtrack.simulate(plant, controller, timestep=1e-3, end=3.0, vibration_period=1.0)
    assert invtrack.max_error(run) <= 1e-6
    half_way = plan.states([1.0])[0]
    np.testing.assert_allclose(plan.difference(half_way, half_way), 0.0, atol=1e-15)  # type: ignore[misc]
