"""Inputs that cost next to nothing: the optimum tends to exact inversion, and never costs more than it."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import RedesignError
from invtrack.inversion.exact import invert
from invtrack.linear.state_space import StateSpace
from invtrack.redesign.constrained import constrained_redesign
from invtrack.redesign.cost import cost
from invtrack.redesign.limits import Limits
from invtrack.redesign.prefilter.prefilter import prefilter
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.redesign.plants import NONMINIMUM

# A zero at +1, relative degree 1.
ZERO_AT_ONE = StateSpace([[0, 1.0], [-2, -3]], [[0], [1.0]], [[-1.0, 1]])


def pulse(smoothness: int = 3) -> PiecewiseSignal:
    there = rest_to_rest(0.0, 1.0, duration=2.0, smoothness=smoothness)
    return there + rest_to_rest(0.0, -1.0, duration=2.0, start_time=3.0, smoothness=smoothness)


@pytest.mark.parametrize("R", [1.0, 1e-6, 1e-10, 1e-12, 1e-14, 1e-16, 1e-20])
def test_no_dearer_than_exact_inversion(R: float) -> None:
    plan = quadratic_redesign(ZERO_AT_ONE, pulse(), R=R, Q_y=1.0)
    assert cost(plan, R=R, Q_y=1.0) <= cost(invert(ZERO_AT_ONE, pulse()), R=R, Q_y=1.0)
    assert plan.optimality_gap < 1e-7


@pytest.mark.parametrize("scale", [1e-290, 1e-18, 1e18, 1e290])
def test_what_weights_are_counted_in_changes_nothing(scale: float) -> None:
    times = np.linspace(-3.0, 8.0, 50)
    plain, other = (quadratic_redesign(ZERO_AT_ONE, pulse(), R=1e-3 * unit, Q_y=unit) for unit in (1.0, scale))
    assert np.max(np.abs(plain(times).u - other(times).u)) < 1e-12 * np.max(np.abs(plain(times).u))


@pytest.mark.parametrize("dear", [1e32, 1e100, 1e300])
def test_an_output_error_dear_beyond_all_measure(dear: float) -> None:
    plan = quadratic_redesign(ZERO_AT_ONE, pulse(), R=1.0, Q_y=dear)
    assert plan.optimality_gap < 1e-7
    exact = invert(ZERO_AT_ONE, pulse())
    times = np.linspace(-3.0, 8.0, 50)
    assert np.array_equal(plan(times).u, exact(times).u)
    assert any("exact inversion" in remark for remark in plan.remarks)


@pytest.mark.parametrize("weights", [{"R": 1e-300, "Q_y": 1e300}, {"R": 1.0, "Q_y": 1.0, "Q_x": 1e306}, {"R": 1e306, "Q_y": 1.0}])
def test_weights_that_no_unit_holds_are_refused_as_such(weights: dict[str, float]) -> None:
    with pytest.raises(RedesignError, match=r"weights must lie within 1e\+305 of each other, the largest, in .*, is 10.* times"):
        quadratic_redesign(ZERO_AT_ONE, pulse(), **weights)
    with pytest.raises(RedesignError, match=r"weights must lie within 1e\+305 of each other"):
        constrained_redesign(ZERO_AT_ONE, pulse(), limits=Limits(input=50.0), **weights)
    with pytest.raises(RedesignError, match=r"weights must lie within 1e\+150 of each other"):
        prefilter(ZERO_AT_ONE, **weights)


def test_inputs_too_dear_for_the_equations_are_refused_for_that() -> None:
    with pytest.raises(RedesignError, match=r"weights must lie within 1e\+150 of each other, the largest, in R, is 10\^300 times"):
        quadratic_redesign(ZERO_AT_ONE, pulse(), R=1e300, Q_y=1.0)


def test_the_least_move_of_inputs_as_dear_as_can_be() -> None:
    """With R so large that the input's own effect is negligible, u is proportional to 1 / R."""
    times = np.linspace(-3.0, 8.0, 50)
    dear, dearer = (quadratic_redesign(ZERO_AT_ONE, pulse(), R=R, Q_y=1.0)(times).u * R for R in (1e12, 1e140))
    assert np.max(np.abs(dear - dearer)) < 1e-10 * np.max(np.abs(dear))


def test_the_cost_in_the_frequency_domain() -> None:
    """The cost of the optimum in closed form: R |u|^2 / (1 + R / |G|^2) of each frequency, on a long window."""
    for R in (1e-4, 1e-8):
        plan = quadratic_redesign(ZERO_AT_ONE, pulse(), R=R, Q_y=1.0)
        count, step = 2**16, 1 / 512
        times = (np.arange(count) - count // 2) * step
        w = 2 * np.pi * np.fft.rfftfreq(count, step)
        G_2 = (1 + w**2) / (w**4 + 5 * w**2 + 4)  # |s - 1|^2 / |s^2 + 3 s + 2|^2
        Y_2 = np.abs(np.fft.rfft(pulse()(times)[:, 0])) ** 2 * step / count
        Y_2[1:] *= 2  # the conjugate half
        least = float(np.sum(R * Y_2 / (R + G_2)))
        assert cost(plan, R=R, Q_y=1.0) == pytest.approx(least, rel=1e-5)
        assert plan.optimality_gap < 1e-8


def test_a_reference_that_cannot_be_followed_exactly() -> None:
    """A ramp that stops dead: at relative degree 2 there is no exact inverse, and the optimum has layers at the kinks."""
    kinked = pulse(smoothness=0)
    plan = quadratic_redesign(NONMINIMUM, kinked, R=1e-10, Q_y=1.0)
    assert plan.optimality_gap < 1e-6
    cheaper = quadratic_redesign(NONMINIMUM, kinked, R=1e-12, Q_y=1.0)
    assert cost(cheaper, R=1e-12, Q_y=1.0) < cost(plan, R=1e-12, Q_y=1.0)


def test_what_cannot_be_certified_is_refused_with_the_figure() -> None:
    with pytest.raises(RedesignError, match=r"may cost up to .* of its cost too much, expected 0\.001 or less.*raise R"):
        quadratic_redesign(NONMINIMUM, pulse(smoothness=0), R=1e-22, Q_y=1.0)
