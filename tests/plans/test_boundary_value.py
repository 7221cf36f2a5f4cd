"""Ordered elimination against a dense solution of the whole system."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.plans.boundary_value import Conditions, solve

Problem = tuple[Conditions, list[Conditions], Conditions]
laws = settings(deadline=None, max_examples=60, derandomize=True)
SIZES = st.lists(st.integers(0, 4), min_size=1, max_size=6)
SEEDS = st.integers(0, 10**6)


def random_problem(rng: np.random.Generator, sizes: list[int], rows: list[int]) -> Problem:
    """rows: of the first end, of each junction, of the last end."""
    none = np.zeros((0, 0))
    first = Conditions(rng.normal(size=(rows[0], sizes[0])), none, rng.normal(size=rows[0]))
    junctions = [
        Conditions(rng.normal(size=(m, left)), rng.normal(size=(m, right)), rng.normal(size=m))
        for m, left, right in zip(rows[1:-1], sizes[:-1], sizes[1:], strict=True)
    ]
    last = Conditions(rng.normal(size=(rows[-1], sizes[-1])), none, rng.normal(size=rows[-1]))
    return first, junctions, last


def dense(problem: Problem, sizes: list[int]) -> tuple[np.ndarray, np.ndarray]:
    first, junctions, last = problem
    columns = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    blocks = [(first.left, 0), *((j.left, k) for k, j in enumerate(junctions)), (last.left, len(sizes) - 1)]
    matrix = np.zeros((sum(len(left) for left, _ in blocks), columns[-1]))
    row = 0
    for i, (left, k) in enumerate(blocks):
        here = slice(row, row + len(left))
        matrix[here, columns[k] : columns[k + 1]] = left
        if 0 < i <= len(junctions):
            matrix[here, columns[k + 1] : columns[k + 2]] = junctions[i - 1].right
        row += len(left)
    return matrix, np.concatenate([first.rhs, *(j.rhs for j in junctions), last.rhs])


def spread(rng: np.random.Generator, sizes: list[int], total: int) -> list[int]:
    """How many conditions each place gets: unknowns up to each junction are never fewer than conditions without it."""
    split = [int(rng.integers(0, size + 1)) for size in sizes]  # of each block: known from its left, the rest from its right
    rows = [split[0], *(size - s + t for size, s, t in zip(sizes[:-1], split[:-1], split[1:], strict=True)), sizes[-1] - split[-1]]
    for _ in range(sum(sizes) - total):
        places = [i for i, m in enumerate(rows) if m > 0]
        rows[int(rng.choice(places))] -= 1
    return rows


@laws
@given(SIZES, SEEDS)
def test_as_many_conditions_as_unknowns(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    problem = random_problem(rng, sizes, spread(rng, sizes, sum(sizes)))
    matrix, rhs = dense(problem, sizes)
    found = solve(*problem)
    assert [len(v) for v in found.values] == sizes
    if matrix.size and np.linalg.cond(matrix) < 1e6:
        assert found.freedom == 0
        assert np.concatenate(found.values) == pytest.approx(np.linalg.solve(matrix, rhs), rel=1e-6, abs=1e-7)
        assert np.max(found.inconsistency, initial=0.0) < 1e-9


@laws
@given(st.lists(st.integers(1, 4), min_size=1, max_size=6), SEEDS, st.integers(1, 3))
def test_fewer_conditions_leave_the_solution_of_least_norm(sizes: list[int], seed: int, missing: int) -> None:
    rng = np.random.default_rng(seed)
    missing = min(missing, sum(sizes))
    problem = random_problem(rng, sizes, spread(rng, sizes, sum(sizes) - missing))
    matrix, rhs = dense(problem, sizes)
    found = solve(*problem)
    if len(matrix) and np.linalg.cond(matrix) < 1e6:
        assert found.freedom == missing
        expected = np.linalg.lstsq(matrix, rhs)[0]
        assert np.concatenate(found.values) == pytest.approx(expected, rel=1e-6, abs=1e-7)


@laws
@given(st.lists(st.integers(1, 4), min_size=1, max_size=5), SEEDS)
def test_too_many_conditions_show_as_inconsistent_unless_they_agree(sizes: list[int], seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = spread(rng, sizes, sum(sizes))
    rows[-1] += 2
    problem = random_problem(rng, sizes, rows)
    matrix, _ = dense(problem, sizes)
    if np.linalg.cond(matrix) > 1e6:
        return
    assert np.max(solve(*problem).inconsistency) > 1e-6
    first, junctions, last = problem
    truth = rng.normal(size=sum(sizes))
    v = np.split(truth, np.cumsum(sizes)[:-1])
    agreeing = (
        Conditions(first.left, first.right, first.left @ v[0]),
        [Conditions(j.left, j.right, j.left @ v[k] + j.right @ v[k + 1]) for k, j in enumerate(junctions)],
        Conditions(last.left, last.right, last.left @ v[-1]),
    )
    found = solve(*agreeing)
    assert np.concatenate(found.values) == pytest.approx(truth, rel=1e-6, abs=1e-7)
    assert np.max(found.inconsistency) < 1e-8


def test_a_decaying_and_a_growing_direction_over_many_intervals() -> None:
    """s_(k+1) = e^-50 s_k, g_k = e^-50 g_(k+1), one known at each end: a product of the 200 maps could not be formed."""
    E, none = np.exp(-50.0), np.zeros((0, 0))
    junction = Conditions(np.array([[E, 0.0], [0.0, 1.0]]), np.array([[-1.0, 0.0], [0.0, -E]]), np.zeros(2))
    found = solve(
        Conditions(np.eye(2)[:1], none, np.array([3.0])), [junction] * 200, Conditions(np.eye(2)[1:], none, np.array([7.0]))
    )
    assert found.values[0] == pytest.approx([3.0, 0.0], abs=1e-300)
    assert found.values[1] == pytest.approx([3.0 * E, 0.0], rel=1e-12, abs=1e-300)
    assert found.values[-1] == pytest.approx([0.0, 7.0], abs=1e-300)
    assert found.values[-2] == pytest.approx([0.0, 7.0 * E], rel=1e-12, abs=1e-300)
    assert found.freedom == 0
