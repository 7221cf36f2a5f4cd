"""How long a decaying part stays above a share of the peak."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.linear.propagation import Propagator
from invtrack.plans.problem import decay_stops
from invtrack.plans.tail import Tail
from invtrack.references.profiles import autonomous, raised_cosine, rest_to_rest


def departure(M: np.ndarray, X: np.ndarray, v: np.ndarray) -> Tail:
    """What dies out around zero."""
    return replace(Tail.holding(1, np.zeros(len(X))), departure=Propagator(M), X=X, v=v)


def modes(rates: list[float], v: list[float]) -> Tail:
    return departure(np.diag(rates), np.ones((1, len(rates))), np.array(v))


@pytest.mark.parametrize("peak", [2.0, 10.0])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10, 0.5])
def test_one_mode(peak: float, tolerance: float) -> None:
    """2 e^-3t falls below tolerance x peak at ln(2 / (peak tolerance)) / 3."""
    expected = max(0.0, np.log(2.0 / (peak * tolerance)) / 3)
    assert modes([-3.0], [2.0]).decay_time(np.array([peak]), tolerance) == pytest.approx(expected, rel=5e-3)


def test_a_slow_mode_that_is_hardly_there_does_not_count() -> None:
    """e^-100t + 1e-12 e^-0.01t: the slow part never exceeds the tolerance."""
    found = modes([-100.0, -0.01], [1.0, 1e-12]).decay_time(np.array([1.0]), 1e-6)
    assert found == pytest.approx(np.log(1e6) / 100, rel=5e-3)


def test_transient_growth_is_waited_for() -> None:
    """t e^-t rises before it falls: t e^-t = 1e-6 at t = 16.6265."""
    jordan = departure(np.array([[-1.0, 1.0], [0.0, -1.0]]), np.array([[1.0, 0.0]]), np.array([0.0, 1.0]))
    assert jordan.decay_time(np.array([1.0]), 1e-6) == pytest.approx(16.6265, rel=5e-3)


def test_nothing_to_decay() -> None:
    assert Tail.holding(1, np.zeros(1)).decay_time(np.array([1.0]), 1e-9) == pytest.approx(0.0)
    assert modes([-1.0], [0.0]).decay_time(np.array([1.0]), 1e-9) == pytest.approx(0.0)


def test_share_left() -> None:
    assert modes([-1.0], [2.0]).shares(np.array([3.0]), np.array([4.0]))[0] == pytest.approx(np.exp(-3) / 2)


def test_what_does_not_die_out_lasts_for_ever() -> None:
    ringing = departure(np.array([[0.0, 2.0], [-2.0, 0.0]]), np.array([[1.0, 0.0]]), np.array([0.0, 1.0]))
    assert ringing.lasts
    assert ringing.decay_time(np.array([1.0]), 1e-6) == np.inf
    assert not replace(ringing, v=np.zeros(2)).lasts


@pytest.mark.parametrize("direction", [-1, 1])
def test_values_and_their_derivative_against_closed_form(direction: int) -> None:
    """2 e^-3s + sin(5 t) at t = direction s: time runs against the distance before the manoeuvre."""
    S = np.array([[0.0, 5.0], [-5.0, 0.0]])
    tail = Tail(
        direction, Propagator(np.array([[-3.0]])), np.eye(1), np.array([2.0]), S, np.array([[1.0, 0.0]]), np.array([0.0, 1.0])
    )
    s = np.array([0.0, 0.1, 1.0])
    expected = 2 * np.exp(-3 * s) + np.sin(5 * direction * s)
    slope = -6 * direction * np.exp(-3 * s) + 5 * np.cos(5 * direction * s)
    assert tail.values(s, slice(None), 0.0)[:, 0] == pytest.approx(expected, abs=1e-13)
    assert tail.derivative().values(s, slice(None), 0.0)[:, 0] == pytest.approx(slope, abs=1e-12)
    assert tail.mapped(np.array([[2.0], [-1.0]])).values(s, slice(None), 0.0) == pytest.approx(np.outer(expected, [2.0, -1.0]))
    assert not tail.holds_still
    assert Tail.holding(direction, np.array([4.0])).holds_still


def test_only_references_that_decay_are_cut() -> None:
    assert decay_stops(raised_cosine(2.0) + rest_to_rest(0.0, 1.0, 30.0)).size == 0
    assert decay_stops(autonomous(2.0, 1.0, 1.0, start=0.0, end=20.0)).size == 0
    stops = decay_stops(autonomous(-2.0, 1.0, 1.0, start=0.0, end=20.0))
    steps = np.diff([0.0, *stops, 20.0])
    assert np.all(steps > 0)
    assert np.all(2.0 * steps < 4.0)
