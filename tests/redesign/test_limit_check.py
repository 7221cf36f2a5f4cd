"""The largest excess of a limit within a step, wherever in the step it lies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import PolynomialSegments, Trajectory
from invtrack.redesign.limited.limit_check import worst_within_steps
from invtrack.redesign.limits import Bound


@pytest.mark.parametrize("peak", [0.0, 0.011, 0.03, 0.031, 0.26, 0.5, 0.97, 0.989, 1.0])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_top_of_a_parabola(peak: float, side: float) -> None:
    """side (3 - (t - peak)^2) against +-2: at its top it exceeds by half of the limit's size."""
    parabola = side * np.array([3 - peak**2, 2 * peak, -1.0]).reshape(1, 3, 1)
    zero, still = np.zeros(1, dtype=np.intp), Tail.holding(1, np.zeros(1))
    segments = PolynomialSegments(parabola, np.ones(1))
    trajectory = Trajectory(np.array([0.0, 1.0]), (segments,), zero, zero, replace(still, direction=-1), still)
    excess, share = worst_within_steps(trajectory, [Bound("value", "path", np.array([1.0]), -2.0, 2.0)])
    assert excess[0, 0] == pytest.approx(0.5, abs=1e-12)
    assert share[0, 0] == pytest.approx(peak, abs=1e-9)
