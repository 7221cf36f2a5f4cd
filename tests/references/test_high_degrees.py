"""Polynomials of any degree: right to the last digits in value and derivatives, by rational arithmetic on other formulas."""

from __future__ import annotations

from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from invtrack.errors import TrajectoryError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.references import PiecewiseSignal, piecewise_polynomial, rest_to_rest, sampled_reference

SHARES = [Fraction(i, 32) for i in range(1, 32)] + [Fraction(1, 2**12), 1 - Fraction(1, 2**12)]


def smoothstep(n: int) -> list[Fraction]:
    """Coefficients of S_n(s) = s^(n+1) sum_k C(n + k, k) C(2 n + 1, n - k) (-s)^k."""
    return [Fraction(0)] * (n + 1) + [Fraction(comb(n + k, k) * comb(2 * n + 1, n - k) * (-1) ** k) for k in range(n + 1)]


def derivative_at(coefficients: list[Fraction], order: int, share: Fraction) -> Fraction:
    """Horner's scheme without any rounding."""
    result = Fraction(0)
    for i in range(len(coefficients) - 1, order - 1, -1):
        result = result * share + coefficients[i] * factorial(i) / factorial(i - order)
    return result


def worst_error(signal: PiecewiseSignal, coefficients: list[Fraction], order: int, start: float, duration: float) -> float:
    """Largest error of a derivative, as a share of its peak."""
    times = [start + duration * float(share) for share in SHARES]
    exact = [derivative_at(coefficients, order, (Fraction(t) - Fraction(start)) / Fraction(duration)) for t in times]
    found = signal(times, derivative=order)[:, 0] * duration**order
    ends = [derivative_at(coefficients, order, Fraction(end)) for end in (0, 1)]
    peak = max(abs(float(e)) for e in (*exact, *ends))
    return max(abs(float(Fraction(f) - e)) for f, e in zip(found.tolist(), exact, strict=True)) / peak


@pytest.mark.parametrize("smoothness", [0, 1, 2, 3, 4, 6, 8, 12, 19, 40])
@pytest.mark.parametrize(("start", "duration"), [(0.0, 1.0), (5.0, 2.0**-10), (-1.0, 384.0)])
def test_rest_to_rest_is_the_smoothstep_polynomial(smoothness: int, start: float, duration: float) -> None:
    motion, coefficients = rest_to_rest(0.0, 1.0, duration, smoothness=smoothness, start_time=start), smoothstep(smoothness)
    orders = {0, 1, 2, smoothness // 2, smoothness - 1, smoothness, smoothness + 1}
    for order in sorted(orders & set(range(2 * smoothness + 2))):
        assert worst_error(motion, coefficients, order, start, duration) < 1e-12


@pytest.mark.parametrize("smoothness", [4, 7, 13, 40])
@pytest.mark.parametrize("duration", [0.3, 70.0])
def test_it_rests_and_is_smooth_to_rounding(smoothness: int, duration: float) -> None:
    """At the ends, and where it is cut into pieces."""
    motion = rest_to_rest(0.0, -3.0, duration, smoothness=smoothness)
    for order in range(smoothness + 1):
        assert np.max(motion.jumps(order)) < 1e-12
    assert np.all(motion.jumps(smoothness + 1)[[0, -1]] > 0.99)
    assert motion.smoothness(0, smoothness + 3) == smoothness + 1
    assert motion([-0.1, 1.01 * duration])[:, 0].tolist() == [0.0, -3.0]


@pytest.mark.parametrize("smoothness", [2, 6, 12, 30])
def test_sizes_are_the_peaks(smoothness: int) -> None:
    """The slope's peak is at the middle, that of the derivative of order smoothness + 1 at the ends."""
    motion, coefficients = rest_to_rest(0.0, 1.0, 2.0, smoothness=smoothness), smoothstep(smoothness)
    assert motion.size(1)[0] == pytest.approx(float(derivative_at(coefficients, 1, Fraction(1, 2))) / 2, rel=0.03)
    top = factorial(2 * smoothness + 1) / factorial(smoothness) / 2.0 ** (smoothness + 1)
    assert motion.size(smoothness + 1)[0] == pytest.approx(top, rel=1e-12)
    assert motion.size(0) == pytest.approx([1.0])


def test_several_channels_share_one_step() -> None:
    motion = rest_to_rest([0.0, 2.0, 7.0], [1.0, -1.0, 7.0], 3.0, smoothness=12)
    t = np.linspace(-1.0, 4.0, 101)
    step = rest_to_rest(0.0, 1.0, 3.0, smoothness=12)
    assert motion(t) == pytest.approx(np.hstack([step(t), 2.0 - 3.0 * step(t), 7.0 + 0 * step(t)]), abs=1e-14)
    assert motion(t, derivative=12)[:, 1] == pytest.approx(-3.0 * step(t, derivative=12)[:, 0], rel=1e-14)
    assert motion([-1.0, 4.0]).tolist() == [[0.0, 2.0, 7.0], [1.0, -1.0, 7.0]]


def test_where_the_range_of_numbers_ends() -> None:
    with pytest.raises(TrajectoryError, match=r"no room for the 20 piece\(s\).* rounded to 1\.2e-07 s"):
        rest_to_rest(0.0, 1.0, 1e-6, smoothness=40, start_time=1e9)
    short = rest_to_rest(0.0, 1.0, 1e-6, smoothness=40)
    assert short(0.5e-6) == pytest.approx([0.5])
    with pytest.raises(TrajectoryError, match=r"derivative of order \d+ of this signal is beyond the range"):
        short(0.0, derivative=41)


@pytest.mark.parametrize("shift", [1e6, -3e7, 0.1])
def test_a_shift_keeps_it_smooth(shift: float) -> None:
    """Although its breakpoints are rounded to 1e-10 or 4e-9 s by it."""
    motion = rest_to_rest(0.0, 1.0, 0.01, smoothness=8).shifted(shift)
    for order in range(8):
        assert np.max(motion.jumps(order)[1:-1]) < 1e-11


def bernstein_value(b: list[float], share: Fraction) -> float:
    d = len(b) - 1
    return float(sum((Fraction(c) * comb(d, i) * share**i * (1 - share) ** (d - i) for i, c in enumerate(b)), Fraction(0)))


@pytest.mark.parametrize("degree", [0, 1, 3, 4, 9, 20, 45])
def test_bezier_curves_of_any_degree(degree: int) -> None:
    rng = np.random.default_rng(degree)
    first, second = rng.normal(size=(2, degree + 1)), rng.normal(size=(2, 4))
    signal = piecewise_polynomial([1.0, 3.0, 3.5], [first, second], basis="bernstein")
    for start, length, b in ((1.0, 2.0, first), (3.0, 0.5, second)):
        exact = [[bernstein_value(row, share) for row in b.tolist()] for share in SHARES]
        at = [start + length * float(share) for share in SHARES]
        assert signal(at) == pytest.approx(np.array(exact), abs=1e-12)
    assert signal([0.0, 9.0]) == pytest.approx(np.array([first[:, 0], second[:, -1]]))
    slope = degree * (first[:, 1] - first[:, 0]) / 2.0 if degree else np.zeros(2)
    assert signal(1.0, derivative=1) == pytest.approx(slope)


@pytest.mark.parametrize("degree", [5, 12, 25])
@pytest.mark.parametrize("lengths", [(1.0, 1.0), (1e-6, 1e-6), (1e5, 1e-4)])
def test_power_series_of_any_degree_and_length(degree: int, lengths: tuple[float, float]) -> None:
    """Their terms are of size one at the end of each piece, whatever the unit of time in which they are written."""
    rng = np.random.default_rng(degree)
    edges = np.concatenate([[0.0], np.cumsum(lengths)])
    unit = [rng.normal(size=degree + 1) for _ in lengths]
    signal = piecewise_polynomial(
        edges, [c / length ** np.arange(degree + 1) for c, length in zip(unit, np.diff(edges).tolist(), strict=True)]
    )
    for edge, length, c in zip(edges.tolist(), np.diff(edges).tolist(), unit, strict=False):
        share = np.linspace(0.0, 0.99, 40)
        times = edge + length * share
        for order in (0, 1, 4):
            polynomial = Polynomial(c).deriv(order)
            found = signal(times, derivative=order, inside=edge + length / 2)[:, 0] * length**order
            assert found == pytest.approx(polynomial((times - edge) / length), abs=1e-13 * np.sum(np.abs(polynomial.coef)))


@pytest.mark.parametrize(("degree", "count", "error"), [(9, 320, 1e-13), (15, 80, 1e-12), (19, 80, 1e-12), (25, 80, 1e-11)])
@pytest.mark.parametrize("seed", [None, 1])
def test_splines_of_high_degree_follow_a_smooth_motion(degree: int, count: int, error: float, seed: int | None) -> None:
    shares = np.ones(count - 1) if seed is None else np.random.default_rng(seed).uniform(0.5, 1.5, count - 1)
    times = 6.0 * np.concatenate([[0.0], np.cumsum(shares) / shares.sum()])
    motion = rest_to_rest([0.0, 1.0], [1.0, -1.0], times[-1], smoothness=40)
    signal = sampled_reference(times, motion(times), degree=degree)
    fine = np.linspace(0.0, 6.0, 1001)
    assert signal(fine) == pytest.approx(motion(fine), abs=error)
    assert signal(fine, derivative=2) == pytest.approx(motion(fine, derivative=2), abs=1e3 * error)
    for order in range(degree):
        assert np.max(signal.jumps(order)[1:-1]) < 1e-11
    for order in range((degree + 1) // 2):
        assert np.max(signal.jumps(order)[[0, -1]]) < 1e-11


@pytest.mark.parametrize("degree", [5, 9, 13, 19])
def test_splines_with_natural_ends_reproduce_what_bends_in_no_other_way(degree: int) -> None:
    """Smoothness 0 asks for y^(i) = 0 at both ends from i = (degree + 1) / 2 on: polynomials of lower degree have no such y^(i)."""
    half = (degree - 1) // 2
    times, fine = np.linspace(-1.0, 1.0, 2 * degree), np.linspace(-1.0, 0.999, 301)
    low = Polynomial(np.random.default_rng(degree).normal(size=half + 1))
    signal = sampled_reference(times, low(times), degree=degree, smoothness=0)
    scale = np.sum(np.abs(low.coef))
    assert signal(fine)[:, 0] == pytest.approx(low(fine), abs=1e-12 * scale)
    assert signal(fine, derivative=1)[:, 0] == pytest.approx(low.deriv()(fine), abs=1e-10 * scale)


def test_a_degree_at_which_rounding_takes_over_is_refused() -> None:
    times = np.linspace(0.0, 6.0, 100)
    with pytest.raises(TrajectoryError, match=r"no trustworthy spline of degree 45: .* magnifies rounding"):
        sampled_reference(times, np.sin(times), degree=45)


@pytest.mark.parametrize("r", [8, 12, 20])
@pytest.mark.parametrize("extra", [-1, 0])
def test_inverse_of_a_chain_of_integrators(r: int, extra: int) -> None:
    """Its states are the output's derivatives, its input the r-th one."""
    plant = StateSpace(np.eye(r, k=1), np.eye(r)[:, -1:], np.eye(r)[:1])
    plan = invert(plant, rest_to_rest(1.0, 3.0, 4.0, smoothness=r + extra))
    assert plan.certificate.worst(exact=True) < 1e-11
    times, coefficients = np.linspace(-0.5, 4.5, 102), smoothstep(r + extra)
    values, shares = plan(times), [Fraction(t) / 4 for t in times.tolist()]
    for order in (0, 1, r // 2, r - 1, r):
        moving = [2 * float(derivative_at(coefficients, order, s)) / 4.0**order if 0 < s < 1 else 0.0 for s in shares]
        exact = np.array(moving) + (np.where(times >= 4.0, 2.0, 0.0) + 1.0 if order == 0 else 0.0)
        found = values.x[:, order] if order < r else values.u[:, 0]
        assert found == pytest.approx(exact, abs=1e-11 * np.max(np.abs(exact)))


def mass_chain(count: int, stiffness: float) -> StateSpace:
    """Unit masses with springs between them, free at both ends; force on the first, position of the last."""
    D = np.diff(np.eye(count), axis=0)
    A = np.block([[np.zeros((count, count)), np.eye(count)], [-stiffness * D.T @ D, np.zeros((count, count))]])
    return StateSpace(A, np.eye(2 * count)[:, [count]], np.eye(2 * count)[[count - 1]])


@pytest.mark.parametrize(("count", "stiffness", "duration"), [(4, 1.0, 20.0), (10, 1.0, 40.0), (10, 1e4, 0.4)])
def test_inverse_of_a_chain_of_masses(count: int, stiffness: float, duration: float) -> None:
    """Relative degree 2 count. From the last mass on, each one's motion tells that of the one before: all in derivatives of y.

    The terms in these derivatives cancel, in the inverse as well as here, so differences are held against the terms' sizes.

    x_(i-1) = 2 x_i - x_(i+1) + x_i'' / k, where x_(N+1) stands for x_N, and u / k = x_1'' / k + x_1 - x_2.
    """
    reference = rest_to_rest(0.0, 1.0, duration, smoothness=2 * count)
    plan = invert(mass_chain(count, stiffness), reference)
    assert plan.certificate.worst(exact=True) < 1e-8
    behind = position = np.eye(count + 1)[0]  # coefficients of y, y'' / k, y'''' / k^2, ...
    positions = [position]
    for _ in range(count - 1):
        behind, position = position, 2 * position - behind + np.roll(position, 1)
        positions.insert(0, position)
    force = np.roll(position, 1) + position - behind
    times = np.linspace(0.01, 0.99, 201) * duration
    y = np.hstack([reference(times, derivative=2 * j) / stiffness**j for j in range(count + 1)])
    values = plan(times)
    for i, row in enumerate(positions):
        assert values.x[:, i] == pytest.approx(y @ row, abs=1e-10 * np.max(np.abs(y) @ np.abs(row)))
    assert values.u[:, 0] / stiffness == pytest.approx(y @ force, abs=1e-10 * np.max(np.abs(y) @ np.abs(force)))
