"""Gains of estimators: their poles, and what they refuse."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import expm

from invtrack.control.observer import KalmanFilter, LuenbergerObserver
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from tests.cited_plants import cantilever_paper
from tests.linear.random_plants import assert_same_set

CANTILEVER = StateSpace(*cantilever_paper(100.0))
POLES = (-2 + 2j, -2 - 2j, -1.5 + 1j, -1.5 - 1j, -1 + 0.5j, -1 - 0.5j)
DOUBLE_INTEGRATOR = StateSpace([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])


def estimation_poles(system: StateSpace, M: np.ndarray, period: float) -> np.ndarray:
    """Those of the estimation error from update to update."""
    A_d = expm(system.A * period)
    return np.linalg.eigvals(A_d - M @ system.measurement.C @ A_d)


@pytest.mark.parametrize("period", [2e-3, 0.05])
def test_placed_poles(period: float) -> None:
    M = LuenbergerObserver(POLES).gain(CANTILEVER, period)
    assert_same_set(estimation_poles(CANTILEVER, M, period), np.exp(np.array(POLES) * period), 1e-8)


def test_kalman_filter_is_the_best_constant_gain() -> None:
    """The covariance of the estimation error, of a Lyapunov equation, grows with every change of the gain."""
    period, noise, deviation = 0.1, 2.0, 0.05
    best = KalmanFilter(noise, deviation).gain(DOUBLE_INTEGRATOR, period)
    h = period
    A_d, C = np.array([[1.0, h], [0.0, 1.0]]), DOUBLE_INTEGRATOR.C
    Q = noise**2 * np.array([[h**3 / 3, h**2 / 2], [h**2 / 2, h]])

    def covariance(M: np.ndarray) -> float:
        """Trace of P = (I - M C) (A_d P A_d' + Q) (I - M C)' + M R M', by iteration."""
        left, P = np.eye(2) - M @ C, np.zeros((2, 2))
        for _ in range(2000):
            P = left @ (A_d @ P @ A_d.T + Q) @ left.T + deviation**2 * M @ M.T
        return float(np.trace(P))

    least = covariance(best)
    for change in ([0.01, 0.0], [-0.01, 0.0], [0.0, 0.05], [0.0, -0.05]):
        assert covariance(best + np.array(change)[:, None]) > least


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("period", [1e-3, 0.1])
def test_modes_that_the_measurements_do_not_show_are_noticed_in_any_coordinates(seed: int, period: float) -> None:
    rng = np.random.default_rng(seed)
    system = StateSpace(np.diag([-1.0, -2.0, -5.0]), np.ones((3, 1)), [[1.0, 1.0, 0.0]]).transformed(rng.normal(size=(3, 3)))
    expected = r"observer poles cannot be placed: the measurements \['y1'\] do not show the mode -5 \(.*; keep -5 among the poles"
    with pytest.raises(ControlError, match=expected):
        LuenbergerObserver([-3.0, -4.0, -6.0]).gain(system, period)
    kept = [-3.0, -4.0, -5.0]
    M = LuenbergerObserver(kept).gain(system, period)
    assert_same_set(np.log(estimation_poles(system, M, period)) / period, kept, 1e-6)


@pytest.mark.parametrize("period", [1e-4, 1e-2, 1.0])
def test_poles_may_all_be_equal(period: float) -> None:
    """z^2 - tr z + det = (z - e^(-2 h))^2 for the double integrator, M = [m1, m2]: det = 1 - m1, tr = 2 - m1 - h m2."""
    M = LuenbergerObserver([-2.0, -2.0]).gain(DOUBLE_INTEGRATOR, period)[:, 0]
    shrink = -np.expm1(-2.0 * period)  # 1 - z
    assert M[0] == pytest.approx(shrink * (2.0 - shrink), rel=1e-6)
    assert M[1] * period == pytest.approx(shrink**2, rel=1e-6)


def test_a_mode_that_keeps_the_filter_from_settling_is_named() -> None:
    unseen = StateSpace(np.diag([0.0, -2.0]), np.ones((2, 1)), [[0.0, 1.0]], states=["heading", "speed"])
    with pytest.raises(ControlError, match=r"no steady Kalman gain: the measurements .* do not show the mode 0 \(of heading\)"):
        KalmanFilter(1.0, 1.0).gain(unseen, 0.01)
    quiet = StateSpace(np.diag([0.0, -2.0]), [[0.0], [1.0]], [[1.0, 1.0]], states=["bias", "speed"])
    with pytest.raises(ControlError, match=r"noise at the inputs \['u1'\] does not disturb the mode 0 \(of bias\)"):
        KalmanFilter(1.0, 1.0).gain(quiet, 0.01)
    assert np.all(np.abs(estimation_poles(quiet, LuenbergerObserver([-1.0, -3.0]).gain(quiet, 0.01), 0.01)) < 1)  # as advised


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: LuenbergerObserver([-1.0]).gain(DOUBLE_INTEGRATOR, 0.1), "expected 2 observer poles left of the imaginary axis"),
        (lambda: LuenbergerObserver([-1.0, -1.0 + 1j]), "complex ones in conjugate pairs"),
        (lambda: KalmanFilter(0.0, 1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"input_noise must be positive, got \[0\.0\]"),
        (lambda: KalmanFilter(1.0, -1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"measurement_noise must be positive, got \[-1\.0\]"),
        (lambda: KalmanFilter(np.nan, 1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"input_noise must be finite, one number for each of"),
        (lambda: KalmanFilter([1.0, 1.0], 1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"input_noise .* one number for each of \['u1'\]"),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        build()
