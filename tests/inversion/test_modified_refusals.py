"""What modified inversion and its planner refuse, and what they say about it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from invtrack.errors import InversionError, NonHyperbolicError, PlanError, TrajectoryError
from invtrack.inversion.modified.modified_inversion import modified_inversion
from invtrack.inversion.modified.preactuation_trade_off import preactuation_trade_off, tune_modified_inversion
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.profiles import rest_to_rest
from tests.inversion.modified_cases import PASSIVE_TWO_DISC, TWO_DISC
from tests.linear.random_plants import block, plant_with

SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)
CHAIN = [-1.0, -2.0]


BY_DISTANCE = {"axis_distance": 0.5, "real_part": 1.0}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected either move="),
        ({"axis_distance": 0.5}, "expected either move="),
        ({"move": {}, "axis_distance": 0.5, "real_part": 1.0}, "expected either move="),
        ({"axis_distance": -0.5, "real_part": 1.0}, "axis_distance must not be negative"),
        ({"axis_distance": 0.5, "real_part": 0.0}, "moved off the imaginary axis"),
        ({"axis_distance": 0.5, "real_part": np.nan}, "moved off the imaginary axis"),
        ({"move": {0.3 + 4j: 1 + 4j}}, r"no zero at 0.3\+-4j .* the zeros are 0.22\+-4.75j"),
        ({"move": {0.22 + 4.75j: 2.0}}, "a complex pair to a complex pair"),
        ({"axis_distance": "half", "real_part": 1.0}, "axis_distance must be real numbers, got 'half'"),
        ({"axis_distance": 0.5, "real_part": 1 + 1j}, r"real_part must be real numbers, got \(1\+1j\)"),
        ({"move": [0.22 + 4.75j]}, r"move must be \{zero: where it goes\}"),
        ({"move": {0.22 + 4.75j: 1 + 4j, 0.22 - 4.75j: 2 - 4j}}, r"0.22\+-4.75j is to go to two places, 1\+-4j and 2\+-4j"),
        ({**BY_DISTANCE, "error_poles": [-1.0]}, r"error_poles must be 2 poles .* got \[-1.0\]"),
        (
            {**BY_DISTANCE, "error_poles": [-np.inf, -1.0]},
            r"error_poles must be 2 poles .* got \[-inf, -1.0\]",
        ),
        ({**BY_DISTANCE, "error_poles": "ab"}, "error_poles must be numbers, got 'ab'"),
        ({**BY_DISTANCE, "error_poles": [1.0, -1.0]}, "left of the imaginary axis"),
        ({**BY_DISTANCE, "error_poles": [-1 + 1j, -2.0]}, "conjugate pairs"),
        (
            {**BY_DISTANCE, "design": "best"},
            "design must be one of 'least error', 'robust', got 'best'",
        ),
        ({**BY_DISTANCE, "output_scale": -1.0}, "output_scale must be positive"),
        (
            {**BY_DISTANCE, "output_scale": [1.0, 2.0]},
            r"one number or one for each of 1 outputs, got \[1.0, 2.0\]",
        ),
        ({**BY_DISTANCE, "interval": 1}, "interval must be a whole number from 0 to 0, got 1"),
        ({**BY_DISTANCE, "interval": 0.5}, "interval must be a whole number from 0 to 0, got 0.5"),
        ({**BY_DISTANCE, "interval": []}, "one interval from 0 to 0 or a list of such, got an empty list"),
        ({**BY_DISTANCE, "output_scale": "1.0"}, "output_scale must be real numbers, got '1.0'"),
        ({**BY_DISTANCE, "tolerance": 2.0}, "tolerance must lie between 0 and 1"),
    ],
)
def test_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(PlanError, match=message):
        modified_inversion(TWO_DISC, SLEW, **{"error_poles": CHAIN, **options})


def test_rough_reference() -> None:
    with pytest.raises(TrajectoryError, match="not smooth enough"):
        modified_inversion(TWO_DISC, rest_to_rest(0.0, 1.0, 5.0, smoothness=0), axis_distance=0.5, real_part=1.0, error_poles=CHAIN)


def test_axis_zeros_that_stay() -> None:
    with pytest.raises(NonHyperbolicError, match=r"zeros at 0\+-4.755j lie on the imaginary axis and are not moved"):
        modified_inversion(PASSIVE_TWO_DISC, SLEW, move={}, error_poles=CHAIN)


def test_the_interval_with_axis_zeros_is_named() -> None:
    model = SwitchedSystem([TWO_DISC, PASSIVE_TWO_DISC], [2.0])
    with pytest.raises(NonHyperbolicError, match=r"interval 1: zeros at 0\+-4.755j lie on the imaginary axis"):
        modified_inversion(model, SLEW, move={0.22 + 4.75j: 1 + 4.75j}, error_poles=CHAIN)


def test_modes_that_no_input_moves() -> None:
    seen = TWO_DISC
    A = np.block([[seen.A, np.ones((4, 1))], [np.zeros((1, 4)), np.array([[0.05]])]])
    plant = StateSpace(A, np.vstack([seen.B, [[0.0]]]), np.hstack([seen.C, [[0.3]]]))
    with pytest.raises(InversionError, match=r"0.05: uncontrollable mode, no input moves it"):
        modified_inversion(plant, SLEW, move={0.05: 1.0}, error_poles=[-1.0])


def test_zero_at_the_origin_without_equilibrium() -> None:
    plant = plant_with(np.random.default_rng(4), (1,), block(0.0, -1.0, 0.5))
    with pytest.raises(InversionError, match=r"a zero at the origin: .* no equilibrium .* hold \[1.0\]"):
        modified_inversion(plant, SLEW, move={0.0: 1.5}, error_poles=[-2.0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"axis_distance": 0.5}, "expected a positive preactuation"),
        ({"axis_distance": 0.5, "preactuation": 1.0, "error": 0.1}, "expected a positive preactuation"),
        ({"axis_distance": 0.5, "preactuation": -1.0}, "expected a positive preactuation"),
        ({"preactuation": 1.0}, r"expected either axis_distance=... or zeros="),
        ({"zeros": [], "preactuation": 1.0}, r"expected either axis_distance=... or zeros="),
        (
            {**BY_DISTANCE, "error": 0.01},
            "real_part cannot be given: where the zeros go is what is varied",
        ),
        ({"axis_distance": 0.5, "interval": 1, "error": 0.01}, "interval must be a whole number from 0 to 0, got 1"),
        ({"axis_distance": 0.5, "error": 0.01, "real_parts": (1.0, np.inf)}, "two positive numbers that increase"),
        ({"axis_distance": 0.5, "error": 0.01, "real_parts": (1.0, 2.0, 3.0)}, "two positive numbers that increase"),
        ({"axis_distance": 0.01, "preactuation": 1.0}, r"no zeros within 0.01 rad/s .* the zeros are 0.22\+-4.75j"),
        ({"zeros": [1.0 + 1j], "preactuation": 1.0}, r"no zero at 1\+-1j"),
        ({"axis_distance": 0.5, "error": 0.01, "real_parts": (2.0, 1.0)}, "two positive numbers that increase"),
        ({"axis_distance": 0.5, "preactuation": 1e-3}, r"preactuation \[s\] of 0.001 cannot be reached .* the best is 0\.\d+"),
        (
            {"axis_distance": 0.5, "error": 1e-4, "real_parts": (1.0, 4.0)},
            r"error of 0.0001 cannot be reached .* the best is 0\.01\d+",
        ),
    ],
)
def test_wishes(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InversionError, match=message):
        tune_modified_inversion(TWO_DISC, SLEW, error_poles=CHAIN, design="robust", **options)


def test_trade_off() -> None:
    with pytest.raises(InversionError, match="expected either axis_distance"):
        preactuation_trade_off(TWO_DISC, SLEW, real_parts=[1.0], error_poles=CHAIN)
    with pytest.raises(InversionError, match="at least one entry in real_parts"):
        preactuation_trade_off(TWO_DISC, SLEW, real_parts=[], error_poles=CHAIN, axis_distance=0.5)
    trade = preactuation_trade_off(TWO_DISC, SLEW, real_parts=[1.0], error_poles=CHAIN, axis_distance=0.5)
    with pytest.raises(InversionError, match="no column 'errors'; there are real_part, alpha"):
        trade.column("errors")


@pytest.mark.parametrize("scale", [1e-100, 1e300])
def test_a_scale_of_the_output_far_from_its_motion_still_gives_a_plan(scale: float) -> None:
    """Its powers would be beyond any float."""
    plan = modified_inversion(TWO_DISC, SLEW, error_poles=CHAIN, output_scale=scale, **BY_DISTANCE)
    assert plan.certificate.dynamics_residual < 1e-9
