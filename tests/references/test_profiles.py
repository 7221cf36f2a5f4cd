"""Reference motions against closed forms, numpy's polynomials and an independent integrator."""

from __future__ import annotations

from collections.abc import Callable
from math import factorial

import numpy as np
import pytest
from numpy.polynomial import Polynomial
from scipy.integrate import solve_ivp

from invtrack.errors import TrajectoryError
from invtrack.references.profiles import autonomous, constant, piecewise_polynomial, raised_cosine, rest_to_rest


def test_minimum_jerk() -> None:
    """The quintic 10 s^3 - 15 s^4 + 6 s^5 (T. Flash, N. Hogan 1985): top speed 15/8, top acceleration 10/sqrt(3)."""
    motion, t = rest_to_rest(0.0, 1.0, 1.0), np.linspace(0.0, 1.0, 2001)
    assert np.max(motion(t, derivative=1)) == pytest.approx(15 / 8)
    assert np.max(motion(t, derivative=2)) == pytest.approx(10 / np.sqrt(3), rel=1e-5)


def test_polynomials_by_pieces_with_their_own_time_scale() -> None:
    coefficients = [np.array([[1.0, -2.0, 3.0], [0.0, 1.0, 0.0]]), np.array([[2.0], [5.0]])]
    signal = piecewise_polynomial([1.0, 3.0, 4.0], coefficients, time_scale=0.5)
    t = np.linspace(1.0, 2.999, 20)
    for channel in range(2):
        inner = Polynomial(coefficients[0][channel])
        for order in range(4):
            expected = inner.deriv(order)((t - 1) / 0.5) / 0.5**order
            assert signal(t, derivative=order)[:, channel] == pytest.approx(expected, abs=1e-10)
    assert signal([0.0, 3.5, 9.0]) == pytest.approx(np.array([[1.0, 0.0], [2.0, 5.0], [2.0, 5.0]]))


def test_autonomous_against_an_independent_integrator() -> None:
    S, R, w_0 = np.array([[0.0, 1.0, 0.0], [-9.0, -0.2, 1.0], [0.0, 0.0, 0.3]]), np.array([[1.0, 0.0, 2.0]]), [1.0, 0.5, -0.3]
    signal, t = autonomous(S, R, w_0, start=1.0, end=4.0), np.linspace(1.0, 3.999, 40)
    w = solve_ivp(lambda _, w: S @ w, (1.0, 4.0), w_0, "DOP853", t_eval=t, rtol=1e-13, atol=1e-13).y
    assert signal(t)[:, 0] == pytest.approx((R @ w)[0], abs=1e-11)
    assert signal(t, derivative=2)[:, 0] == pytest.approx((R @ S @ S @ w)[0], abs=1e-10)
    assert signal([-5.0, 50.0])[:, 0] == pytest.approx([0.4, signal(4.0, inside=3.0)[0]])


def test_exosystem_of_the_paper_makes_the_raised_cosine() -> None:
    """x_e1' = x_e2, x_e2' = -x_e1, x_e3' = x_e2, x_e4' = x_e3 from (0, 1, 0, 0): x_e4 = 1 - cos t (Devasia, Paden, Rossi 1996)."""
    A_e = [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]
    exosystem = autonomous(A_e, [[0, 0, 0, 1]], [0, 1, 0, 0], start=0.0, end=2 * np.pi)
    t = np.linspace(-1.0, 7.5, 100)
    for order in range(4):
        assert exosystem(t, derivative=order) == pytest.approx(raised_cosine(2.0)(t, derivative=order), abs=1e-12)


def test_raised_cosine() -> None:
    signal = raised_cosine(1.0, period=3.0, cycles=2, start_time=1.0)
    t = np.linspace(1.0, 6.999, 50)
    omega = 2 * np.pi / 3
    assert signal(t)[:, 0] == pytest.approx(0.5 * (1 - np.cos(omega * (t - 1))), abs=1e-14)
    assert signal(t, derivative=2)[:, 0] == pytest.approx(0.5 * omega**2 * np.cos(omega * (t - 1)), abs=1e-13)
    assert signal([0.0, 7.0, 8.0])[:, 0] == pytest.approx(np.zeros(3), abs=0)
    assert signal.smoothness(0, 6) == 2
    assert signal.manoeuvre == (1.0, 7.0)


def test_constant() -> None:
    assert constant([1.0, -2.0])([-9.0, 0.0, 9.0]) == pytest.approx(np.tile([1.0, -2.0], (3, 1)))
    assert constant(3.0)(1.0, derivative=1) == pytest.approx([0.0])


def test_taylor_coefficients_are_the_derivatives() -> None:
    signal = piecewise_polynomial([0.0, 1.0], [[2.0, -1.0, 4.0, 0.5]])
    for order, coefficient in enumerate((2.0, -1.0, 4.0, 0.5)):
        assert signal(0.0, derivative=order)[0] == pytest.approx(factorial(order) * coefficient)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: rest_to_rest(0.0, [1.0, 2.0], 1.0), r"same channels, got shapes \(1,\) and \(2,\)"),
        (lambda: rest_to_rest(0.0, 1.0, 0.0), "duration must be a positive number of seconds, got 0.0"),
        (lambda: rest_to_rest(0.0, 1.0, np.nan), "duration must be a positive"),
        (lambda: rest_to_rest(0.0, 1.0, np.inf), "duration must be a positive"),
        (lambda: rest_to_rest(0.0, 1.0, 1.0, smoothness=-1), "from 0 to 100, got -1"),
        (lambda: rest_to_rest(0.0, 1.0, 1.0, smoothness=101), "from 0 to 100, got 101"),
        (lambda: rest_to_rest(0.0, 1.0, 1.0, smoothness=1.5), "whole number"),  # type: ignore[arg-type]
        (lambda: rest_to_rest(0.0, np.nan, 1.0), "end must be one finite value"),
        (lambda: rest_to_rest(0.0, 1.0, 1.0, start_time=np.nan), "finite"),
        (lambda: piecewise_polynomial([0.0, 1.0], [[1.0], [2.0]]), "between each two of 2 breakpoints, got 2"),
        (lambda: piecewise_polynomial([0.0], []), "got 0"),
        (lambda: piecewise_polynomial([0.0, 1.0, 2.0], [[[1.0]], [[1.0], [2.0]]]), r"same number of channels, got \[1, 2\]"),
        (lambda: piecewise_polynomial([1.0, 0.0], [[1.0]]), "increase"),
        (lambda: piecewise_polynomial([0.0, 1.0], [[1.0]], time_scale=0.0), "time_scale must be a positive"),
        (lambda: piecewise_polynomial([0.0, 1.0], [[1.0]], held=([1.0, 2.0], 0.0)), r"held must give 1 value\(s\)"),
        (lambda: autonomous(np.eye(2), [[1.0]], [1.0], start=0.0, end=1.0), r"S must be \(1, 1\)"),
        (lambda: autonomous(0.0, [[1.0, 2.0]], 1.0, start=0.0, end=1.0), r"R \(p, 1\)"),
        (lambda: autonomous(-1.0, 1.0, 1.0, start=1.0, end=1.0), "end must be after start"),
        (lambda: raised_cosine(2.0, period=0.0), "period must be a positive number of seconds, got 0.0"),
        (lambda: raised_cosine(2.0, cycles=0), "cycles must be a whole number from 1 to"),
        (lambda: raised_cosine(2.0, cycles=1.5), "cycles must be a whole number from 1 to"),  # type: ignore[arg-type]
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        build()
