"""Inputs that move within a hold, and their mean held in their place."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.integrate

from invtrack.inversion.hold_response import COUNT, NODES, WEIGHTS, HoldResponse
from invtrack.linear.propagation import zero_order_hold

A = np.array([[0.0, 1.0, 0.2], [-4.0, -0.3, 0.0], [0.5, 0.0, -30.0]])
B = np.array([[0.0, 0.3], [1.0, 0.0], [2.0, -1.0]])
LENGTH = 0.3


@pytest.mark.parametrize("share", [0.5, 1.0])
@pytest.mark.parametrize("power", range(COUNT))
def test_polynomials_are_followed_exactly(power: int, share: float) -> None:
    response, x_0 = HoldResponse.of(A, B, LENGTH, share), np.array([0.3, -0.2, 0.1])
    gains = np.array([1.0, -0.7])
    expected = scipy.integrate.solve_ivp(
        lambda t, x: A @ x + B @ gains * (t / LENGTH) ** power, (0.0, share * LENGTH), x_0, rtol=1e-12, atol=1e-13, method="DOP853"
    ).y[:, -1]
    values = NODES[:, None] ** power * gains
    found = response.start @ x_0 + np.einsum("grm,gm->r", response.moving, values)
    np.testing.assert_allclose(found, expected, atol=1e-11)
    np.testing.assert_allclose(response.reading @ values, share**power * gains, atol=1e-12)


def test_a_constant_is_the_input_of_a_zero_order_hold() -> None:
    response, (A_d, B_d) = HoldResponse.of(A, B, LENGTH, 0.5), zero_order_hold(A, B, 0.5 * LENGTH)
    np.testing.assert_allclose(response.start, A_d, atol=1e-15)
    np.testing.assert_allclose(response.held, B_d, atol=1e-15)
    np.testing.assert_allclose(response.moving.sum(axis=0), B_d, atol=1e-13)


@pytest.mark.parametrize("hold", [1e-1, 1e-3, 1e-5])
def test_what_holding_the_mean_changes_is_found_without_cancellation(hold: float) -> None:
    """A ramp of unit slope in u: after the hold x is off by B' u' h^3 / 12 of its acceleration, to as many digits for any hold."""
    double = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    ramp = hold * NODES[:, None, None]
    mean = np.einsum("g,gkm->km", WEIGHTS, ramp)
    response = HoldResponse.of(*double, hold, 1.0)
    changed = response.change(np.eye(2), np.zeros((2, 1)), mean - ramp)
    assert changed[0, 0] == pytest.approx(hold**3 / 12, rel=1e-11)
    assert abs(changed[0, 1]) < 1e-13 * hold**2
