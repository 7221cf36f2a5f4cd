"""Redesign within limits on the nonlinear motion: limits kept, at a cost that any alternative exceeds, as driven in MuJoCo."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

import invtrack
from invtrack.errors import RedesignError
from invtrack.redesign import ConstrainedMotion, cost
from tests.inversion.nonlinear.mechanisms import CART_POLE
from tests.redesign.nonlinear.test_motion_redesign import WEIGHTS, aside, pvtol, redesigned

HOLD = 0.04
LOW, HIGH = (9.6, -0.45), (10.15, 0.45)


@cache
def limited() -> ConstrainedMotion:
    limits = invtrack.Limits(input=(LOW, HIGH))
    plan = invtrack.constrained_redesign(pvtol(), aside(3.0), limits=limits, hold=HOLD, **WEIGHTS)
    assert isinstance(plan, ConstrainedMotion)
    return plan


def test_inputs_keep_their_limits_in_mujoco_at_the_planned_cost() -> None:
    plan = limited()
    low, high = plan.input_range
    np.testing.assert_array_less(np.array(LOW) - 1e-9, low)
    np.testing.assert_array_less(high, np.array(HIGH) + 1e-9)
    run = invtrack.simulate(pvtol(), invtrack.TrackingController(plan, invtrack.lqr(plan, Q=1.0, R=1.0)), timestep=HOLD)
    assert np.all(run.applied.values > np.array(LOW) - 1e-5)
    assert np.all(run.applied.values < np.array(HIGH) + 1e-5)
    np.testing.assert_allclose(run.output.values, plan(run.time).y, atol=2e-6)
    assert plan.optimality is not None
    assert cost(plan, **WEIGHTS) == pytest.approx(plan.optimality.cost, rel=1e-7)
    assert plan.optimality.duality_gap < 1e-6
    assert plan.optimality.cost > redesigned().cost


def test_the_multipliers_are_what_more_room_is_worth() -> None:
    plan, wider = limited(), 0.004
    limits = invtrack.Limits(input=(LOW, (HIGH[0] + wider, HIGH[1])))
    other = invtrack.constrained_redesign(pvtol(), aside(3.0), limits=limits, hold=HOLD, **WEIGHTS)
    assert plan.optimality is not None
    assert other.optimality is not None
    both = [sum(a.multiplier for a in each.active if a.name == "input 'thrust'") for each in (plan, other)]
    assert plan.optimality.cost - other.optimality.cost == pytest.approx(wider * sum(both) / 2, rel=1e-2)  # the trapezoid


def test_rates_outputs_and_states_are_limited_too() -> None:
    plant = invtrack.Plant.from_xml(CART_POLE, inputs=["force"], outputs=["joint:cart"])
    wanted, weights = invtrack.rest_to_rest(0.0, 1.0, duration=2.0), {"R": 1e-3, "Q_y": 1.0}
    free = invtrack.quadratic_redesign(plant, wanted, **weights)
    times = np.linspace(-4.0, 6.0, 2001)
    pole = plant.states.names.index("pole")
    leans, rate = np.max(np.abs(free(times).x[:, pole])), np.max(np.abs(np.gradient(free.inputs(times)[:, 0], times)))
    limits = invtrack.Limits(
        input_rate=0.8 * rate, output=(-0.1, 1.0005), states=[invtrack.StateLimit("lean", {"pole": 1.0}, 0.9 * float(leans))]
    )
    plan = invtrack.constrained_redesign(plant, wanted, limits=limits, step=0.04, **weights)
    at = plan(times)
    assert np.max(np.abs(at.x[:, pole])) < 0.9 * leans * (1 + 2e-4)
    assert np.max(at.y) < 1.0005 + 2e-4
    assert np.max(np.abs(np.diff(at.u[:, 0]) / np.diff(times))) < 0.8 * rate * (1 + 1e-6)
    assert {active.name for active in plan.active} >= {"'lean'"}


def test_where_no_limit_acts_it_is_the_optimum_without_them() -> None:
    plan = invtrack.constrained_redesign(pvtol(), aside(3.0), limits=invtrack.Limits(input=[20.0, 5.0]), **WEIGHTS)
    times = np.linspace(-1.0, 3.0, 20)
    np.testing.assert_array_equal(plan.inputs(times), redesigned().inputs(times))


def test_refusals_name_their_reason() -> None:
    with pytest.raises(RedesignError, match="jump from hold to hold"):
        invtrack.constrained_redesign(pvtol(), aside(1.0), limits=invtrack.Limits(input_rate=1.0), hold=0.1, **WEIGHTS)
    with pytest.raises(RedesignError, match="limits that cannot be kept: at rest before"):
        invtrack.constrained_redesign(pvtol(), aside(1.0), limits=invtrack.Limits(input=[9.0, 1.0]), **WEIGHTS)
    with pytest.raises(RedesignError, match="at rest after"):
        invtrack.constrained_redesign(pvtol(), aside(1.0), limits=invtrack.Limits(output=[0.5, 0.1]), **WEIGHTS)
    model, limits, changes = invtrack.linearize(pvtol()), invtrack.Limits(input=20.0), [invtrack.Change(0.5, mass=1.0)]
    with pytest.raises(RedesignError, match="schedule is for a Plant"):
        invtrack.constrained_redesign(model, aside(1.0), limits=limits, schedule=changes, **WEIGHTS)
