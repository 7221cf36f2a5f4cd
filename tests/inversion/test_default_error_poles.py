"""The default poles of the output's error, against poles picked by hand over the plants of the literature."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.signal

from invtrack.inversion.modified.default_error_poles import butterworth, default_error_poles
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.modified.preactuation_trade_off import preactuation_trade_off, tune_modified_inversion
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.profiles import rest_to_rest
from tests.cited_plants import cantilever_paper
from tests.inversion.modified_cases import HE3, HE3_POLES, HOVER, PASSIVE_TWO_DISC, TWO_DISC, moved_pair
from tests.inversion.test_repeated_zeros import HOVER_ZERO, hovering

NEAR_AXIS: dict[str, Any] = {"axis_distance": 0.5, "real_part": 2.0}
CANTILEVER = StateSpace(*cantilever_paper(0.0))


def slew(duration: float) -> Any:
    return rest_to_rest(0.0, 1.0, duration, smoothness=3)


PLANTS: dict[str, tuple[StateSpace, Any, dict[str, Any], list[list[float]]]] = {
    "rig, 2.5 s": (TWO_DISC, slew(2.5), NEAR_AXIS, [[-1, -2], [-4, -5], [-10, -12], [-20, -25]]),
    "rig, 5 s": (TWO_DISC, slew(5.0), NEAR_AXIS, [[-1, -2], [-4, -5], [-10, -12], [-20, -25]]),
    "rig, 20 s": (TWO_DISC, slew(20.0), NEAR_AXIS, [[-1, -2], [-4, -5], [-10, -12], [-20, -25]]),
    "passive rig": (PASSIVE_TWO_DISC, slew(5.0), NEAR_AXIS, [[-1, -2], [-4, -5], [-10, -12], [-20, -25]]),
    "helicopter": (HE3, HOVER, {"move": moved_pair(2.0)[1]}, [HE3_POLES, [-5, -6, -7, -8], [-10, -12, -14, -16]]),
    "cantilever": (CANTILEVER, slew(20.0), {"move": {0.234538: 1.0}}, [[-1, -2], [-4, -5]]),
    "hovering vehicle": (
        hovering(),
        rest_to_rest([0.0, 0.0], [1.0, -0.5], 3.0, smoothness=3),
        {"move": {HOVER_ZERO: 30.0}},
        [[-4, -5] * 2, [-20, -25] * 2, [-60, -70] * 2],
    ),
}


@pytest.mark.parametrize("name", PLANTS)
def test_as_good_as_what_a_search_by_hand_finds(name: str) -> None:
    plant, reference, options, hand_picked = PLANTS[name]
    default = modified_inversion(plant, reference, **options)
    others = [modified_inversion(plant, reference, error_poles=poles, **options) for poles in hand_picked]
    assert default.relative_error < 1.5 * min(plan.relative_error for plan in others)
    peaks = [float(np.max(np.abs(plan.input_range))) for plan in (default, others[-1])]
    assert peaks[0] < 1.05 * peaks[1]  # the fastest poles ask for most


@pytest.mark.parametrize("order", range(6))
def test_butterworth_pattern(order: int) -> None:
    expected = scipy.signal.buttap(order)[1] if order else np.zeros(0)
    np.testing.assert_allclose(np.sort_complex(butterworth(order)), np.sort_complex(expected), atol=1e-14)


def test_units_of_time_and_outputs_without_a_chain() -> None:
    poles = default_error_poles((2, 0, 1), np.array([1 + 2j, 1 - 2j, -3.0]), 4.0)
    np.testing.assert_allclose(default_error_poles((2, 0, 1), np.array([10 + 20j, 10 - 20j, -30.0]), 0.4), 10 * poles)
    np.testing.assert_allclose(np.abs(poles), 3.75)
    assert len(poles) == 3
    np.testing.assert_allclose(default_error_poles((1,), np.zeros(0), 4.0), [-2.5])


def test_all_intervals_share_the_pace() -> None:
    model = SwitchedSystem([TWO_DISC, TWO_DISC], [2.0])
    plan = modified_inversion(model, slew(5.0), move={0.22 + 4.75j: 2 + 4.75j}, interval=1, design="robust")
    np.testing.assert_array_equal(plan.modification[0].error_poles, plan.modification[1].error_poles)
    np.testing.assert_allclose(np.abs(plan.modification[0].error_poles), 1.25 * abs(2 + 4.75j))


def test_the_planner_takes_it_too() -> None:
    trade = preactuation_trade_off(TWO_DISC, slew(5.0), real_parts=[0.5, 2.0], axis_distance=0.5, design="robust")
    assert trade.points[1].max_error == modified_inversion(TWO_DISC, slew(5.0), design="robust", **NEAR_AXIS).relative_error
    plan = tune_modified_inversion(TWO_DISC, slew(5.0), error=0.01, axis_distance=0.5, design="robust")
    assert plan.relative_error <= 0.01
