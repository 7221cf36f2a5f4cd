"""Zeros far beyond the plant's own modes, where its inputs set the outputs weakly: the slow part of the inverse stays as it is."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.arrays import Array
from invtrack.inversion.exact import invert
from invtrack.linear import zeros
from invtrack.linear.internal_dynamics import internal_dynamics
from invtrack.linear.state_space import StateSpace
from invtrack.plans.plan import Plan
from invtrack.references.profiles import rest_to_rest
from tests.random_draws.plants import Matrices, Units
from tests.random_draws.shooting import contradiction

DAMPING, DRAG = 1e-4, 5e-3
"""Of the springs [s], as a share of their stiffness, and of each mass [1/s]."""


def row_of_masses(masses: int, pushed: int) -> tuple[Array, Array, StateSpace]:
    """Stiffness (n, n), force (n,) and plant of unit masses in a row between unit springs, one end held; seen is the second mass
    beyond the one that is pushed. Two lightly damped springs lie between: a double zero at -1e4 rad/s, gain 1e-8."""
    stretch, unit, none = np.eye(masses) - np.eye(masses, k=-1), np.eye(masses), np.zeros((masses, masses))
    K = stretch.T @ stretch
    A = np.block([[none, unit], [-K, -DAMPING * K - DRAG * unit]])
    B, C = np.concatenate([np.zeros(masses), unit[pushed]]), np.concatenate([unit[pushed + 2], np.zeros(masses)])
    return K, unit[pushed], StateSpace(A, B[:, None], C[None, :])


def planned(plant: StateSpace) -> Plan:
    return invert(plant, rest_to_rest(0.0, 1.0, 3.0, smoothness=4))


@pytest.mark.parametrize(("masses", "pushed"), [(12, 4), (20, 6)])
def test_where_it_comes_to_rest_is_what_statics_say(masses: int, pushed: int) -> None:
    """K q = f, the output at 1, nothing moving: solved from the stiffness alone."""
    K, force, plant = row_of_masses(masses, pushed)
    plan = planned(plant)
    rest = np.linalg.solve(K, force)
    reached = plan(np.array([2 * plan.end])).x[0]
    expected = np.concatenate([rest / rest[pushed + 2], np.zeros(masses)])
    assert reached == pytest.approx(expected, abs=1e-9 * np.max(expected))
    assert plan(np.array([2 * plan.end])).u[0] == pytest.approx(1 / rest[pushed + 2], rel=1e-10)


def test_slow_zeros_do_not_depend_on_the_fast_ones() -> None:
    """The masses before the one that is pushed swing as if that one were held, and those beyond the one seen likewise."""
    masses, pushed = 20, 6
    K, _, plant = row_of_masses(masses, pushed)
    expected = []
    for part in (slice(0, pushed), slice(pushed + 3, masses)):
        for stiffness in np.linalg.eigvalsh(K[part, part]):
            expected += np.roots([1.0, DAMPING * stiffness + DRAG, stiffness]).tolist()
    internal = internal_dynamics(plant)
    assert internal.pencil is not None
    parts = internal.pencil.parts(lambda zero: abs(zero) < 10).parts
    found = np.linalg.eigvals(parts.A_1)
    assert len(found) == len(expected) == len(zeros(plant)) - 2
    for zero in expected:
        assert np.min(np.abs(found - zero)) < 1e-11


def test_a_plant_as_fast_as_its_inverse_needs_no_pencil() -> None:
    plant = StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[1.0, -1.0]])
    assert internal_dynamics(plant).pencil is None


@pytest.mark.parametrize("size", [1e-6, 1e-9])
@pytest.mark.parametrize("rank", [1, 2])
def test_a_feedthrough_that_hardly_counts(size: float, rank: int) -> None:
    """Zeros as fast as the feedthrough is small, beside those of the plant without it."""
    rng = np.random.default_rng(1)
    A, B, C = rng.normal(size=(5, 5)) - 2 * np.eye(5), rng.normal(size=(5, 2)), rng.normal(size=(2, 5))
    D = size * np.array([[1.0, 0.3], [0.2, 1.0]])
    D[rank:] = 0.0
    plant = StateSpace(A, B, C, D)
    plan = invert(plant, rest_to_rest([0.0, 0.0], [1.0, -0.5], 3.0, smoothness=4))
    found = contradiction(plan, [Matrices(A, B, C, D)], np.zeros(0), Units(np.ones(5), np.ones(2), np.ones(2)), zeros=zeros(plant))
    assert found.worst < 1e-9
    slow = zeros(plant)[np.abs(zeros(plant)) < 1e3]
    assert np.sort(slow.real) == pytest.approx(np.sort(zeros(StateSpace(A, B, C)).real), abs=1e3 * size)


@pytest.mark.parametrize("fast", [1e4, 1e6, 1e9, -1e9])
def test_the_input_is_as_accurate_as_the_motion(fast: float) -> None:
    """q'' = u - q - q', y = q - q' / fast: q = y + y' / fast + y'' / fast^2 + ..., and u from that; the first terms are enough."""
    plan = invert(
        StateSpace([[0.0, 1.0], [-1.0, -1.0]], [[0.0], [1.0]], [[1.0, -1.0 / fast]]), rest_to_rest(0.0, 1.0, 3.0, smoothness=6)
    )
    t = np.linspace(0.2, 2.8, 27)
    y = [plan.reference(t, derivative=k)[:, 0] for k in range(7)]
    q = [sum(y[k + j] / fast**k for k in range(5)) for j in range(3)]
    assert plan(t).u[:, 0] == pytest.approx(q[2] + q[1] + q[0], abs=1e-11)
