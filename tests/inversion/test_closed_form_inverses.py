"""Inverses of textbook transfer functions against partial fractions and two-sided convolution.

With den/num = sum p_k s^k + sum c_i / (s - z_i)^m_i the bounded input is the polynomial part applied to the derivatives of y_d,
plus y_d convolved with c t^(m-1) e^(z t) / (m-1)!, forward in time for stable zeros and backward, with the sign turned, for others.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from math import factorial
from typing import Any

import numpy as np
import pytest
import scipy.signal
from numpy.polynomial import Polynomial

from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.plans.plan import Plan
from invtrack.references.profiles import piecewise_polynomial, rest_to_rest
from invtrack.references.signal import PiecewiseSignal

NODES, WEIGHTS = np.polynomial.legendre.leggauss(40)
BUMP = 50 * Polynomial([0.0, 1.0]) ** 5 * Polynomial([2.0, -1.0]) ** 4  # on [0, 2], zero outside
TIMES = np.concatenate([np.linspace(-6.0, -0.01, 23), np.linspace(0.013, 1.99, 31), np.linspace(2.01, 8.0, 17)])

PLANTS: dict[str, tuple[Any, Any]] = {
    "(s - 1)/(s + 2)": ([1.0, -1.0], [1.0, 2.0]),
    "complex zeros 1 +- 2j": ([1.0, -2.0, 5.0], np.poly([-1.0, -2.0, -3.0])),
    "zeros 2 and -3": (np.poly([2.0, -3.0]), np.polymul([1.0, 1.0], [1.0, 1.0, 4.0])),
    "double zero 1": (np.poly([1.0, 1.0]), np.poly([-1.0, -2.0, -2.5, -3.0])),
    "unstable pole 3, zeros 0.5 and -1 +- 1j": (np.polymul([1.0, -0.5], [1.0, 2.0, 2.0]), np.poly([3.0, -1.5, -2.0, -4.0])),
    # Two-disc rig, motor torque to angle of the far disc (AIAA note in Devasia 1996): zeros 0.2198 +- 4.7497j.
    "torsional rig": ([0.27, -0.1187, 6.1041], [1.0, 0.2765, 6.1041, 0.0, 0.0]),
}


def convolution_inverse(num: np.ndarray, den: np.ndarray, y_d: Polynomial, end: float, y_f: float, t: float) -> float:
    """u(t) for an output y_d on [0, end], 0 before and y_f after."""
    residues, zeros, direct = scipy.signal.residue(den, num)
    inside = 0.0 < t < end
    value = complex(sum(p * (y_d.deriv(k)(t) if inside else y_f * (t >= end) * (k == 0)) for k, p in enumerate(direct[::-1])))
    seen: dict[complex, int] = {}
    for c, z in zip(residues, zeros, strict=True):
        order = seen[z] = seen.get(complex(np.round(z, 6)), 0) + 1
        seen[complex(np.round(z, 6))] = order

        def kernel(s: np.ndarray, c: complex = c, z: complex = z, m: int = order) -> np.ndarray:
            return c * s ** (m - 1) / factorial(m - 1) * np.exp(z * s)

        forward = z.real < 0
        a, b = (0.0, min(max(t, 0.0), end)) if forward else (min(max(t, 0.0), end), end)
        held = (end, max(t, end)) if forward else (max(t, end), max(t, end) + 60.0 / abs(z.real))
        sign = 1.0 if forward else -1.0
        value += sign * quadrature(partial(convolved, kernel, y_d, t), a, b)
        value += sign * y_f * quadrature(partial(convolved, kernel, Polynomial([1.0]), t), *held)
    assert abs(value.imag) < 1e-9 * (1 + abs(value))
    return value.real


def convolved(kernel: Callable[[np.ndarray], np.ndarray], y: Polynomial, t: float, tau: np.ndarray) -> np.ndarray:
    return kernel(t - tau) * y(tau)


def quadrature(f: Callable[[np.ndarray], np.ndarray], a: float, b: float) -> complex:
    """Integral of f from a to b by Gauss's rule on panels of 0.5 s at most."""
    if b <= a:
        return 0.0
    edges = np.linspace(a, b, int(np.ceil((b - a) / 0.5)) + 1)
    half = (edges[1:] - edges[:-1])[:, None] / 2
    return complex(np.sum(f((edges[1:] + edges[:-1])[:, None] / 2 + half * NODES) * WEIGHTS * half))


def tune_modified_inversion(name: str, reference: PiecewiseSignal) -> Plan:
    A, B, C, D = scipy.signal.tf2ss(*PLANTS[name])
    return invert(StateSpace(A, B, C, D), reference)


@pytest.mark.parametrize("name", PLANTS)
def test_pulse(name: str) -> None:
    plan = tune_modified_inversion(name, piecewise_polynomial([0.0, 2.0], [BUMP.coef]))
    expected = [convolution_inverse(*PLANTS[name], BUMP, 2.0, 0.0, t) for t in TIMES]
    assert plan(TIMES).u[:, 0] == pytest.approx(np.array(expected), abs=1e-10 * np.max(np.abs(expected)))


@pytest.mark.parametrize("name", [name for name in PLANTS if name != "torsional rig"])
def test_motion_to_another_value(name: str) -> None:
    """The minimum-jerk quintic from 0 to 3 in 2 s, held afterwards: the input comes to rest at 3 / G(0)."""
    num, den = PLANTS[name]
    quintic = 3 * Polynomial([0, 0, 0, 10 / 8, -15 / 16, 6 / 32])
    plan = tune_modified_inversion(name, rest_to_rest(0.0, 3.0, 2.0))
    expected = [convolution_inverse(num, den, quintic, 2.0, 3.0, t) for t in TIMES]
    assert plan(TIMES).u[:, 0] == pytest.approx(np.array(expected), abs=1e-10 * np.max(np.abs(expected)))
    assert plan(1e3).u[0, 0] == pytest.approx(3 * np.polyval(den, 0.0) / np.polyval(num, 0.0), rel=1e-10)


@pytest.mark.parametrize("name", [name for name in PLANTS if name != "torsional rig"])
def test_motion_from_one_value_to_another(name: str) -> None:
    """Relative to the equilibrium of the held output: shifting the reference by y_0 adds y_0 / G(0) to the input, nothing else."""
    num, den = PLANTS[name]
    from_zero, from_five = (tune_modified_inversion(name, rest_to_rest(y_0, y_0 + 3.0, 2.0)) for y_0 in (0.0, 5.0))
    gain = np.polyval(num, 0.0) / np.polyval(den, 0.0)
    assert from_five(TIMES).u == pytest.approx(from_zero(TIMES).u + 5 / gain, abs=1e-9)
    rest = from_five([-1e3, -1e4]).x
    assert rest[0] == pytest.approx(rest[1], abs=1e-10)
    assert from_five.preactuation == pytest.approx(from_zero.preactuation, rel=0.1)


def test_the_impulse_response_of_the_inverse_of_s_minus_1_over_s_plus_2() -> None:
    """delta - 3 e^t for t < 0, nothing after: against polynomials, integral of e^-s s^k over [a, b] in closed form."""
    plan = tune_modified_inversion(
        "(s - 1)/(s + 2)", piecewise_polynomial([0.0, 2.0], [[0.0, 1.0]], held=(0.0, 0.0))
    )  # a ramp, then 0
    before, inside = np.linspace(-9.0, -0.1, 20), np.linspace(0.0, 1.99, 20)
    assert plan(before).u[:, 0] == pytest.approx(-3 * np.exp(before) * (1 - 3 * np.exp(-2)), rel=1e-12)
    assert plan(inside).u[:, 0] == pytest.approx(inside - 3 * (1 + inside - 3 * np.exp(inside - 2)), rel=1e-10, abs=1e-12)
    assert plan([2.0, 3.0, 50.0]).u[:, 0] == pytest.approx(np.zeros(3), abs=1e-13)
    assert plan.preactuation == pytest.approx(np.log(1e10), rel=0.2)
    assert plan.postactuation < 1e-6


def test_minimum_phase_plants_need_no_preactuation() -> None:
    A, B, C, D = scipy.signal.tf2ss([1.0, 3.0], [1.0, 1.0, 4.0])
    plan = invert(StateSpace(A, B, C, D), rest_to_rest(0.0, 1.0, 1.0))
    assert plan.preactuation == pytest.approx(0.0)
    assert plan([-1.0, -1e-6]).u == pytest.approx(np.zeros((2, 1)), abs=1e-14)
