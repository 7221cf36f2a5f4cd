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
    # The force is the difference of terms 1e8 times as large: the stiffness over the damping, squared.
    assert plan(np.array([2 * plan.end])).u[0] == pytest.approx(1 / rest[pushed + 2], rel=1e8 * 30 * np.finfo(float).eps)


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
    parts, _, _ = internal.pencil.parts(lambda zero: abs(zero) < 10)
    found = np.linalg.eigvals(parts.A_1)
    assert len(found) == len(expected) == len(zeros(plant)) - 2
    for zero in expected:
        assert np.min(np.abs(found - zero)) < 1e-11


def test_a_plant_as_fast_as_its_inverse_needs_no_pencil() -> None:
    plant = StateSpace([[0.0, 1.0], [-2.0, -3.0]], [[0.0], [1.0]], [[1.0, -1.0]])
    assert internal_dynamics(plant).pencil is None
