"""Differences with extrapolation, on functions whose derivatives are known."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.plant.linearize import differentiate


def nonlinear(z: np.ndarray) -> np.ndarray:
    return np.array([np.sin(z[0] + 0.3) * np.exp(z[1]), 5 + z[0] * z[1] + 3 * z[1], np.cosh(2 * z[0])])


JACOBIAN = np.array([[np.cos(0.3), np.sin(0.3)], [0, 3], [0, 0]])


@pytest.mark.parametrize("h", [1e-1, 1e-2, 1e-3, 1e-4, 1e-6])
def test_error_stays_below_its_estimate(h: float) -> None:
    derivative = differentiate(nonlinear, np.array([h, h]))
    assert np.all(np.abs(derivative.jacobian - JACOBIAN) <= derivative.error + 1e-15)


def test_error_falls_with_the_fourth_power_of_the_step() -> None:
    errors = [np.abs(differentiate(nonlinear, np.array([h, h])).jacobian - JACOBIAN)[0, 0] for h in (0.08, 0.04, 0.02)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.1)
    assert np.log2(errors[1] / errors[2]) == pytest.approx(4, abs=0.1)


def test_linear_functions_are_differentiated_to_rounding() -> None:
    matrix = np.random.default_rng(5).normal(size=(4, 3))
    assert differentiate(lambda z: matrix @ z, np.full(3, 2.0**-10)).jacobian == pytest.approx(matrix, rel=1e-13)


@pytest.mark.parametrize(("left", "right"), [(0.0, 4.0), (-1.0, 1.0), (2.0, 5.0)])
def test_kink_shows_as_the_difference_of_the_one_sided_derivatives(left: float, right: float) -> None:
    derivative = differentiate(lambda z: np.where(z > 0, right * z, left * z) + np.sin(z), np.array([1e-3]))
    assert derivative.jump[0, 0] == pytest.approx(right - left, rel=1e-6)


def test_smooth_functions_show_no_kink() -> None:
    assert np.max(differentiate(nonlinear, np.array([1e-3, 1e-3])).jump) < 1e-7
