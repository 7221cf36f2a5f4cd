"""States that no input moves stay zero: what rounding leaves in them is measured against what they act on."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.inversion import feasibility
from invtrack.linear.state_sizes import idle_states, with_idle_sizes

SLEW = invtrack.rest_to_rest(0.0, 0.3, duration=1.0, smoothness=4)

# x, v, an idle lag that pushes it, and an integrator of the input.
IDLE_LAG = invtrack.StateSpace([[0.0, 1, 0, 0], [0, -0.2, 1, 1], [0, 0, -1, 0], [0, 0, 0, 0]], np.eye(4)[:, 3:], np.eye(4)[:1])
WITHOUT = invtrack.StateSpace([[0.0, 1, 0], [0, -0.2, 1], [0, 0, 0]], np.eye(3)[:, 2:], np.eye(3)[:1])


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e9])
def test_a_plan_is_that_of_the_plant_without_them(unit: float) -> None:
    T = np.diag([1.0, 1.0, unit, 1.0])
    plan, plain = invtrack.invert(IDLE_LAG.transformed(T), SLEW), invtrack.invert(WITHOUT, SLEW)
    t = np.linspace(-0.5, 1.5, 401)
    assert plan(t).x[:, [0, 1, 3]] == pytest.approx(plain(t).x, abs=1e-9 * np.max(np.abs(plain(t).x)))
    assert plan(t).u == pytest.approx(plain(t).u, abs=1e-9 * np.max(np.abs(plain(t).u)))
    assert feasibility(IDLE_LAG, SLEW).solvable


def test_one_that_shows_in_the_output_alone() -> None:
    """x1' = x1 + u, x2' = -x2, y = x1 + x2: x2 = 0 and u = y_d' - y_d."""
    plan = invtrack.invert(invtrack.StateSpace(np.diag([1.0, -1.0]), [[1.0], [0.0]], [[1.0, 1.0]]), SLEW)
    t = np.linspace(0.0, 1.0, 101)
    assert plan(t).x[:, 1] == pytest.approx(np.zeros(101), abs=1e-12)
    assert plan(t).u == pytest.approx(SLEW(t, derivative=1) - SLEW(t), abs=1e-10)


def test_an_idle_state_that_moves_all_the_same_is_seen() -> None:
    """The plan of another plant, in which an input moves the lag, is none of this one."""
    moved = invtrack.StateSpace(IDLE_LAG.A, [[0.0], [0.0], [1.0], [1.0]], IDLE_LAG.C)
    plan = invtrack.invert(moved, SLEW)
    certificate = invtrack.plans.certify(invtrack.SwitchedSystem([IDLE_LAG]), plan.trajectory, SLEW, (plan.start, plan.end))
    assert certificate.dynamics_residual > 1e-3


def test_which_states_are_idle_and_how_large_they_count() -> None:
    A = np.zeros((5, 5))
    A[0, 1], A[1, 2], A[2, 3], A[3, 2] = 1.0, 10.0, 4.0, 4.0  # 3 <-> 2 -> 1 -> 0, and 4 by itself
    plant = invtrack.SwitchedSystem([invtrack.StateSpace(A, np.eye(5)[:, 1:2], np.eye(5)[:1])])
    assert idle_states(plant).tolist() == [False, False, True, True, True]
    size = with_idle_sizes(np.array([2.0, 3.0, 1e-17, 1e-17, 1e-17]), np.array([3.0, 50.0, 0.0, 0.0, 0.0]), plant)
    assert size[:4] == pytest.approx([2.0, 3.0, 1e-3 * 50 / 10, 1e-3 * 50 / 10], rel=1e-9)
    assert np.isinf(size[4])
