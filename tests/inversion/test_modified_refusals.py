"""What modified inversion and its planner refuse, and what they say about it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from invtrack.errors import InversionError, NonHyperbolicError, TrajectoryError
from invtrack.inversion.modified import modified_inversion
from invtrack.inversion.trade_off import plan_for, preactuation_trade_off
from invtrack.lti.state_space import StateSpace
from invtrack.lti.switched import SwitchedSystem
from invtrack.signals.profiles import rest_to_rest
from tests.inversion.modified_cases import PASSIVE_TWO_DISC, TWO_DISC
from tests.lti.random_plants import block, plant_with

SLEW = rest_to_rest(0.0, 1.0, 5.0, smoothness=3)
CHAIN = [-1.0, -2.0]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "expected either move="),
        ({"within": 0.5}, "expected either move="),
        ({"move": {}, "within": 0.5, "to": 1.0}, "expected either move="),
        ({"within": -0.5, "to": 1.0}, "within must not be negative"),
        ({"within": 0.5, "to": 0.0}, "moved off the imaginary axis"),
        ({"within": 0.5, "to": np.nan}, "moved off the imaginary axis"),
        ({"move": {0.3 + 4j: 1 + 4j}}, r"no zero at 0.3\+-4j .* the zeros are 0.22\+-4.75j"),
        ({"move": {0.22 + 4.75j: 2.0}}, "a complex pair to a complex pair"),
        ({"within": "half", "to": 1.0}, r"within must be a real number \[rad/s\], got 'half'"),
        ({"within": 0.5, "to": 1 + 1j}, r"to must be a real number \[rad/s\], got \(1\+1j\)"),
        ({"move": [0.22 + 4.75j]}, r"move must be \{zero: where it goes\}"),
        ({"move": {0.22 + 4.75j: 1 + 4j, 0.22 - 4.75j: 2 - 4j}}, r"0.22\+-4.75j is to go to two places, 1\+-4j and 2\+-4j"),
        ({"within": 0.5, "to": 1.0, "chain_poles": [-1.0]}, r"chain_poles must be 2 poles .* got \[-1.0\]"),
        ({"within": 0.5, "to": 1.0, "chain_poles": [-np.inf, -1.0]}, r"chain_poles must be 2 poles .* got \[-inf, -1.0\]"),
        ({"within": 0.5, "to": 1.0, "chain_poles": "ab"}, r"chain_poles must be 2 poles .* got 'ab'"),
        ({"within": 0.5, "to": 1.0, "chain_poles": [1.0, -1.0]}, "left of the imaginary axis"),
        ({"within": 0.5, "to": 1.0, "chain_poles": [-1 + 1j, -2.0]}, "conjugate pairs"),
        ({"within": 0.5, "to": 1.0, "design": "best"}, r"design must be one of \['least error', 'robust'\], got 'best'"),
        ({"within": 0.5, "to": 1.0, "output_scale": -1.0}, "output_scale must be positive"),
        ({"within": 0.5, "to": 1.0, "output_scale": [1.0, 2.0]}, r"one number or one for each of 1 outputs, got \[1.0, 2.0\]"),
        ({"within": 0.5, "to": 1.0, "interval": 1}, r"intervals from 0 to 0, got \[1\]"),
        ({"within": 0.5, "to": 1.0, "interval": 0.5}, r"intervals from 0 to 0, got \[0.5\]"),
        ({"within": 0.5, "to": 1.0, "interval": []}, r"intervals from 0 to 0, got \[\]"),
        ({"within": 0.5, "to": 1.0, "tolerance": 2.0}, "tolerance must lie between 0 and 1"),
    ],
)
def test_options(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InversionError, match=message):
        modified_inversion(TWO_DISC, SLEW, **{"chain_poles": CHAIN, **options})


def test_rough_reference() -> None:
    with pytest.raises(TrajectoryError, match="not smooth enough"):
        modified_inversion(TWO_DISC, rest_to_rest(0.0, 1.0, 5.0, smoothness=0), within=0.5, to=1.0, chain_poles=CHAIN)


def test_axis_zeros_that_stay() -> None:
    with pytest.raises(NonHyperbolicError, match=r"zeros at 0\+-4.755j lie on the imaginary axis and are not moved"):
        modified_inversion(PASSIVE_TWO_DISC, SLEW, move={}, chain_poles=CHAIN)


def test_the_interval_with_axis_zeros_is_named() -> None:
    model = SwitchedSystem([TWO_DISC, PASSIVE_TWO_DISC], [2.0])
    with pytest.raises(NonHyperbolicError, match=r"interval 1: zeros at 0\+-4.755j lie on the imaginary axis"):
        modified_inversion(model, SLEW, move={0.22 + 4.75j: 1 + 4.75j}, chain_poles=CHAIN)


def test_modes_that_no_input_moves() -> None:
    seen = TWO_DISC
    A = np.block([[seen.A, np.ones((4, 1))], [np.zeros((1, 4)), np.array([[0.05]])]])
    plant = StateSpace(A, np.vstack([seen.B, [[0.0]]]), np.hstack([seen.C, [[0.3]]]))
    with pytest.raises(InversionError, match=r"0.05: uncontrollable mode, no input moves it"):
        modified_inversion(plant, SLEW, move={0.05: 1.0}, chain_poles=[-1.0])


def test_zero_at_the_origin_without_equilibrium() -> None:
    plant = plant_with(np.random.default_rng(4), (1,), block(0.0, -1.0, 0.5))
    with pytest.raises(InversionError, match=r"a zero at the origin: .* no equilibrium .* hold \[1.0\]"):
        modified_inversion(plant, SLEW, move={0.0: 1.5}, chain_poles=[-2.0])


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"within": 0.5}, "expected a positive preactuation"),
        ({"within": 0.5, "preactuation": 1.0, "error": 0.1}, "expected a positive preactuation"),
        ({"within": 0.5, "preactuation": -1.0}, "expected a positive preactuation"),
        ({"preactuation": 1.0}, r"expected either within=... or zeros="),
        ({"zeros": [], "preactuation": 1.0}, r"expected either within=... or zeros="),
        ({"within": 0.5, "to": 1.0, "error": 0.01}, "to cannot be given: where the zeros go is what is varied"),
        ({"within": 0.5, "interval": 1, "error": 0.01}, r"intervals from 0 to 0, got \[1\]"),
        ({"within": 0.5, "error": 0.01, "real_parts": (1.0, np.inf)}, "two positive numbers that increase"),
        ({"within": 0.5, "error": 0.01, "real_parts": (1.0, 2.0, 3.0)}, "two positive numbers that increase"),
        ({"within": 0.01, "preactuation": 1.0}, r"no zeros within 0.01 rad/s .* the zeros are 0.22\+-4.75j"),
        ({"zeros": [1.0 + 1j], "preactuation": 1.0}, r"no zero at 1\+-1j"),
        ({"within": 0.5, "error": 0.01, "real_parts": (2.0, 1.0)}, "two positive numbers that increase"),
        ({"within": 0.5, "preactuation": 1e-3}, r"preactuation \[s\] of 0.001 cannot be reached .* the best is 0\.\d+"),
        ({"within": 0.5, "error": 1e-4, "real_parts": (1.0, 4.0)}, r"error of 0.0001 cannot be reached .* the best is 0\.01\d+"),
    ],
)
def test_wishes(options: dict[str, Any], message: str) -> None:
    with pytest.raises(InversionError, match=message):
        plan_for(TWO_DISC, SLEW, chain_poles=CHAIN, design="robust", **options)


def test_trade_off() -> None:
    with pytest.raises(InversionError, match="expected either within"):
        preactuation_trade_off(TWO_DISC, SLEW, real_parts=[1.0], chain_poles=CHAIN)
    with pytest.raises(InversionError, match="at least one entry in real_parts"):
        preactuation_trade_off(TWO_DISC, SLEW, real_parts=[], chain_poles=CHAIN, within=0.5)
    trade = preactuation_trade_off(TWO_DISC, SLEW, real_parts=[1.0], chain_poles=CHAIN, within=0.5)
    with pytest.raises(InversionError, match="no column 'errors'; there are real_part, alpha"):
        trade.column("errors")
