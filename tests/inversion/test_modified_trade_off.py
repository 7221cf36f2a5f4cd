"""The planner: preactuation against error, and the plan that makes the best of what can be afforded."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.inversion.modified.error_bound import error_bound
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.modified.preactuation_trade_off import preactuation_trade_off, tune_modified_inversion
from invtrack.plans.actuation import plan_actuation_time
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import stack
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, PASSIVE_TWO_DISC, TWO_DISC, moved_pair
from tests.linear.random_plants import block, plant_with

SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)
CHAIN = [-1.0, -2.0]


def test_each_point_is_its_plan() -> None:
    trade = preactuation_trade_off(TWO_DISC, SLEW, real_parts=[0.5, 2.0], error_poles=CHAIN, axis_distance=0.5, level=0.02)
    for point, to in zip(trade.points, (0.5, 2.0), strict=True):
        plan = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=to, error_poles=CHAIN)
        assert (point.real_part, point.alpha) == (to, pytest.approx(to))
        assert point.preactuation == pytest.approx(plan_actuation_time(plan, "before", 0.02))
        assert point.max_error == pytest.approx(plan.max_error[0])
        assert point.error_bound == error_bound(TWO_DISC, SLEW, start=-point.preactuation)
        assert point.error_after == pytest.approx(plan.max_error_after[0])
        assert point.peak_input == pytest.approx(np.max(np.abs(plan.input_range)))


def test_preactuation_falls_and_error_rises() -> None:
    trade = preactuation_trade_off(TWO_DISC, SLEW, real_parts=[0.22, 0.5, 1.0, 2.0, 4.0], error_poles=CHAIN, axis_distance=0.5)
    assert np.all(np.diff(trade.column("preactuation")) < 0)
    assert np.all(np.diff(trade.column("max_error")) > 0)
    assert np.all(np.diff(trade.column("error_bound")) > 0)  # the less time there is, the less any plan can do
    assert "error after [-]" in str(trade)
    assert len(str(trade).splitlines()) == 2 + 5


def test_negative_real_parts_need_no_preactuation() -> None:
    trade = preactuation_trade_off(TWO_DISC, SLEW, real_parts=[-1.0], error_poles=CHAIN, axis_distance=0.5)
    assert trade.column("preactuation")[0] == 0.0
    assert trade.column("alpha")[0] == np.inf


@pytest.mark.parametrize("wish", [8.0, 2.0])
def test_plan_within_a_preactuation(wish: float) -> None:
    plan = tune_modified_inversion(TWO_DISC, SLEW, error_poles=CHAIN, preactuation=wish, axis_distance=0.5, design="robust")
    # The preactuation of an input that oscillates jumps from one of its half periods to the next.
    assert wish - np.pi / 4.74976 < plan_actuation_time(plan, "before") <= wish
    nearer = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=0.99 * plan.alpha, error_poles=CHAIN, design="robust")
    assert plan_actuation_time(nearer, "before") > wish  # no need to move the zeros less far, no room either


def test_plan_within_an_error() -> None:
    plan = tune_modified_inversion(TWO_DISC, SLEW, error_poles=CHAIN, error=0.005, zeros=[0.22 + 4.75j])
    assert 0.99 * 0.005 < plan.relative_error <= 0.005
    farther = modified_inversion(TWO_DISC, SLEW, axis_distance=0.5, real_part=1.05 * plan.alpha, error_poles=CHAIN)
    assert farther.relative_error > 0.005


def test_affordable_from_the_start() -> None:
    plan = tune_modified_inversion(TWO_DISC, SLEW, error_poles=CHAIN, preactuation=100.0, axis_distance=0.5)
    assert plan.alpha == pytest.approx(0.21998, rel=1e-4)
    assert plan.relative_error < 1e-5


def test_zeros_on_the_axis() -> None:
    plan = tune_modified_inversion(
        PASSIVE_TWO_DISC, SLEW, error_poles=CHAIN, preactuation=5.0, axis_distance=0.1, real_parts=(0.5, 2.0), design="robust"
    )
    assert 5.0 - np.pi / 4.755 < plan_actuation_time(plan, "before") <= 5.0


def test_several_outputs_afford_any_error() -> None:
    """The search starts where the zeros are, which costs nothing."""
    plant = plant_with(np.random.default_rng(1), (1, 2), block(0.05 + 1.3j, -0.4, 1.5))
    reference = stack([SLEW, SLEW.scaled(0.5)])
    plan = tune_modified_inversion(plant, reference, error_poles=[-1.0, -2.0, -3.0], error=0.05, axis_distance=0.1)
    assert 0.99 * 0.05 < plan.relative_error <= 0.05
    assert plan.alpha > 0.05


def test_hover() -> None:
    pair, _ = moved_pair(2.0)
    plan = tune_modified_inversion(HE3, HOVER, error_poles=HE3_POLES, preactuation=4.0, zeros=[pair], design="robust")
    assert 0.99 * 4.0 < plan_actuation_time(plan, "before") <= 4.0
