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
    with pytest.raises(ControlError, match=r"observer poles cannot be placed: .*measurements \['y1'\] must show every mode"):
        LuenbergerObserver([-3.0, -4.0, -6.0]).gain(system, period)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: LuenbergerObserver([-1.0]).gain(DOUBLE_INTEGRATOR, 0.1), "expected 2 observer poles left of the imaginary axis"),
        (lambda: LuenbergerObserver([-1.0, -1.0]).gain(DOUBLE_INTEGRATOR, 0.1), "observer poles cannot be placed"),
        (lambda: KalmanFilter(0.0, 1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"input_noise must be positive, got \[0\.0\]"),
        (lambda: KalmanFilter(1.0, -1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"measurement_noise must be positive, got \[-1\.0\]"),
        (lambda: KalmanFilter(np.nan, 1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"input_noise must be finite, one number for each of"),
        (lambda: KalmanFilter([1.0, 1.0], 1.0).gain(DOUBLE_INTEGRATOR, 0.1), r"input_noise .* one number for each of \['u1'\]"),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(ControlError, match=message):
        build()
