"""Weights that change with frequency: what is attained, how honestly it is stated, and functions that are no weights."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from invtrack.errors import RedesignError
from invtrack.linear.state_space import StateSpace
from invtrack.redesign.prefilter.prefilter import prefilter
from invtrack.references.profiles import piecewise_polynomial, raised_cosine, rest_to_rest
from tests.redesign.plants import TWIST, TWO_DISC

Array = NDArray[np.float64]

INTEGRATOR = StateSpace([[0.0]], [[1.0]], [[1.0]])
OSCILLATOR = StateSpace([[0.0, 1.0], [-4.0, 0.0]], [[0.0], [1.0]], [[1.0, 0.0]])
PERIOD = 2.0


def brick(edge: float, low: float, high: float) -> Callable[[float], float]:
    return lambda w: low if abs(w) < edge else high


def roll_off(edge: float) -> Callable[[float], float]:
    return lambda w: 1.0 / (1.0 + (w / edge) ** 8)


def exact_output(R: Callable[[float], float], edge: float, times: Array) -> Array:
    """y_opt of the integrator for 1 - cos(pi t) over one period: the inverse transform of Y_d / (1 + R w^2) by Gauss's rule.

    Its panels end where R jumps, and are short against 1 / |t|; beyond 300 rad/s less than 1e-12 is left.
    """
    nodes, weights = np.polynomial.legendre.leggauss(8)
    ends = np.concatenate([np.linspace(0.0, edge, 2 * int(np.ceil(30 * edge))), np.linspace(edge, 300.0, 10_000)[1:]])
    half = np.diff(ends)[:, None] / 2
    w = (ends[:-1, None] + half + half * nodes).ravel()
    a = 2 * np.pi / PERIOD

    def of_exponential(k: Array) -> Array:
        """Integral of exp(-jkt) over the period."""
        return np.asarray(PERIOD * np.exp(-0.5j * k * PERIOD) * np.sinc(k * PERIOD / 2 / np.pi))

    Y = of_exponential(w) - (of_exponential(w - a) + of_exponential(w + a)) / 2
    integrand = Y / (1.0 + np.array([R(frequency) for frequency in w]) * w**2) * (half * weights).ravel()
    return np.array([np.sum((integrand * np.exp(1j * w * t)).real) / np.pi for t in times])


@pytest.mark.parametrize("edge", [1.0, 20.0])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-8])
def test_a_weight_that_jumps_gets_what_is_attainable(edge: float, tolerance: float) -> None:
    R, times = brick(edge, 1e-3, 1.0), np.array([-20.0, -3.0, 0.5, 1.0, 2.5, 10.0, 40.0])
    found = prefilter(INTEGRATOR, R=R, Q_y=1.0).apply(raised_cosine(2.0, period=PERIOD), times, tolerance=tolerance)
    missed = np.max(np.abs(found.y[:, 0] - exact_output(R, edge, times))) / np.max(np.abs(found.y))
    assert missed <= found.truncation_error < 1e-3
    assert (found.truncation_error <= tolerance) == (found.remarks == ())
    if found.remarks:
        (remark,) = found.remarks
        assert f"truncated by {found.truncation_error:.1e} of its peak, more than the tolerance" in remark
        assert "it dies out slowly in time, as where a weight changes abruptly with frequency" in remark


@pytest.mark.parametrize(
    "weights",
    [
        {"R": brick(20.0, 1e-3, 1.0), "Q_y": 1.0},
        {"R": 1.0, "Q_y": brick(3.0, 1.0, 0.0)},
        {"R": 1.0, "Q_y": roll_off(3.0)},
        {"R": lambda w: 1e-3 + 1.0 - roll_off(20.0)(w), "Q_y": 1.0},
    ],
    ids=["R jumps", "Q_y jumps to zero", "Q_y rolls off", "R rises"],
)
def test_a_slew_of_the_rig_with_band_limited_weights(weights: dict[str, Any]) -> None:
    """Smooth references have so little left where the weights change that the default tolerance is met."""
    found = prefilter(TWO_DISC, Q_x=5000.0 * TWIST.T @ TWIST, **weights)
    plan = found.apply(rest_to_rest(0.0, 1.0, 6.0), np.linspace(-20.0, 40.0, 301))
    assert plan.truncation_error <= 1e-8
    assert plan.remarks == ()


def test_outside_its_band_nothing_of_the_output_is_followed() -> None:
    found = prefilter(TWO_DISC, R=1.0, Q_y=brick(3.0, 1.0, 0.0)).frequency_response([1.0, 2.9, 3.1, 10.0])
    assert np.all(np.abs(found.G_f[:2]) > 0.01)
    assert not np.any(found.stacked[2:])


def test_the_kernel_of_a_weight_that_jumps_dies_out_as_one_over_time() -> None:
    """From the jump of G_f = 1 / (1 + R w^2) at the edge w_c: g_f tends to (G_f(w_c-) - G_f(w_c+)) sin(w_c t) / (pi t)."""
    times = np.linspace(39.0, 41.0, 101)
    kernel = prefilter(INTEGRATOR, R=brick(3.0, 1e-3, 1.0), Q_y=1.0).impulse_response(times, tolerance=1e-6)
    jump = 1 / (1 + 9e-3) - 1 / (1 + 9.0)
    assert kernel.g_f[:, 0, 0] == pytest.approx(jump * np.sin(3.0 * times) / (np.pi * times), abs=5e-4)
    assert 1e-6 < kernel.truncation_error < 1e-3
    assert "more than the tolerance 1.0e-06" in kernel.remarks[0]
    with pytest.raises(RedesignError, match=r"hides when it stays below 1e-05 of it; ask for a level above"):
        kernel.preview_time(1e-5)


def test_what_is_of_no_use_is_refused_with_its_reason() -> None:
    direct = prefilter(StateSpace([[-1.0]], [[1.0]], [[1.0]], [[1.0]]), R=1.0, Q_y=1.0)
    step = piecewise_polynomial([0.0, 1.0], [[2.0]], held=(0.0, 0.0))
    with pytest.raises(
        RedesignError, match=r"twice the bandwidth .* and refinement does not lead below 0\.01; use a smoother reference"
    ):
        direct.apply(step)
    jagged = prefilter(OSCILLATOR, R=lambda w: 1.0 + int(abs(w) * 1e6) % 2, Q_y=1.0)
    with pytest.raises(RedesignError, match=r"does not lead below 0\.01; use weights that change less abruptly with frequency"):
        jagged.apply(raised_cosine(2.0, period=PERIOD))


@pytest.mark.parametrize("name", ["R", "Q_x", "Q_y"])
@pytest.mark.parametrize(
    ("function", "match"),
    [
        (lambda w: None, ".* at w = 0 rad/s must be numbers, got None"),
        (lambda w: "dear", ".* at w = 0 rad/s"),
        (lambda w: {}, ".* at w = 0 rad/s"),
        (lambda w: np.nan, "has entries that are not finite at w = 0 rad/s"),
        (lambda w: 1.0 if abs(w) < 50 else np.nan, r"has entries that are not finite at w = \d+\.\d+ rad/s"),
        (lambda w: 1.0 if abs(w) < 50 else -1.0, r"must be positive semidefinite.* at w = \d+\.\d+ rad/s"),
        (lambda w: np.eye(3), r"got shape \(3, 3\) at w = 0 rad/s"),
        (lambda w: [1.0], r"got shape \(1,\) at w = 0 rad/s"),
        (lambda w: 1.0 + 1j * w, r"must be Hermitian.* at w = 0\.\d+ rad/s"),
        (lambda w: 1.0 / w, "of the frequency must have a value at every w.* at w = 0 rad/s it ends in ZeroDivisionError: float"),
        (lambda w, v: 1.0, "of the frequency must have a value at every w.* at w = 0 rad/s it ends in TypeError"),
    ],
)
def test_functions_that_are_no_weights(name: str, function: Any, match: str) -> None:
    with pytest.raises(RedesignError, match=f"{name}.*{match}"):
        prefilter(OSCILLATOR, **{"R": 1.0, "Q_y": 1.0, name: function})


def test_a_weight_is_asked_once_at_each_frequency() -> None:
    asked: list[float] = []

    def weight(w: float) -> float:
        asked.append(w)
        return 1.0

    found = prefilter(INTEGRATOR, R=weight, Q_y=1.0)
    asked.clear()
    found.apply(raised_cosine(2.0, period=PERIOD), [0.0])
    assert len(asked) - len(set(asked)) <= 2  # w = 0 also for the held values
