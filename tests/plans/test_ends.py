"""How long a decaying part stays above a share of the peak."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.plans.ends import Departure, decay_time
from invtrack.plans.problem import decay_stops
from invtrack.references.profiles import autonomous, raised_cosine, rest_to_rest


def departure(rates: list[float], v: list[float]) -> Departure:
    return Departure(np.diag(rates), np.ones((1, len(rates))), np.array(v))


@pytest.mark.parametrize("peak", [2.0, 10.0])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-10, 0.5])
def test_one_mode(peak: float, tolerance: float) -> None:
    """2 e^-3t falls below tolerance x peak at ln(2 / (peak tolerance)) / 3."""
    expected = max(0.0, np.log(2.0 / (peak * tolerance)) / 3)
    assert decay_time(departure([-3.0], [2.0]), np.array([peak]), tolerance) == pytest.approx(expected, rel=5e-3)


def test_a_slow_mode_that_is_hardly_there_does_not_count() -> None:
    """e^-100t + 1e-12 e^-0.01t: the slow part never exceeds the tolerance."""
    found = decay_time(departure([-100.0, -0.01], [1.0, 1e-12]), np.array([1.0]), 1e-6)
    assert found == pytest.approx(np.log(1e6) / 100, rel=5e-3)


def test_transient_growth_is_waited_for() -> None:
    """t e^-t rises before it falls: t e^-t = 1e-6 at t = 16.6265."""
    jordan = Departure(np.array([[-1.0, 1.0], [0.0, -1.0]]), np.array([[1.0, 0.0]]), np.array([0.0, 1.0]))
    assert decay_time(jordan, np.array([1.0]), 1e-6) == pytest.approx(16.6265, rel=5e-3)


def test_nothing_to_decay() -> None:
    assert decay_time(Departure(np.zeros((0, 0)), np.zeros((1, 0)), np.zeros(0)), np.array([1.0]), 1e-9) == pytest.approx(0.0)
    assert decay_time(departure([-1.0], [0.0]), np.array([1.0]), 1e-9) == pytest.approx(0.0)


def test_share_left() -> None:
    assert departure([-1.0], [2.0]).share_left(3.0, np.array([4.0])) == pytest.approx(np.exp(-3) / 2)


def test_only_references_that_decay_are_cut() -> None:
    assert decay_stops(raised_cosine(2.0) + rest_to_rest(0.0, 1.0, 30.0)).size == 0
    assert decay_stops(autonomous(2.0, 1.0, 1.0, start=0.0, end=20.0)).size == 0
    stops = decay_stops(autonomous(-2.0, 1.0, 1.0, start=0.0, end=20.0))
    steps = np.diff([0.0, *stops, 20.0])
    assert np.all(steps > 0)
    assert np.all(2.0 * steps < 4.0)
