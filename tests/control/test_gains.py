"""State feedback gains: optimality, signs, pole placement, refusals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
import scipy.linalg

from invtrack.control.gains import GainSchedule, place
from invtrack.control.lqr import lqr
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from tests.cited_plants import CANTILEVER_TIP_MASSES, cantilever_paper
from tests.linear.random_plants import assert_same_set

SYSTEMS = [StateSpace(*cantilever_paper(m)) for m in CANTILEVER_TIP_MASSES]
SWITCHED = SwitchedSystem(SYSTEMS, [np.pi / 2, 3 * np.pi / 2])
UNSTABLE_UNREACHED = StateSpace(np.diag([1.0, -2.0]), [[0.0], [1.0]], [[1.0, 1.0]])
STABLE_UNREACHED = StateSpace(np.diag([-1.0, -2.0]), [[0.0], [1.0]], [[1.0, 1.0]])
DOUBLE_INTEGRATOR = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
STABLE_LIKE_IT = StateSpace([[-2.0, 0.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])


def cost(system: StateSpace, K: np.ndarray, Q: np.ndarray, R: np.ndarray) -> float:
    """Integral of x'Q x + u'R u for u = -K x, summed over starts at the unit vectors: the trace of the Lyapunov solution."""
    closed = system.A - system.B @ K
    assert np.all(np.linalg.eigvals(closed).real < 0)
    return float(np.trace(scipy.linalg.solve_continuous_lyapunov(closed.T, -(Q + K.T @ R @ K))))


def test_every_change_of_the_lqr_gain_costs_more() -> None:
    """By a share that falls with the square of the change: the cost is stationary, and a minimum."""
    rng = np.random.default_rng(0)
    system = StateSpace(rng.normal(size=(4, 4)), rng.normal(size=(4, 2)), rng.normal(size=(2, 4)))
    Q, R = np.diag([1.0, 2.0, 0.5, 3.0]), np.array([[1.0, 0.2], [0.2, 0.5]])
    K = lqr(system, Q=Q, R=R).gains[0]
    best = cost(system, K, Q, R)
    for _ in range(20):
        direction = rng.normal(size=K.shape)
        far, near = ([cost(system, K + sign * h * direction, Q, R) - best for sign in (-1, 1)] for h in (1e-2, 1e-3))
        assert min(*far, *near) > 0
        assert sum(far) / sum(near) == pytest.approx(100, rel=0.05)


def test_lqr_of_the_double_integrator() -> None:
    """Q = I, R = 1: K = [1, sqrt 3]."""
    assert lqr(DOUBLE_INTEGRATOR, Q=1.0, R=1.0).gains[0] == pytest.approx(np.array([[1.0, np.sqrt(3.0)]]))


def test_numbers_stand_for_multiples_of_the_identity() -> None:
    assert lqr(SYSTEMS[1], Q=100.0, R=0.01).gains[0] == pytest.approx(lqr(SYSTEMS[1], Q=100 * np.eye(6), R=[[0.01]]).gains[0])


def test_every_interval_is_stabilized_by_minus_its_gain() -> None:
    schedule = lqr(SWITCHED, Q=100.0, R=0.01)
    assert schedule.switch_times == pytest.approx(SWITCHED.switch_times)
    for system, K in zip(SYSTEMS, schedule.gains, strict=True):
        assert np.all(np.linalg.eigvals(system.A - system.B @ K).real < 0)


def test_placed_poles_are_the_same_in_every_interval() -> None:
    poles = [-1.0, -1.5, -2 + 1j, -2 - 1j, -0.5 + 3j, -0.5 - 3j]
    for system, K in zip(SYSTEMS, place(SWITCHED, poles).gains, strict=True):
        assert_same_set(np.linalg.eigvals(system.A - system.B @ K), poles, 1e-8)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (
            lambda: lqr(DOUBLE_INTEGRATOR, Q=np.eye(3), R=1.0),
            r"Q must be a number or a \(2, 2\) matrix for the states \['x1', 'x2'\], got shape \(3, 3\)",
        ),
        (lambda: lqr(DOUBLE_INTEGRATOR, Q=[[1.0, 1.0], [0.0, 1.0]], R=1.0), "Q must be symmetric"),
        (
            lambda: lqr(DOUBLE_INTEGRATOR, Q=np.diag([1.0, -1.0]), R=1.0),
            "Q must be positive semidefinite, its smallest eigenvalue is -1",
        ),
        (lambda: lqr(DOUBLE_INTEGRATOR, Q=1.0, R=0.0), r"R must be positive definite.*weigh every one of the inputs \['u1'\]"),
        (lambda: lqr(DOUBLE_INTEGRATOR, Q=1.0, R=-1.0), "R must be positive semidefinite"),
        (lambda: lqr(DOUBLE_INTEGRATOR, Q=np.nan, R=1.0), "Q has entries that are not finite"),
        (lambda: lqr(UNSTABLE_UNREACHED, Q=1.0, R=1.0), r"no LQR gain: the inputs \['u1'\] do not move the mode 1 \(of x1\)"),
        (lambda: lqr(DOUBLE_INTEGRATOR, Q=0.0, R=1.0), r"no LQR gain: Q does not weigh the modes 0, 0 \(of x1, x2\)"),
        (
            lambda: lqr(DOUBLE_INTEGRATOR, Q=np.diag([0.0, 1.0]), R=1.0),
            r"Q does not weigh the mode 0 \(of x1\), on the imaginary axis",
        ),
        (lambda: place(DOUBLE_INTEGRATOR, [-1.0]), "expected 2 poles left of the imaginary axis"),
        (lambda: place(DOUBLE_INTEGRATOR, [-1.0, 0.0]), "expected 2 poles left of the imaginary axis"),
        (lambda: place(DOUBLE_INTEGRATOR, [-1.0, -1.0 + 1j]), "left of the imaginary axis, complex ones in conjugate pairs"),
        (
            lambda: place(STABLE_UNREACHED, [-3.0, -4.0]),
            r"poles cannot be placed: the inputs \['u1'\] do not move the mode -1 \(of x1\); keep -1 among the poles, or add",
        ),
        (
            lambda: place(UNSTABLE_UNREACHED, [-3.0, -4.0]),
            r"do not move the mode 1 \(of x1\), on or right of the imaginary axis; add an input that acts on these states",
        ),
        (
            lambda: place(SwitchedSystem([DOUBLE_INTEGRATOR, STABLE_LIKE_IT], [1.0]), [-3.0, -4.0]),
            r"interval 1: poles cannot be placed: .* the mode -2 \(of x1\)",
        ),
        (lambda: GainSchedule((np.zeros((1, 2)),), np.array([1.0])), "one gain more than switch times"),
        (lambda: GainSchedule((np.zeros((1, 2)), np.zeros((1, 3))), np.array([1.0])), r"shapes \[\(1, 2\), \(1, 3\)\]"),
        (lambda: GainSchedule((np.zeros((1, 2)),) * 3, np.array([2.0, 1.0])), "must be finite and increase"),
        (lambda: GainSchedule((np.full((1, 2), np.nan),), np.zeros(0)), "not finite"),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        build()


@pytest.mark.parametrize("seed", range(6))
def test_modes_that_cannot_be_moved_are_noticed_in_any_coordinates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, B, C = np.diag([-1.0, -2.0, -5.0]), np.array([[1.0], [1.0], [0.0]]), np.ones((1, 3))
    system = StateSpace(A, B, C).transformed(rng.normal(size=(3, 3)))
    with pytest.raises(ControlError, match=r"poles cannot be placed: .* do not move the mode -5 .*; keep -5 among the poles"):
        place(system, [-3.0, -4.0, -6.0])
    (K,) = place(system, [-3.0, -4.0, -5.0]).gains
    assert_same_set(np.linalg.eigvals(system.A - system.B @ K), [-3.0, -4.0, -5.0], 1e-7)


@pytest.mark.parametrize("seed", range(12))
def test_poles_may_repeat_as_often_as_one_likes_whatever_the_units(seed: int) -> None:
    """The characteristic polynomial, whose coefficients do not split as repeated roots do."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 7)), int(rng.integers(1, 4))
    system = StateSpace(rng.normal(size=(n, n)), rng.normal(size=(n, m)), rng.normal(size=(1, n)))
    units, inputs = 10.0 ** rng.integers(-5, 6, size=n), 10.0 ** rng.integers(-5, 6, size=m)
    scaled = StateSpace(system.A * units / units[:, None], system.B * inputs / units[:, None], system.C * units)
    poles = [-2.0] * n if seed % 2 or n < 4 else [-1 + 1j, -1 - 1j] * 2 + [-3.0] * (n - 4)
    (K,) = place(scaled, poles).gains
    wanted, found = np.real(np.poly(poles)), np.poly(system.A - system.B @ (K * inputs[:, None] / units))
    np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-8 * np.max(wanted))


def test_double_poles_that_take_large_gains() -> None:
    """Six states behind one input: closed loops up to 2000 times as large as their poles, still right to the last digits."""
    rng = np.random.default_rng(6)
    for _ in range(20):
        system = StateSpace(rng.normal(size=(6, 6)) / np.sqrt(6), rng.normal(size=(6, 1)), rng.normal(size=(1, 6)))
        poles = np.tile(-rng.uniform(0.5, 2.0, 3), 2)
        (K,) = place(system, poles.tolist()).gains
        wanted = np.real(np.poly(poles))
        np.testing.assert_allclose(np.poly(system.A - system.B @ K), wanted, atol=1e-9 * np.max(wanted))


def test_a_double_pole_of_the_double_integrator() -> None:
    """(s + 2)^2 = s^2 + 4 s + 4."""
    assert place(DOUBLE_INTEGRATOR, [-2.0, -2.0]).gains[0] == pytest.approx(np.array([[4.0, 4.0]]))


def test_a_chain_of_integrators_with_all_its_poles_equal() -> None:
    """(s + 1)^6 has binomial coefficients."""
    chain = StateSpace(np.eye(6, k=1), np.eye(6)[:, [5]], np.eye(6)[[0]])
    assert place(chain, [-1.0] * 6).gains[0] == pytest.approx(np.array([[1.0, 6.0, 15.0, 20.0, 15.0, 6.0]]), rel=1e-9)


def test_a_switch_time_belongs_to_the_gain_that_it_starts() -> None:
    schedule = GainSchedule((np.zeros((1, 2)), np.ones((1, 2))), np.array([1.0]))
    assert schedule.interval([0.999, 1.0, 2.0]).tolist() == [0, 1, 1]
