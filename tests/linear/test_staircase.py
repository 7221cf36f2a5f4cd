"""The staircase form against subspaces that are known by construction."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.linear.staircase import unreached
from tests.linear.random_plants import Array, rotation

NOTHING = 1e-10
"""Size below which a coupling counts as none."""


def assert_spans(basis: Array, expected: Array) -> None:
    """Both are orthonormal bases of one subspace."""
    assert basis.shape == expected.shape
    assert basis.T @ basis == pytest.approx(np.eye(basis.shape[1]), abs=1e-12)
    assert basis @ basis.T == pytest.approx(expected @ expected.T, abs=1e-9)


def out_of_reach(rng: np.random.Generator, reached: int, hidden: int, inputs: int) -> tuple[Array, Array]:
    """A and B of which the last states are moved by no input, the first ones are."""
    n = reached + hidden
    A, B = rng.normal(size=(n, n)), rng.normal(size=(n, inputs))
    A[reached:, :reached], B[reached:] = 0.0, 0.0
    return A, B


@pytest.mark.parametrize(
    ("reached", "hidden", "inputs"), [(1, 1, 1), (7, 3, 1), (7, 3, 2), (2, 5, 4), (40, 20, 3), (5, 0, 2), (0, 4, 2)]
)
def test_what_no_input_moves_is_found_in_turned_states(reached: int, hidden: int, inputs: int) -> None:
    rng = np.random.default_rng(reached + 10 * hidden + 100 * inputs)
    A, B = out_of_reach(rng, reached, hidden, inputs)
    Q = rotation(rng, reached + hidden)
    assert_spans(unreached([Q @ A @ Q.T / NOTHING], Q @ B / NOTHING), Q[:, reached:])


def test_dependent_inputs_add_nothing() -> None:
    rng = np.random.default_rng(2)
    A, B = out_of_reach(rng, 6, 2, 1)
    assert_spans(unreached([A / NOTHING], B @ [[1.0, -2.0, 0.5]] / NOTHING), np.eye(8)[:, 6:])


def test_a_chain_of_integrators_is_reached_link_by_link() -> None:
    """The last 10 of 60 integrators are cut off: each step of the others adds one state."""
    A = np.diag(np.ones(59), k=-1)
    A[50, 49] = 0.0
    assert_spans(unreached([A / NOTHING], np.eye(60)[:, :1] / NOTHING), np.eye(60)[:, 50:])


def test_of_several_systems_what_none_of_them_reaches_is_left() -> None:
    """The first leads from state 1 to 2, the second from 2 to 3: together they reach 3, each alone does not; 4 is left."""
    first, second, B = np.zeros((4, 4)), np.zeros((4, 4)), np.eye(4)[:, :1]
    first[1, 0], second[2, 1] = 1.0, 1.0
    first[0, 3], second[3, 3] = 1.0, -1.0
    one = np.eye(4)
    assert_spans(unreached([first / NOTHING], B / NOTHING), one[:, 2:])
    assert_spans(unreached([second / NOTHING], B / NOTHING), one[:, 1:])
    assert_spans(unreached([first / NOTHING, second / NOTHING], B / NOTHING), one[:, 3:])
