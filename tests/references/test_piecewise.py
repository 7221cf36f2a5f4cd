"""The one representation of references: sides, derivatives, sums and changes of form, as laws."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.polynomial import Polynomial

from invtrack.errors import TrajectoryError
from invtrack.references.generator import Generator, constant_generator
from invtrack.references.profiles import autonomous, constant, piecewise_polynomial, raised_cosine, rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack

TIMES = np.linspace(-2.0, 7.0, 181)
laws = settings(deadline=None, max_examples=30, derandomize=True)
seeds = st.integers(0, 10**6)


def random_signal(seed: int, channels: int = 2) -> PiecewiseSignal:
    """Some cubic pieces that need not fit together, plus a damped oscillation that is switched on and off."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 4))
    edges = np.cumsum(rng.uniform(0.3, 1.5, size=count + 1)) - 1.0
    polynomial = piecewise_polynomial(edges, [rng.normal(size=(channels, 4)) for _ in range(count)])
    S = [[0.0, 1.0], [-4.0, -0.3]]
    start = float(rng.uniform(-1.0, 1.0))
    return polynomial + autonomous(S, rng.normal(size=(channels, 2)), rng.normal(size=2), start=start, end=start + 2.0)


@laws
@given(seeds, seeds, st.integers(0, 3))
def test_a_sum_has_the_sum_of_the_derivatives(first: int, second: int, order: int) -> None:
    a, b = random_signal(first), random_signal(second)
    assert (a + b)(TIMES, derivative=order) == pytest.approx(a(TIMES, derivative=order) + b(TIMES, derivative=order), abs=1e-9)


@laws
@given(seeds, seeds, st.integers(0, 2))
def test_stacking_puts_channels_side_by_side(first: int, second: int, order: int) -> None:
    a, b = random_signal(first, 1), random_signal(second, 2)
    both = stack([a, b, a])
    assert both.n_channels == 4
    parts = [signal(TIMES, derivative=order) for signal in (a, b, a)]
    assert both(TIMES, derivative=order) == pytest.approx(np.hstack(parts), abs=1e-9)


@laws
@given(seeds, st.floats(-50.0, 50.0))
def test_a_shift_moves_everything_later(seed: int, delay: float) -> None:
    signal = random_signal(seed)
    inner = (signal.breakpoints[1:] + signal.breakpoints[:-1]) / 2  # away from breakpoints, where rounding would choose the side
    moved = signal.shifted(delay)
    assert moved(inner + delay, derivative=1) == pytest.approx(signal(inner, derivative=1), abs=1e-9)
    assert moved.manoeuvre == pytest.approx(tuple(t + delay for t in signal.manoeuvre))


@laws
@given(seeds)
def test_scaling_by_a_number_and_by_a_matrix(seed: int) -> None:
    signal = random_signal(seed)
    assert signal.scaled(-3.0)(TIMES) == pytest.approx(-3 * signal(TIMES))
    matrix = np.array([[1.0, 2.0], [0.0, -1.0], [5.0, 0.0]])
    assert signal.scaled(matrix)(TIMES, derivative=2) == pytest.approx(signal(TIMES, derivative=2) @ matrix.T, abs=1e-9)


@laws
@given(seeds, st.lists(st.floats(-3.0, 8.0), max_size=6))
def test_further_breakpoints_change_nothing(seed: int, extra: list[float]) -> None:
    signal = random_signal(seed)
    refined = signal.refined(extra)
    assert set(refined.breakpoints) == set(signal.breakpoints) | set(extra)
    for order in (0, 1, 3):
        assert refined(TIMES, derivative=order) == pytest.approx(signal(TIMES, derivative=order), abs=1e-9)


def test_breakpoints_that_are_there_already_keep_the_signal_itself() -> None:
    signal = raised_cosine(2.0)
    assert signal.refined(signal.breakpoints) is signal
    assert signal.refined([]) is signal


@laws
@given(seeds)
def test_derivatives_against_central_differences(seed: int) -> None:
    signal, h = random_signal(seed), 1e-4
    inner = (signal.breakpoints[1:] + signal.breakpoints[:-1]) / 2
    difference = (signal(inner + h, inside=inner) - signal(inner - h, inside=inner)) / (2 * h)
    assert difference == pytest.approx(signal(inner, derivative=1), abs=1e-5)


def test_sides_of_a_breakpoint() -> None:
    """1 on [0, 1], 1 + 2 (t - 1) on [1, 3]; held at 0 before and at 9 after."""
    signal = piecewise_polynomial([0.0, 1.0, 3.0], [[1.0], [1.0, 2.0]], held=(0.0, 9.0))
    assert signal([0.0, 1.0, 3.0])[:, 0] == pytest.approx([1.0, 1.0, 9.0])
    assert signal([0.0, 1.0, 3.0], inside=[-1.0, 0.5, 2.0])[:, 0] == pytest.approx([0.0, 1.0, 5.0])
    assert signal(1.0, derivative=1) == pytest.approx([2.0])
    assert signal(1.0, derivative=1, inside=0.5) == pytest.approx([0.0])
    assert signal.jumps(0)[:, 0] == pytest.approx([1 / 9, 0.0, 4 / 9], rel=1e-9)


def test_a_scalar_time_gives_one_row() -> None:
    assert raised_cosine(2.0)(np.pi) == pytest.approx([2.0])
    assert raised_cosine(2.0)([np.pi]).shape == (1, 1)


def test_smoothness_of_pieces_that_meet_to_second_order() -> None:
    """t^3 from 0 on: value, slope and curvature are continuous, the third derivative is not."""
    tail = Polynomial([0.0, 0.0, 0.0, 1.0])
    at_two = [tail.deriv(k)(2.0) / f for k, f in ((0, 1), (1, 1), (2, 2), (3, 6))]
    signal = piecewise_polynomial([0.0, 2.0, 3.0], [tail.coef, at_two], held=(0.0, 27.0))
    assert signal.jumps(1)[1, 0] < 1e-12  # t = 2 is no real breakpoint
    assert signal.jumps(2)[0, 0] < 1e-12
    assert signal.smoothness(0, 5) == 1  # at t = 3 the slope stops
    assert (signal + signal.scaled(-1.0)).smoothness(0, 5) == 5


PIECE = np.zeros(2, dtype=np.intp)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (
            lambda: PiecewiseSignal(np.array([1.0, 1.0]), (constant_generator(1),), np.zeros(3, dtype=np.intp), np.zeros((3, 1))),
            "increase",
        ),
        (lambda: PiecewiseSignal(np.array([np.nan]), (constant_generator(1),), PIECE, np.zeros((2, 1))), "finite"),
        (lambda: PiecewiseSignal(np.zeros(0), (constant_generator(1),), PIECE[:1], np.zeros((1, 1))), "breakpoints"),
        (
            lambda: PiecewiseSignal(np.zeros(1), (constant_generator(1),), PIECE, np.zeros((3, 1))),
            "expected 2 pieces, got 2 kinds and 3",
        ),
        (lambda: PiecewiseSignal(np.zeros(1), (constant_generator(1),), PIECE, np.full((2, 1), np.nan)), "not finite"),
        (lambda: raised_cosine(2.0) + constant([1.0, 2.0]), "cannot add signals of 1 and 2 channels"),
        (lambda: raised_cosine(2.0).refined([np.inf]), "finite"),
    ],
)
def test_bad_input_is_refused(build: Callable[[], object], message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        build()


def test_signals_that_never_rest_run_on_both_ways() -> None:
    """A sinusoid for all time, by its generator: the same formula before the breakpoint and after it."""
    generator = Generator(np.array([[0.0, 1.0], [-1.0, 0.0]]), np.array([[1.0, 0.0]]))
    signal = PiecewiseSignal(np.zeros(1), (generator,), PIECE, np.tile([0.0, 1.0], (2, 1)))
    assert signal(TIMES)[:, 0] == pytest.approx(np.sin(TIMES), abs=1e-13)
    assert signal(TIMES, derivative=3)[:, 0] == pytest.approx(-np.cos(TIMES), abs=1e-13)


def test_rest_to_rest_halves_join_smoothly() -> None:
    there_and_back = rest_to_rest(0.0, 1.0, 2.0, smoothness=3) + rest_to_rest(0.0, -1.0, 2.0, smoothness=3, start_time=2.0)
    assert there_and_back.smoothness(0, 8) == 4
    assert there_and_back([-1.0, 0.0, 2.0, 4.0, 9.0])[:, 0] == pytest.approx([0, 0, 1, 0, 0], abs=1e-14)


def test_both_sides_of_every_breakpoint() -> None:
    """A ramp, a sinusoid and a constant, that meet with jumps of the value and of the slope, against their closed forms."""
    ramp, turn = (
        Generator(np.eye(2, k=1), np.array([[1.0, 0.0]])),
        Generator(np.array([[0.0, 3.0], [-3.0, 0.0]]), np.array([[1.0, 0.0]])),
    )
    anchors = np.array([[2.0, 0.0], [1.0, 0.5], [0.0, 1.0], [4.0, 0.0]])
    signal = PiecewiseSignal(np.array([0.0, 2.0, 2.5]), (ramp, turn), np.array([0, 0, 1, 0]), anchors)
    left, right = signal.sides(0)
    assert left[:, 0] == pytest.approx([2.0, 2.0, np.sin(1.5)])
    assert right[:, 0] == pytest.approx([1.0, 0.0, 4.0])
    left, right = signal.sides(1)
    assert left[:, 0] == pytest.approx([0.0, 0.5, 3 * np.cos(1.5)])
    assert right[:, 0] == pytest.approx([0.5, 3.0, 0.0])
