"""Solutions of v' = M v at many times."""

from __future__ import annotations

import math

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.arrays import Array
from invtrack.linear.propagation import Propagator, flow, forced_states
from tests.linear.random_plants import rotation

EPS = np.finfo(float).eps


def transition(propagator: Propagator, tau: float) -> Array:
    """exp(M tau) for one time."""
    return propagator.matrices(np.array([tau]))[0]


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.integers(1, 8), st.integers(0, 10**6))
def test_against_one_matrix_exponential_per_time(q: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    M, v = rng.normal(size=(q, q)), rng.normal(size=(30, q))
    tau = np.concatenate([[0.0], 10.0 ** rng.uniform(-8, 0.7, size=29)])
    expected = np.array([scipy.linalg.expm(M * t) @ w for t, w in zip(tau, v, strict=True)])
    assert flow(M, v, tau) == pytest.approx(expected, rel=1e-11, abs=1e-11 * np.max(np.abs(expected)))


def test_no_time_changes_nothing() -> None:
    v = np.random.default_rng(0).normal(size=(5, 3))
    assert np.array_equal(flow(np.diag([1.0, -2.0, 3.0]), v, np.zeros(5)), v)
    assert np.array_equal(flow(np.zeros((3, 3)), v, np.arange(5.0)), v)
    assert flow(np.zeros((0, 0)), np.zeros((5, 0)), np.arange(5.0)).shape == (5, 0)


@pytest.mark.parametrize("rates", [(-1e6, -1e-3), (-50.0, -3.0, 0.0), (-1e3, -1e-3, -1.0)])
def test_stiff_and_long_decays_against_closed_form(rates: tuple[float, ...]) -> None:
    """Symmetric M with known eigenvalues: exact but for what rounding of M itself means, eps |M| tau."""
    rng = np.random.default_rng(11)
    U, n = rotation(rng, len(rates)), len(rates)
    M = U @ np.diag(rates) @ U.T
    tau = np.concatenate([[0.0], 10.0 ** np.linspace(-7, 4, 45)])
    v = rng.normal(size=(len(tau), n))
    expected = (v @ U * np.exp(np.outer(tau, rates))) @ U.T
    error = np.max(np.abs(flow(M, v, tau) - expected), axis=1)
    assert np.all(error <= 20 * EPS * (1 + max(abs(np.array(rates))) * tau))


def test_rotation_keeps_its_length_over_many_turns() -> None:
    tau = np.linspace(0.0, 1e4, 1001)
    found = flow(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.tile([1.0, 0.0], (len(tau), 1)), tau)
    assert found == pytest.approx(np.column_stack([np.cos(tau), -np.sin(tau)]), abs=1e-10)


def test_polynomials_are_exact() -> None:
    """Nilpotent M: v' = v2, v2' = v3, v3' = 0."""
    tau = np.array([0.0, 1e-3, 1.0, 1e3, 1e6])
    found = flow(np.diag([1.0, 1.0], k=1), np.tile([1.0, -2.0, 3.0], (5, 1)), tau)[:, 0]
    assert found == pytest.approx(1 - 2 * tau + 1.5 * tau**2, rel=1e-12)


def test_growth_up_to_the_largest_number_does_not_overflow_on_the_way() -> None:
    assert flow(np.array([[1.0]]), np.array([[1.0]]), np.array([700.0]))[0, 0] == pytest.approx(np.exp(700.0), rel=1e-12)


def test_decay_ends_at_zero_whatever_the_time() -> None:
    M = np.array([[-50.0, 1e3], [0.0, -20.0]])
    assert flow(M, np.ones((2, 2)), np.array([1e4, 1e12])) == pytest.approx(np.zeros((2, 2)), abs=1e-300)


def test_the_callers_vectors_are_left_alone() -> None:
    v = np.ones((3, 2))
    flow(np.array([[0.0, 1.0], [-1.0, 0.0]]), v, np.array([1.0, 2.0, 3.0]))
    assert np.array_equal(v, np.ones((3, 2)))


def test_parts_that_do_not_act_on_each_other() -> None:
    """A triangular matrix has no best scale: what couples its parts can be made as small as one likes."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        A, S = rng.normal(size=(3, 3)) - 3 * np.eye(3), np.diag(10.0 ** rng.uniform(-2, 2, 7), k=1)
        M = np.block([[A, rng.normal(size=(3, 8))], [np.zeros((8, 3)), S]])
        v, tau = rng.normal(size=(1, 11)), np.array([0.7])
        expected = scipy.linalg.expm(M * 0.7) @ v[0]
        assert flow(M, v, tau)[0] == pytest.approx(expected, rel=1e-10, abs=1e-12 * np.max(np.abs(expected)))


def test_a_slow_mode_driven_by_a_polynomial() -> None:
    """z' = -0.004 z + p' with p = (t/2)^7: all derivatives reach z, the last through eight entries."""
    S = np.diag(np.arange(1.0, 8.0), k=1) / 2
    M = np.zeros((9, 9))
    M[0, 0], M[0, 2], M[1:, 1:] = -0.004, 0.5, S
    v = np.eye(9)[8:]
    tau = np.array([0.3, 1.0, 2.0, 5.0])
    nodes, weights = np.polynomial.legendre.leggauss(20)
    s = tau[:, None] / 2 * (nodes + 1)
    z = np.sum(weights * tau[:, None] / 2 * np.exp(-0.004 * (tau[:, None] - s)) * 7 / 2 * (s / 2) ** 6, axis=1)
    found = flow(M, np.repeat(v, 4, axis=0), tau)
    assert found[:, 1] == pytest.approx((tau / 2) ** 7, rel=1e-12)
    assert found[:, 0] == pytest.approx(z, rel=1e-12)


@pytest.mark.parametrize(("rows", "times"), [(1, 200), (1, 5000), (30, 40), (30, 5000)])
def test_values_do_not_depend_on_how_the_times_are_spread(rows: int, times: int) -> None:
    """Even, dense and scattered times take different ways: each against the eigenvectors of a normal matrix."""
    rng = np.random.default_rng(5)
    U = rotation(rng, 12)
    rates = rng.uniform(-3.0, 0.1, size=6) + 1j * rng.uniform(0.0, 20.0, size=6)
    M = U @ scipy.linalg.block_diag(*([[s.real, s.imag], [-s.imag, s.real]] for s in rates)) @ U.T
    X, v = rng.normal(size=(rows, 12)), rng.normal(size=(1, 12))
    eigenvalues, vectors = np.linalg.eig(M)
    spans = {"even": np.linspace(0.3, 9.0, times), "backward": np.linspace(9.0, 0.3, times), "dense": np.linspace(0, 3, times) ** 2}
    spans["scattered"] = rng.uniform(0.0, 9.0, size=times)
    for name, tau in spans.items():
        expected = np.real((np.exp(np.outer(tau, eigenvalues)) * (vectors.conj().T @ v[0])) @ (X @ vectors).T)
        found = Propagator(M).outputs(X, v, np.zeros(times, dtype=np.intp), tau, resolution=1e-14)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)), err_msg=name)


@pytest.mark.parametrize("count", [3, 40])
@pytest.mark.parametrize("even", [True, False])
def test_many_exponentials_at_once(count: int, even: bool) -> None:
    """Few and many, of times that recur to within rounding or not, of modes of one pace and of two that nothing couples."""
    rng = np.random.default_rng(11)
    times = 0.7 * (1 + 1e-15 * np.arange(count)) if even else rng.uniform(0.0, 3.0, size=count)
    own = rng.normal(size=(8, 8)) / 3 - np.eye(8)
    for M in (own, scipy.linalg.block_diag(own, 100 * own)):
        expected = np.array([scipy.linalg.expm(M * tau) for tau in times])
        assert Propagator(M).matrices(times) == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("tau", [0.0, 1e-9, 0.01, 1.0, 37.0])
def test_one_exponential(tau: float) -> None:
    """In coordinates whose units differ by factors of up to 1e6, against scipy's."""
    rng = np.random.default_rng(8)
    M = rng.normal(size=(5, 5)) - 2.0 * np.eye(5)
    scale = np.exp2(np.array([0.0, 20.0, -7.0, 3.0, 11.0]))
    expected = scipy.linalg.expm(M * tau)
    found = transition(Propagator(M * scale[:, None] / scale), tau) / scale[:, None] * scale
    assert found == pytest.approx(expected, abs=1e-12 * np.max(np.abs(expected)))


def test_what_little_time_changes_keeps_its_digits() -> None:
    """exp(M tau) - 1 = M tau + ... for steps far below the first node, over a long even stretch of them."""
    M = np.array([[0.0, 1.0], [0.0, -1.0]])
    tau = 1e-8 * np.arange(1, 101)
    found = Propagator(M).outputs(np.eye(2)[:1], np.array([[0.0, 1.0]]), np.zeros(100, dtype=np.intp), tau)[:, 0]
    assert found == pytest.approx(-np.expm1(-tau), rel=1e-14)


@pytest.mark.parametrize("times", [1e-7 * np.arange(1.0, 101.0), 1e-7 * np.geomspace(1e-3, 1.0, 50), np.array([1e-7])])
def test_a_chain_of_integrators_whose_last_state_is_the_largest(times: np.ndarray) -> None:
    """x1' = x2, ..., x6' = 0 with x_k(0) = (k - 1)! 10^(7 (k - 1)): x1 = sum of (10^7 t)^k, whatever is small about the times."""
    state = np.array([math.factorial(k) * 1e7**k for k in range(6)])
    found = Propagator(np.diag(np.ones(5), k=1)).outputs(np.eye(6)[:1], state[np.newaxis], np.zeros(len(times), dtype=int), times)
    assert found[:, 0] == pytest.approx(np.sum((1e7 * times[:, np.newaxis]) ** np.arange(6), axis=1), rel=1e-13)


@pytest.mark.parametrize(("pace", "drive"), [(0.1, 1.0), (1.0, 1e9), (300.0, 1e-6), (0.0, 1.0)])
def test_a_driven_system_shares_the_transitions_of_its_own(pace: float, drive: float) -> None:
    """[A D; 0 S] by both ways of evaluation, in units of the drive of any size, with an S slower, faster and at rest."""
    rng = np.random.default_rng(12)
    A, D, S = rng.normal(size=(6, 6)) - 3.0 * np.eye(6), rng.normal(size=(6, 2)), pace * np.array([[-0.1, 1.0], [-1.0, -0.1]])
    v, scattered = rng.normal(size=(1, 8)), np.array([1e-9, 1e-3, 0.2, 1.7])
    own = Propagator(A)
    driven = own.driven(drive * D, S)
    unit = np.array([1.0] * 6 + [1 / drive] * 2)
    for tau in (scattered, np.linspace(0.0, 1.0, 100)):
        found = driven.outputs(np.eye(8), v * unit, np.zeros(len(tau), dtype=np.intp), tau, resolution=1e-15) / unit
        expected = np.array([scipy.linalg.expm(np.block([[A, D], [np.zeros((2, 6)), S]]) * t) @ v[0] for t in tau])
        assert found == pytest.approx(expected, abs=1e-13 * np.max(np.abs(expected)))
    assert transition(own, 1.7) == pytest.approx(scipy.linalg.expm(1.7 * A), abs=1e-14)


def test_a_transpose_shares_the_transitions_of_its_original() -> None:
    """In coordinates whose units differ by factors of up to 1e6; both are worked out with the very same digits."""
    rng = np.random.default_rng(13)
    A, scale = rng.normal(size=(5, 5)) - 2.0 * np.eye(5), np.exp2(np.array([0.0, 20.0, -7.0, 3.0, 11.0]))
    own = Propagator(A * scale[:, None] / scale)
    expected = scipy.linalg.expm(2.3 * A).T
    assert transition(own.transposed, 2.3) * scale[:, None] / scale == pytest.approx(expected, abs=1e-12 * np.max(np.abs(expected)))
    assert own.transposed.growth == pytest.approx(np.max(np.linalg.eigvals(A).real), rel=1e-12)


@pytest.mark.parametrize("tau", [np.array([1e-9, 1e-7, 0.3, 2.0, 11.0]), np.linspace(0.0, 10.0, 500)], ids=["scattered", "even"])
def test_states_that_nothing_couples_are_carried_at_their_own_pace(tau: np.ndarray) -> None:
    """Rotations and decays ten million times as fast, in no order, driven by one ramp: each to its own digits. Four of each."""
    a, four = 1e7, np.ones((4, 1))
    M = np.zeros((4, 4))
    M[0, 2], M[2, 0], M[1, 1], M[3, 3] = 2.0, -2.0, -a, -3 * a
    D = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 6.0], [0.0, 0.0]])  # w = [t, 1]
    own = Propagator(np.kron(M, np.eye(4)))
    driven = own.driven(np.kron(D, four), np.array([[0.0, 1.0], [0.0, 0.0]]))
    start = np.append(np.repeat([0.0, 0.0, 0.0, 5.0], 4), [0.0, 1.0])[np.newaxis]
    fast = (tau + np.expm1(-a * tau) / a) / a
    states = np.column_stack([6 * np.sin(tau) ** 2, fast, 3 * np.sin(2 * tau), 5 * np.exp(-3 * a * tau)])
    expected = np.column_stack([np.repeat(states, 4, axis=1), tau, np.ones(len(tau))])
    found = driven.outputs(np.eye(18), start, np.zeros(len(tau), dtype=np.intp), tau, resolution=1e-14)
    size = np.append(np.repeat([6.0, 1.0 / a, 3.0, 5.0], 4), [1.0, 1.0])
    assert found / size == pytest.approx(expected / size, abs=1e-13)
    assert driven.states(np.repeat(start, len(tau), axis=0), tau) / size == pytest.approx(found / size, abs=1e-13)
    assert (own.pace, own.growth) == (pytest.approx(3 * a), pytest.approx(0.0, abs=1e-14))
    assert transition(own, 0.5)[:, 0] == pytest.approx(
        np.append(np.cos(1.0) * np.eye(8)[0], -np.sin(1.0) * np.eye(8)[0]), abs=1e-14
    )
    assert transition(own.transposed, 0.5) == pytest.approx(transition(own, 0.5).T, abs=1e-15)


def test_evenly_spaced_times_that_lie_far_out_are_taken_as_they_are() -> None:
    """Times from 1e10 s down, rounded to 2e-6 s: those near zero miss the even spacing by far more than their own rounding."""
    frequency = 1.5
    tau = 50.0 - np.linspace(-1e10, 50.0, 400)
    rotation = Propagator(np.array([[0.0, -frequency], [frequency, 0.0]]))
    found = rotation.outputs(
        np.eye(2), np.tile([[1.0, 0.0]], (len(tau), 1)), np.zeros(len(tau), dtype=np.intp), tau, resolution=float(np.spacing(1e10))
    )
    phase = frequency * tau.astype(np.longdouble)
    exact = np.column_stack([np.cos(phase), np.sin(phase)]).astype(float)
    assert np.all(np.abs(found - exact) < 8 * np.finfo(float).eps * np.maximum(phase.astype(float), 1.0)[:, None])


@pytest.mark.parametrize("off", [0.0, 1e-12, 3e-7])
def test_times_that_recur_to_within_rounding(off: float) -> None:
    """Lengths of pieces that are even but for rounding, some that are not among them; against the exponential of each time."""
    rng = np.random.default_rng(2)
    M = rng.normal(size=(5, 5)) - 2 * np.eye(5)
    v, X = rng.normal(size=(400, 5)), rng.normal(size=(3, 5))
    tau = np.where(np.arange(400) % 3 == 0, 0.7, 0.2) * (1 + off * rng.uniform(-1, 1, 400))
    tau[::50] = rng.uniform(0.0, 3.0, 8)
    propagator = Propagator(M)
    expected = np.array([X @ scipy.linalg.expm(M * t) @ w for t, w in zip(tau, v, strict=True)])
    for _ in range(2):  # found, then remembered
        assert propagator.outputs(X, v, np.arange(400), tau) == pytest.approx(expected, rel=1e-13, abs=1e-13)
    assert transition(propagator, tau[0]) == pytest.approx(scipy.linalg.expm(M * tau[0]), rel=1e-13, abs=1e-14)


def test_a_chain_of_integrators_over_times_that_recur_keeps_the_digits_of_its_smallest_term() -> None:
    """x_1 after t is x_4 t^3 / 6, some 1e-13 of x_4, over lengths that rounding sets apart."""
    tau = np.diff(np.linspace(3.0, 3.01, 201))
    M, v = np.diag([1.0, 1.0, 1.0], k=1), np.tile([0.0, 0.0, 0.0, 5.0], (200, 1))
    found = Propagator(M).outputs(np.eye(4)[:1], v, np.arange(200), tau)[:, 0]
    assert found == pytest.approx(5.0 * tau**3 / 6, rel=1e-14, abs=0)


@pytest.mark.parametrize("count", [1, 15, 16, 17, 33, 300, 5000])
def test_pieces_that_follow_one_from_the_other(count: int) -> None:
    """Against the recurrence itself, with scipy's exponential of each piece."""
    rng = np.random.default_rng(count)
    A = rng.normal(size=(3, 3)) - 2 * np.eye(3)
    added, lengths = rng.normal(size=(count, 3)), rng.choice([0.01, 0.2, 1.0], size=count)
    known = {length: scipy.linalg.expm(A * length) for length in (0.01, 0.2, 1.0)}
    expected = np.zeros((count + 1, 3))
    for j in range(count):
        expected[j + 1] = known[lengths[j]] @ expected[j] + added[j]
    found = forced_states(Propagator(A), added, lengths)
    assert found == pytest.approx(expected, abs=1e-13 * np.max(np.abs(expected)))
