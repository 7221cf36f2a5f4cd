"""The exosystem's observer: its error against the designed decay, noise, refusals."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.control.observer import ExosystemObserver, KalmanFilter, LuenbergerObserver, states_within_holds
from invtrack.control.protocol import Instants
from invtrack.errors import ControlError
from invtrack.references.exosystem import Exosystem, exosystem, polynomial_exosystem, sinusoidal_exosystem, step_exosystem

PAPER_A = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]])
PAPER_C = np.array([[0.0, 0, 0, 1]])
POLES = (-3.0 + 1.0j, -3.0 - 1.0j, -4.0, -5.0)


def even(start: float, end: float, count: int, breakpoints: tuple[float, ...] = ()) -> Instants:
    """Instants at even distances whose holds come in two parts, cut in the middle, or at a breakpoint that lies within."""
    time = np.linspace(start, end, count, endpoint=False)
    hold = np.full(count, (end - start) / count)
    cut = time + hold / 2
    for t in breakpoints:
        within = (time < t) & (t < time + hold)
        cut[within] = t
    share = np.column_stack([cut - time, time + hold - cut]) / hold[:, None]
    middle = np.column_stack([(time + cut) / 2, (cut + time + hold) / 2])
    return Instants(time, hold, middle[:, 0], 2 * np.arange(count), middle.ravel(), middle.ravel(), share.ravel())


def errors(observed: Exosystem, observer: ExosystemObserver, asked: Instants, x_e: np.ndarray, initial: np.ndarray) -> np.ndarray:
    samples = observed.reference(x_e)(asked.time, inside=asked.inside)
    return observer.estimates(asked, samples, initial) - observed.states(x_e, None, asked.time, inside=asked.inside)


def test_a_wrong_estimate_decays_as_the_poles_say() -> None:
    """The error after a time t lies in the span of the designed modes exp(s t), whatever the period."""
    paper = exosystem(PAPER_A, PAPER_C)
    observer = ExosystemObserver(paper, LuenbergerObserver(POLES))
    x_e = np.array([0.3, 1.0, -0.5, 0.2])
    for count in (40, 400):
        asked = even(0.0, 4.0, count)
        error = errors(paper, observer, asked, x_e, np.zeros(4))
        modes = np.exp(np.outer(asked.time, POLES))
        fitted, *_ = np.linalg.lstsq(modes, error.astype(complex), rcond=None)
        np.testing.assert_allclose(modes @ fitted, error, atol=1e-8 * np.abs(error).max())
        assert np.abs(error[0]).max() > 0.1


def test_the_slowest_pole_is_what_is_left() -> None:
    paper = exosystem(PAPER_A, PAPER_C)
    observer = ExosystemObserver(paper, LuenbergerObserver((-1.0, -4.0, -5.0, -6.0)))
    error = errors(paper, observer, even(0.0, 12.0, 1200), np.array([0.0, 1, 0, 0]), np.zeros(4))
    size = np.linalg.norm(error, axis=1)
    assert np.log(size[600] / size[1100]) / 5.0 == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("step_length", [1e-3, 1e-4])
def test_short_periods_keep_the_poles(step_length: float) -> None:
    """Also where all four of exp(s h) lie close to 1."""
    paper = exosystem(PAPER_A, PAPER_C)
    asked = even(0.0, 3000 * step_length, 3000)
    error = errors(paper, ExosystemObserver(paper, LuenbergerObserver(POLES)), asked, np.array([0.0, 1, 0, 0]), np.zeros(4))
    modes = np.exp(np.outer(asked.time, POLES))
    fitted, *_ = np.linalg.lstsq(modes, error.astype(complex), rcond=None)
    np.testing.assert_allclose(modes @ fitted, error, atol=1e-6 * np.abs(error).max())


def test_before_its_start_and_after_its_end_the_estimate_stands_still() -> None:
    paper = exosystem(PAPER_A, PAPER_C, start=0.0, end=2 * np.pi)
    observer = ExosystemObserver(paper, LuenbergerObserver(POLES))
    asked = even(-2.0, 9.0, 1100, (0.0, 2 * np.pi))
    x_e, guess = np.array([0.0, 1, 0, 0]), np.array([0.1, 0.2, 0.3, 0.4])
    samples = paper.reference(x_e)(asked.time, inside=asked.inside)
    estimate = observer.estimates(asked, samples, guess)
    before, after = asked.inside < 0, asked.time >= 2 * np.pi
    assert np.all(estimate[before] == guess)
    np.testing.assert_allclose(estimate[after], np.broadcast_to(x_e, (after.sum(), 4)), atol=1e-6)
    assert np.all(estimate[after] == estimate[after][0])


def test_a_right_estimate_stays_right_through_switches_of_the_exosystem() -> None:
    switched = Exosystem([PAPER_A, 2 * PAPER_A, -PAPER_A], [PAPER_C, PAPER_C, 3 * PAPER_C], [0.613, 1.107])
    observer = ExosystemObserver(switched, LuenbergerObserver(POLES))
    x_e = np.array([0.4, 1.0, -0.2, 0.3])
    asked = even(0.0, 2.0, 50, (0.613, 1.107))
    error = errors(switched, observer, asked, x_e, switched.states(x_e, None, [0.0])[0])
    np.testing.assert_allclose(error, 0, atol=1e-10)
    within = states_within_holds(switched, asked, switched.states(x_e, None, asked.time))
    np.testing.assert_allclose(within, switched.states(x_e, None, asked.part_middle), atol=1e-12)


def test_a_standing_exosystem_is_estimated_where_its_output_tells_its_state() -> None:
    held = step_exosystem(start=0.0)
    observer = ExosystemObserver(held, LuenbergerObserver((-2.0,)))
    error = errors(held, observer, even(0.0, 3.0, 300), np.array([5.0]), np.zeros(1))[:, 0]
    assert np.log(error[50] / error[250]) / 2.0 == pytest.approx(2.0, rel=1e-6)


def test_a_kalman_filter_weighs_the_noise() -> None:
    """For small drive the filter trusts its model: the estimate is smoother than a fast observer's, and unbiased."""
    wanted = sinusoidal_exosystem([1.0], bias=False)
    asked = even(0.0, 60.0, 6000)
    x_e, noise = np.array([1.0, 0.0]), 0.05
    samples = wanted.reference(x_e)(asked.time)
    noisy = samples + noise * np.random.default_rng(1).standard_normal(samples.shape)
    spread = {}
    for name, design in (("kalman", KalmanFilter(1e-3, noise)), ("fast", LuenbergerObserver((-10.0, -12.0)))):
        estimate = ExosystemObserver(wanted, design).estimates(asked, noisy, x_e)
        spread[name] = np.std((estimate - wanted.states(x_e, None, asked.time))[3000:], axis=0)
    assert np.all(spread["kalman"] < 0.2 * spread["fast"])
    assert np.all(spread["kalman"] < noise)


def test_a_mode_that_the_output_does_not_show_is_named() -> None:
    hidden = Exosystem([np.diag([-0.25, 0.0])], [[[1.0, 0.0]]], names=["seen", "hidden"])
    with pytest.raises(ControlError, match=r"does not show its mode\(s\) with eigenvalue\(s\) 0, .*'seen', 'hidden'"):
        ExosystemObserver(hidden, LuenbergerObserver((-1.0, -2.0)))
    twice = Exosystem([np.kron(np.eye(2), [[0.0, 2.0], [-2.0, 0.0]])], [[[1.0, 0, 1.0, 0]]])
    with pytest.raises(ControlError, match=r"0\+2j.*leave what no output needs out"):
        ExosystemObserver(twice, LuenbergerObserver((-1.0, -2.0, -3.0, -4.0)))


def test_poles_of_the_wrong_number_are_refused() -> None:
    observer = ExosystemObserver(polynomial_exosystem(2), LuenbergerObserver((-1.0, -2.0)))
    with pytest.raises(ControlError, match="expected 3 observer poles"):
        observer.estimates(even(0.0, 1.0, 4), np.zeros((4, 1)), np.zeros(3))
