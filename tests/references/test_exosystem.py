"""Exosystems: what they generate, where they start and stop, and how several become one."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from invtrack.errors import TrajectoryError
from invtrack.references.exosystem import (
    Exosystem,
    exosystem,
    polynomial_exosystem,
    sinusoidal_exosystem,
    stack_exosystems,
    step_exosystem,
    sum_exosystems,
)
from invtrack.references.profiles import raised_cosine

PAPER_A = [[0, 1, 0, 0], [-1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]]  # Devasia, Paden, Rossi 1996, section 5
PAPER_C = [[0, 0, 0, 1]]


def test_the_paper_s_exosystem_gives_one_minus_cosine_and_nothing_outside() -> None:
    reference = exosystem(PAPER_A, PAPER_C, start=0.0, end=2 * np.pi).reference([0, 1, 0, 0])
    t = np.linspace(-5.0, 12.0, 300)
    for derivative in range(3):
        assert reference(t, derivative=derivative) == pytest.approx(raised_cosine(2.0)(t, derivative=derivative), abs=1e-13)


def test_a_held_output_keeps_its_value_outside() -> None:
    reference = exosystem([[0, 1], [0, 0]], [1, 0], start=1.0, end=3.0, outside="held").reference([2.0, 0.5], at=2.0)
    assert reference([-4.0, 1.0, 2.0, 3.0, 30.0])[:, 0] == pytest.approx([1.5, 1.5, 2.0, 2.5, 2.5])


@pytest.mark.parametrize("at", [-2.0, 0.0, 0.7, 1.0, 2.5, 9.0])
def test_states_solve_the_switched_equation_whatever_the_time_at_which_they_are_given(at: float) -> None:
    rng = np.random.default_rng(3)
    matrices = [rng.normal(size=(3, 3)) / 2 for _ in range(4)]
    switched = Exosystem(matrices, [np.eye(3)[:1]] * 4, [0.0, 1.0, 2.5])
    x_e = rng.normal(size=3)
    for end in (-1.0, 0.4, 3.0):
        edges = sorted({at, end, *(t for t in (0.0, 1.0, 2.5) if min(at, end) < t < max(at, end))}, reverse=end < at)
        x = x_e
        for a, b in itertools.pairwise(edges):
            A = matrices[int(np.searchsorted([0.0, 1.0, 2.5], (a + b) / 2))]
            x = solve_ivp(lambda t, x, A=A: A @ x, (a, b), x, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        assert switched.states(x_e, at, end) == pytest.approx(x, abs=1e-9)
        assert switched.transition(at, end) @ x_e == pytest.approx(x, abs=1e-9)
        assert switched.reference(x_e, at=at)(end) == pytest.approx(x[:1], abs=1e-9)


def test_one_that_runs_for_ever_has_no_switch_times() -> None:
    endless = sinusoidal_exosystem([2.0], bias=True)
    assert len(endless) == 1
    assert endless.names == ("bias", "cos 2", "sin 2")
    t = np.linspace(-30, 30, 50)
    expected = 0.5 + 3.0 * np.cos(2 * (t - 1.0))
    assert endless.reference([0.5, 3.0, 0.0], at=1.0)(t)[:, 0] == pytest.approx(expected, abs=1e-12)


def test_polynomials_and_steps() -> None:
    t = np.array([0.5, 1.0, 3.0])
    cubic = polynomial_exosystem(3, start=0.0)
    assert cubic.reference([1.0, -2.0, 6.0, 12.0])(t)[:, 0] == pytest.approx(1 - 2 * t + 3 * t**2 + 2 * t**3)
    assert cubic.reference([1.0, -2.0, 6.0, 12.0])(-1.0) == pytest.approx([0.0])
    assert step_exosystem(start=0.0, end=2.0).reference([7.0])([-0.1, 0.0, 1.9, 2.0])[:, 0] == pytest.approx([0, 7, 7, 0])


def test_sums_and_stacks_switch_where_any_part_does() -> None:
    parts = [step_exosystem(start=0.0, end=2.0), sinusoidal_exosystem([1.0], bias=False, start=1.0)]
    total, both = sum_exosystems(parts), stack_exosystems(parts)
    assert total.switch_times == pytest.approx([0.0, 1.0, 2.0])
    x_e, t = [2.0, 0.0, 1.0], np.array([-1.0, 0.5, 1.5, 4.0])
    expected = np.array([np.where((t >= 0) & (t < 2), 2.0, 0.0), np.where(t >= 1, np.sin(t - 1), 0.0)])
    stacked, added = both.reference(x_e, at=1.0)(t).T, total.reference(x_e, at=1.0)(t)
    assert stacked == pytest.approx(expected, abs=1e-14)
    assert added[:, 0] == pytest.approx(expected.sum(axis=0), abs=1e-14)
    assert sum_exosystems([step_exosystem(), step_exosystem()]).names == ("1: value", "2: value")


def test_coordinates_and_shifts_leave_the_output_alone() -> None:
    paper = exosystem(PAPER_A, PAPER_C, start=0.0, end=2 * np.pi)
    T = np.random.default_rng(0).normal(size=(4, 4))
    x_e, t = np.array([0.3, 1.0, -0.2, 0.1]), np.linspace(-1, 8, 40)
    wanted = paper.reference(x_e)(t)
    assert paper.transformed(T).reference(T @ x_e)(t) == pytest.approx(wanted, abs=1e-12)
    assert paper.shifted(2.5).reference(x_e)(t + 2.5) == pytest.approx(wanted, abs=1e-12)


def test_what_is_handed_in_is_copied() -> None:
    A = np.zeros((1, 1))
    constant = exosystem(A, [1.0])
    A[0, 0] = 5.0
    assert constant.A[0][0, 0] == pytest.approx(0.0)
    with pytest.raises(ValueError, match="read-only"):
        constant.A[0][0, 0] = 1.0


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: exosystem([[0, 1]], [1, 0]), r"has A_e \(1, 2\) and C_e \(1, 2\), expected \(1, 1\)"),
        (lambda: exosystem([[0.0]], [[1.0, 0.0]]), r"C_e \(1, 2\), expected \(1, 1\) and \(1, 1\)"),
        (lambda: exosystem([[np.nan]], [1.0]), "A_e must be a matrix of finite real numbers"),
        (lambda: exosystem([["a"]], [1.0]), "A_e must be real numbers, got"),
        (lambda: exosystem([[0.0]], [1.0], start=1.0, end=1.0), "end must be after start, got start 1.0 and end 1.0"),
        (lambda: exosystem([[0.0]], [1.0], start=1.0, outside="ring"), "outside must be one of 'zero', 'held', got 'ring'"),  # type: ignore[arg-type]
        (lambda: exosystem([[0.0]], [1.0], names=["a", "b"]), r"expected 1 distinct names .* got \['a', 'b'\]"),
        (lambda: Exosystem([[[0.0]]], [[[1.0]]], [2.0]), "2 of each for 1 switch times; got 1 and 1"),
        (lambda: Exosystem([[[0.0]]] * 3, [[[1.0]]] * 3, [2.0, 1.0]), r"finite and increase, got \[2.0, 1.0\]"),
        (lambda: exosystem([[0.0]], [1.0]).reference([1.0, 2.0]), r"must be finite, one number for each of \['x_e1'\]"),
        (lambda: exosystem([[0.0]], [1.0]).reference([1.0], at=np.inf), "state is given must be a finite number .*, got inf"),
        (lambda: step_exosystem(start=0.0).resampled([1.0]), r"switch times \[0.0\] of the exosystem are not among the new ones"),
        (lambda: step_exosystem().transformed([[0.0]]), r"T must be a nonsingular \(1, 1\) matrix"),
        (lambda: sinusoidal_exosystem([1.0, -2.0]), r"frequencies must be positive and distinct \[rad/s\], got \[1.0, -2.0\]"),
        (lambda: sinusoidal_exosystem([], bias=False), "expected at least one frequency, or a bias"),
        (lambda: polynomial_exosystem(-1), "degree must be a whole number from 0 to 100, got -1"),
        (
            lambda: sum_exosystems([step_exosystem(), stack_exosystems([step_exosystem(), step_exosystem()])]),
            r"cannot add exosystems with \[1, 2\] outputs",
        ),
        (lambda: stack_exosystems([]), "expected at least one exosystem and nothing else, got none"),
        (lambda: sum_exosystems([step_exosystem(), 2.0]), r"nothing else, got \['float'\]"),  # type: ignore[list-item]
        (lambda: polynomial_exosystem("2"), "degree must be a whole number from 0 to 100, got '2'"),  # type: ignore[arg-type]
        (lambda: sinusoidal_exosystem(["fast"]), r"frequencies must be real numbers, got \['fast'\]"),
        (lambda: step_exosystem(start="now"), "start must be real numbers"),  # type: ignore[arg-type]
        (lambda: step_exosystem().reference("x"), "the exosystem's state must be real numbers, got 'x'"),
        (lambda: step_exosystem().transition(0.0, np.nan), r"its end must be a finite number \[s\], got nan"),
    ],
)
def test_bad_input_says_what_was_expected(build: object, message: str) -> None:
    with pytest.raises(TrajectoryError, match=message):
        build()  # type: ignore[operator]


def test_weighted_states_give_the_same_output() -> None:
    """A state that nothing shows, and that would run away, stands still; matrices that recur stay one."""
    plain = exosystem([[0.0, 2.0, 0.0], [0.0, -0.3, 0.0], [5.0, 1.0, 0.7]], [[1.0, 0.5, 0.0]], start=0.0, end=3.0)
    w, x_e, t = np.array([8.0, 0.25, 0.0]), np.array([0.3, -1.2, 0.8]), np.linspace(-1.0, 4.0, 51)
    weighted = plain.weighted(w)
    assert weighted.reference([*(w * x_e)[:2], 0.8])(t) == pytest.approx(plain.reference(x_e)(t), rel=1e-12)
    assert weighted.states([*(w * x_e)[:2], 0.8], 0.0, t)[:, 2] == pytest.approx(np.full(51, 0.8))
    assert len({id(A_e) for A_e in weighted.A}) == 2
