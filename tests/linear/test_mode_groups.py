"""Modes that no input moves or no output shows: which, how often, and of which states."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.linear.mode_groups import listed, unmoved_modes, unseen_modes
from invtrack.linear.state_space import StateSpace


def chain(count: int, pushed: int, seen: int) -> StateSpace:
    """Equal masses in a row, free at both ends, between equal springs and dampers: positions q1 ..., speeds v1 ..."""
    links = np.diff(np.eye(count), axis=0)
    K, none, one = links.T @ links, np.zeros((count, count)), np.eye(2 * count)
    A = np.block([[none, np.eye(count)], [-K, -0.02 * K]])
    names = [f"{letter}{i}" for letter in "qv" for i in range(1, count + 1)]
    return StateSpace(A, one[:, [count + pushed]], one[[seen]], states=names)


def test_two_carts_of_which_one_is_pushed() -> None:
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    carts = StateSpace(A, [[0], [1], [0], [0]], [[1, 0, 0, 0]], states=["near", "near speed", "far", "far speed"])
    for find in (unmoved_modes, unseen_modes):
        (group,) = find(carts)
        assert (group.values, group.side) == ((0, 0), 0)
        assert set(group.states) == {"far", "far speed"}
    assert listed(unmoved_modes(carts)) == "the modes 0, 0 (of far, far speed)"


@pytest.mark.parametrize("seed", range(6))
def test_the_middle_of_a_row_does_not_move_what_is_antisymmetric(seed: int) -> None:
    """Three masses: s^2 + 0.02 s + 1 = 0, of the outer two, whatever the units of states and time."""
    rng = np.random.default_rng(seed)
    plain = chain(3, pushed=1, seen=1)
    units, time = 10.0 ** rng.integers(-6, 7, size=6), 10.0 ** rng.integers(-4, 5)
    system = StateSpace(
        time * plain.A * units / units[:, None], time * plain.B / units[:, None], plain.C * units, states=plain.states
    )
    for find in (unmoved_modes, unseen_modes):
        (group,) = find(system)
        expected = -0.01 + 1j * np.sqrt(1.0 - 1e-4)
        np.testing.assert_allclose(np.array(group.values) / time, [expected, expected.conjugate()], rtol=1e-9)
        assert set(group.states) == {"q1", "q3", "v1", "v3"}
        assert group.side == -1


def test_what_drives_others_is_left_to_itself_and_what_is_driven_is_not_shown() -> None:
    """A disturbance d acts on a pushed mass: only d is not moved, though the mass moves with it. A sum c drives nothing."""
    A = np.array([[-0.5, 0.0, 0.0], [1.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    system = StateSpace(A, [[0.0], [1.0], [0.0]], [[0.0, 1.0, 0.0]], states=["d", "v", "c"])
    assert [(group.values, group.states, group.side) for group in unmoved_modes(system)] == [((-0.5,), ("d",), -1)]
    assert [(group.values, group.states, group.side) for group in unseen_modes(system)] == [((0,), ("c",), 0)]


def test_equal_modes_of_different_states_stand_together_and_others_apart() -> None:
    system = StateSpace(np.diag([3.0, -1.0, 3.0, -2.0]), [[0.0], [0.0], [0.0], [1.0]], np.ones((1, 4)))
    first, second = unmoved_modes(system)
    assert (first.values, set(first.states), first.side) == ((3.0, 3.0), {"x1", "x3"}, 1)
    assert (second.values, second.states, second.side) == ((-1.0,), ("x2",), -1)


def test_a_long_list_of_states_is_cut() -> None:
    system = StateSpace(np.full((12, 12), 0.5), np.zeros((12, 1)), np.ones((1, 12)))
    assert any("and 6 more" in str(group) for group in unmoved_modes(system))


def test_a_plant_without_such_modes() -> None:
    assert unmoved_modes(chain(4, pushed=0, seen=0)) == unseen_modes(chain(4, pushed=0, seen=0)) == ()
