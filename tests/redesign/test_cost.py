"""The cost of a plan against integrals known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from invtrack.errors import RedesignError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.redesign.cost import cost
from invtrack.references.profiles import autonomous, rest_to_rest
from tests.redesign.plants import NONMINIMUM, there_and_back

INTEGRATOR = StateSpace([[0.0]], [[1.0]], [[1.0]])


def test_exact_tracking_of_a_quintic_by_an_integrator() -> None:
    """u = y' = 30 s^2 (1 - s)^2 / T with s = t / T: the integral of u^2 is 900 B(5, 5) / T = 10 / (7 T)."""
    plan = invert(INTEGRATOR, rest_to_rest(0.0, 1.0, 4.0))
    assert cost(plan, R=2.0, Q_y=7.0) == pytest.approx(2.0 * 10 / (7 * 4.0), rel=1e-10)


@pytest.mark.parametrize("unit", [1e-300, 1e300])
def test_a_cost_in_any_unit(unit: float) -> None:
    plan = invert(INTEGRATOR, rest_to_rest(0.0, 1.0, 4.0))
    assert cost(plan, R=2.0 * unit, Q_y=7.0 * unit) / unit == pytest.approx(2.0 * 10 / (7 * 4.0), rel=1e-10)


def test_a_cost_beyond_any_float_is_refused() -> None:
    with pytest.raises(RedesignError, match="the cost is beyond any float"):
        cost(invert(INTEGRATOR, rest_to_rest(0.0, 1e4, 1e-3)), R=1e305, Q_y=1.0)


def test_a_swing_is_followed_over_all_its_periods() -> None:
    """u = y' = w cos(w t) over whole periods: the integral of u^2 is w^2 T / 2, that of x^2 is T / 2."""
    w, periods = 3.0, 40
    T = 2 * np.pi * periods / w
    swing = autonomous([[0.0, 1.0], [-(w**2), 0.0]], [[1.0, 0.0]], [0.0, w], start=0.0, end=T)
    assert cost(invert(INTEGRATOR, swing), R=0.5, Q_x=3.0, Q_y=1.0) == pytest.approx(0.25 * w**2 * T + 1.5 * T, rel=1e-9)


def test_preactuation_and_tail_count() -> None:
    """(s - 1)/(s + 2): the inverse 1 + 3/(s - 1) has the impulse response delta - 3 e^t for t < 0, 0 after.

    For y_d = 1 on [0, T] that is u = -3 (1 - e^-T) e^t before and u = 1 - 3 (1 - e^(t - T)) within.
    """
    system = StateSpace([[-2.0]], [[1.0]], [[-3.0]], [[1.0]])
    T, ramp = 2.0, 1e-6
    plateau = rest_to_rest(0.0, 1.0, ramp, smoothness=0) + rest_to_rest(0.0, -1.0, ramp, smoothness=0, start_time=T)
    t = np.linspace(0.0, T, 200_001)
    within = 1 - 3 * (1 - np.exp(t - T))
    expected = 9 * (1 - np.exp(-T)) ** 2 / 2 + float(np.trapezoid(within**2, t))
    assert cost(invert(system, plateau), R=1.0, Q_y=1.0) == pytest.approx(expected, rel=1e-5)


def test_infinite_where_it_never_ends() -> None:
    assert math.isinf(cost(invert(NONMINIMUM, rest_to_rest(0.0, 1.0, 2.0)), R=1.0, Q_y=1.0))
    assert math.isfinite(cost(invert(NONMINIMUM, there_and_back()), R=1.0, Q_y=1.0))
