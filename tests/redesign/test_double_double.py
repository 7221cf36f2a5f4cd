"""Matrices in twice the precision, against exact rational arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.redesign.double_double import DoubleDouble
from invtrack.redesign.riccati import QuadraticCost, optimal_feedback
from tests.redesign.exact import exact, largest


def random_pair(rng: np.random.Generator, shape: tuple[int, int], decades: int) -> DoubleDouble:
    high = rng.normal(size=shape) * 10.0 ** rng.integers(-decades, decades + 1, size=shape)
    return DoubleDouble.of(high) + DoubleDouble.of(1e-17 * high * rng.normal(size=shape))


@pytest.mark.parametrize(("inner", "decades"), [(1, 0), (3, 12), (50, 0), (50, 8), (300, 3)])
def test_product(inner: int, decades: int) -> None:
    rng = np.random.default_rng(inner)
    a, b = random_pair(rng, (3, inner), decades), random_pair(rng, (inner, 2), decades)
    size = np.max(np.abs(a.high), axis=1)[:, None] * np.max(np.abs(b.high), axis=0)
    error = exact(a @ b) - exact(a) @ exact(b)
    assert all(abs(float(e)) <= inner * 2.0**-98 * s for e, s in zip(error.ravel(), size.ravel(), strict=True))


def test_sum_of_what_cancels() -> None:
    rng = np.random.default_rng(5)
    a, small = random_pair(rng, (4, 4), 6), random_pair(rng, (4, 4), 0)
    b = DoubleDouble.of(1e-14 * small.high) - a
    wanted = exact(a) + exact(b)
    assert largest(exact(a + b) - wanted) <= 2.0**-100 * largest(exact(a))
    assert largest(exact(a - a)) == 0.0
    assert np.array_equal(a.transposed.rounded, a.rounded.T)


def test_nothing_times_something() -> None:
    empty = DoubleDouble.of(np.zeros((2, 0))) @ DoubleDouble.of(np.zeros((0, 3)))
    assert np.array_equal(empty.rounded, np.zeros((2, 3)))
    assert not np.any((DoubleDouble.of(np.zeros((2, 2))) @ DoubleDouble.of(np.eye(2))).rounded)


@pytest.mark.parametrize("R", [1.0, 1e-8, 1e-14, 1e-20])
def test_riccati_and_lyapunov_equations_in_rational_arithmetic(R: float) -> None:
    """A zero at +1, seen by y alone: K is what is left of P / sqrt(R) where the parts of P cancel."""
    unit = 2.0 ** np.round(-np.log2(R) / 4)  # of the states, in which B and C are alike in size
    A, B, C = np.array([[0.0, 1.0], [-2.0, -3.0]]), np.array([[0.0], [unit]]), unit * np.array([[-1.0, 1.0]])
    one, none = DoubleDouble.of(np.eye(1)), DoubleDouble.of(np.zeros((2, 1)))
    A_, B_, C_ = (DoubleDouble.of(M) for M in (A, B, C))
    feedback = optimal_feedback(QuadraticCost(A_, B_, C_.transposed @ C_, none, one))
    P, L, A_e, B_e, C_e = exact(feedback.P), exact(feedback.L), exact(A), exact(B), exact(C)
    drive = B_e.T @ P
    riccati = A_e.T @ P + P @ A_e - drive.T @ drive + C_e.T @ C_e
    assert largest(riccati) <= 1e-24 * largest(A_e.T @ P)
    A_c = A_e - B_e @ drive
    assert largest(A_c @ L + L @ A_c.T - B_e @ B_e.T) <= 1e-24 * largest(A_c) * largest(L)
    # The zero is mirrored, and the other mode follows from the spectral factorization of R a(s) a(-s) + b(s) b(-s).
    modes = np.sort(np.linalg.eigvals(feedback.A_c.rounded).real)
    assert modes == pytest.approx([-np.sqrt(4.0 + unit**4), -1.0], rel=1e-14)
