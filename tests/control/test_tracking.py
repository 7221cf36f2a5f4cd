"""Feedforward with state feedback against direct evaluation of u = u_ff - K (x - x_ref)."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from invtrack.control.gains import GainSchedule
from invtrack.control.lqr import lqr
from invtrack.control.protocol import Instants
from invtrack.control.tracking_controller import TrackingController
from invtrack.errors import ControlError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.references.profiles import constant, raised_cosine
from tests.cited_plants import cantilever_paper

LIGHT, HEAVY = StateSpace(*cantilever_paper(0.0)), StateSpace(*cantilever_paper(100.0))


@pytest.fixture(scope="module")
def plan() -> Plan:
    return invert(SwitchedSystem([LIGHT, HEAVY], [2.0]), raised_cosine(2.0))


def instants(edges: list[float], hold: float) -> Instants:
    """Both sides of each edge, and points between."""
    middles = [(a + b) / 2 for a, b in pairwise(edges)]
    time = [t for a, b in pairwise(edges) for t in (a, (a + b) / 2, b - hold)]
    return undivided(np.array(time), hold, np.repeat(middles, 3))


def undivided(time: np.ndarray, hold: float, inside: np.ndarray) -> Instants:
    """Instants whose holds contain no breakpoint."""
    m = len(time)
    return Instants(time, np.full(m, hold), inside, np.arange(m), time + hold / 2, inside, np.ones(m))


def test_against_direct_evaluation_with_gains_that_switch_at_other_times(plan: Plan) -> None:
    gains = GainSchedule((np.full((1, 6), 2.0), np.arange(6.0)[None]), np.array([4.0]))
    controller = TrackingController(plan, gains)
    assert controller.breakpoints == pytest.approx(np.array([0.0, 2.0, 4.0, 2 * np.pi]))
    asked = instants([-1.0, 0.0, 2.0, 4.0, 2 * np.pi, 9.0], hold=0.25)
    law = controller.begin(asked)
    rng = np.random.default_rng(0)
    for i, (t, inside) in enumerate(zip(asked.time, asked.inside, strict=True)):
        x = rng.normal(size=6)
        u_ff = plan(t + 0.125, inside=inside).u[0]
        x_ref = plan(t, inside=inside).x[0]
        K = gains.gains[0] if inside < 4.0 else gains.gains[1]
        assert law.update(i, x) == pytest.approx(u_ff - K @ (x - x_ref), rel=1e-12, abs=1e-9)


def test_limits_from_both_sides_of_a_jump(plan: Plan) -> None:
    """At the plan's jump the feedforward has two values, at the gains' jump the gain has."""
    K = lqr(plan.model, Q=1.0, R=1.0)
    law = TrackingController(plan, K).begin(undivided(np.array([2.0, 2.0]), 0.0, np.array([1.9, 2.1])))
    x = plan(2.0).x[0]
    left, right = law.update(0, x)[0], law.update(1, x)[0]
    assert left == pytest.approx(plan(2.0, inside=1.9).u[0, 0], abs=1e-9)
    assert right == pytest.approx(plan(2.0, inside=2.1).u[0, 0], abs=1e-9)
    assert abs(left - right) > 1.0
    push = np.eye(6)[1]
    assert law.update(0, x + push)[0] - left == pytest.approx(-K.gains[0][0, 1], rel=1e-9)
    assert law.update(1, x + push)[0] - right == pytest.approx(-K.gains[1][0, 1], rel=1e-9)


def test_on_the_plan_feedback_does_nothing(plan: Plan) -> None:
    times = np.linspace(-5.0, 15.0, 60)
    asked = undivided(times, 0.0, times)
    feedback = TrackingController(plan, np.full((1, 6), 50.0)).begin(asked)
    alone = TrackingController(plan).begin(asked)
    for i, x in enumerate(plan(times).x):
        assert feedback.update(i, x) == pytest.approx(alone.update(i, x), abs=1e-10)
        assert alone.update(i, x + 1.0) == pytest.approx(plan(times[i]).u[0])


def test_input_is_absolute_and_state_a_deviation() -> None:
    point = OperatingPoint(x0=np.zeros(6), u0=np.array([7.0]), y0=np.array([3.0]))
    plan = invert(StateSpace(LIGHT.A, LIGHT.B, LIGHT.C, operating_point=point), constant(3.0))
    law = TrackingController(plan, np.ones((1, 6))).begin(undivided(np.zeros(1), 0.0, np.zeros(1)))
    assert law.update(0, np.zeros(6)) == pytest.approx([7.0])
    assert law.update(0, np.full(6, 0.5)) == pytest.approx([4.0])


def test_the_same_controller_serves_any_number_of_runs(plan: Plan) -> None:
    controller = TrackingController(plan, np.ones((1, 6)))
    asked = instants([0.0, 2.0], hold=0.01)
    first, second = controller.begin(asked), controller.begin(asked)
    x = np.arange(6.0)
    assert np.array_equal(first.update(1, x), second.update(1, x))
    assert np.array_equal(first.update(1, x), first.update(1, x))
    assert controller.stateless
    assert controller.plan is plan


def test_a_hold_across_a_jump_takes_the_mean_of_both_sides(plan: Plan) -> None:
    """Held from 1.9 to 2.3 over the jump at 2: a quarter of the time before it, three quarters after it."""
    asked = Instants(
        time=np.array([1.9]),
        hold=np.array([0.4]),
        inside=np.array([1.95]),
        first=np.array([0]),
        part_middle=np.array([1.95, 2.15]),
        part_inside=np.array([1.95, 2.15]),
        part_share=np.array([0.25, 0.75]),
    )
    u = TrackingController(plan).begin(asked).update(0, np.zeros(6))[0]
    before, after = plan([1.95, 2.15]).u[:, 0]
    assert u == pytest.approx((before + 3 * after) / 4)
    t = np.linspace(1.9, 2.3, 4001)
    assert u == pytest.approx(np.mean(plan(t).u), rel=1e-2)


@pytest.mark.parametrize("period", [0.0, -1.0, np.nan, np.inf])
def test_a_period_that_is_no_time_is_refused(plan: Plan, period: float) -> None:
    with pytest.raises(ControlError, match="period must be a positive number of seconds"):
        TrackingController(plan, period=period)


@pytest.mark.parametrize("gain", [np.zeros((1, 5)), np.zeros((2, 6)), np.zeros(6)])
def test_a_gain_that_does_not_fit_is_refused(plan: Plan, gain: np.ndarray) -> None:
    with pytest.raises(ControlError, match=r"gains have shape .*, expected \(1, 6\)"):
        TrackingController(plan, gain)


def test_a_plan_with_a_difference_of_its_own(plan: Plan) -> None:
    """States that are angles: a whole turn away is no way at all."""

    def shortest(x: np.ndarray, x_ref: np.ndarray) -> np.ndarray:
        return (x - x_ref + np.pi) % (2 * np.pi) - np.pi

    gains = np.arange(1.0, 7.0)[None]
    asked = instants([0.0, 2.0], hold=0.1)
    plain = TrackingController(plan, gains).begin(asked)
    turning = TrackingController(replace(plan, difference=shortest), gains).begin(asked)
    x_ref = plan(asked.time, inside=asked.inside).x
    for i, x in enumerate(x_ref + np.linspace(-0.5, 0.5, 6)):
        assert turning.update(i, x) == pytest.approx(plain.update(i, x), rel=1e-9)
        assert turning.update(i, x + 2 * np.pi) == pytest.approx(plain.update(i, x), rel=1e-9)
        assert abs(plain.update(i, x + 2 * np.pi) - plain.update(i, x)) > 1.0
