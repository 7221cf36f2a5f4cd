"""Holds against closed forms and an independent integrator."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm

from invtrack.linear.propagation import held_through, sampled_noise, transition_and_gramian, zero_order_hold

RNG = np.random.default_rng(2)
A, B = RNG.normal(size=(4, 4)), RNG.normal(size=(4, 2))
A_LATER, B_LATER = RNG.normal(size=(4, 4)), RNG.normal(size=(4, 2))


def test_double_integrator() -> None:
    """x_1 gains x_2 h + u h^2 / 2, x_2 gains u h; noise on the input leaves [h^3 / 3, h^2 / 2; h^2 / 2, h]."""
    h, A, B = 0.3, np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    A_d, B_d = zero_order_hold(A, B, h)
    assert A_d == pytest.approx(np.array([[1.0, h], [0.0, 1.0]]))
    assert B_d == pytest.approx(np.array([[h**2 / 2], [h]]))
    transition, covariance = sampled_noise(A, 2.0 * B, h)
    assert transition == pytest.approx(A_d)
    assert covariance == pytest.approx(4.0 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]]))


def test_a_hold_through_a_change_of_the_system() -> None:
    """Against an integrator that knows no exponentials; the change lies within the hold."""
    x, u = RNG.normal(size=4), RNG.normal(size=2)
    A_d, B_d = held_through([(A, B, 0.4), (A_LATER, B_LATER, 0.7)])
    state = x
    for A_k, B_k, length in ((A, B, 0.4), (A_LATER, B_LATER, 0.7)):
        rate = lambda t, x, A_k=A_k, B_k=B_k: A_k @ x + B_k @ u  # noqa: E731
        state = solve_ivp(rate, (0.0, length), state, rtol=1e-11, atol=1e-12, method="DOP853").y[:, -1]
    assert A_d @ x + B_d @ u == pytest.approx(state, rel=1e-8)


def test_a_hold_in_parts_is_the_whole_hold() -> None:
    assert np.hstack(held_through([(A, B, 0.4), (A, B, 0.7)])) == pytest.approx(np.hstack(zero_order_hold(A, B, 1.1)))


def test_a_system_without_inputs() -> None:
    A_d, B_d = zero_order_hold(A, np.zeros((4, 0)), 0.5)
    assert A_d == pytest.approx(expm(A * 0.5))
    assert B_d.shape == (4, 0)


@pytest.mark.parametrize("duration", [1e-3, 1.0, 30.0])
def test_gramian_against_quadrature(duration: float) -> None:
    """Also over times in which the fastest mode, -40, decays e^1200 fold: one exponential of -M' and M would overflow."""
    M = np.array([[-40.0, 1.0, 0.0], [0.0, -0.3, 2.0], [0.0, -2.0, -0.3]])
    F = RNG.normal(size=(2, 3))
    transition, gramian = transition_and_gramian(M, F.T @ F, duration)
    expected = quad_vec(lambda s: expm(M.T * s) @ F.T @ F @ expm(M * s), 0.0, duration, epsrel=1e-10, limit=2000)[0]
    assert transition == pytest.approx(expm(M * duration), rel=1e-9, abs=1e-15)
    assert gramian == pytest.approx(expected, rel=1e-7, abs=1e-9 * np.max(np.abs(expected)))
