"""Misses of held inputs beside jumps, spread over the middles and ends of holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import invtrack
from invtrack.arrays import Array
from invtrack.inversion.nonlinear.balance import SPARING, balanced
from invtrack.inversion.nonlinear.newton import converged
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.shooting import Motion, Shooting
from invtrack.inversion.nonlinear.solver import MotionSolver
from invtrack.plans.dynamics import mechanism
from tests.inversion.nonlinear.mechanisms import link

HOLD, ACCURACY, JUMP = 2e-3, 1e-8, 0.15


@pytest.fixture(scope="module")
def problem() -> MotionProblem:
    moving = mechanism(link())
    assert moving is not None
    return MotionProblem.of(moving, invtrack.rest_to_rest(0.0, 0.5, duration=0.3), [invtrack.Change(JUMP, payload=0.4)])


@pytest.fixture(scope="module")
def spread(problem: MotionProblem) -> tuple[Shooting, Motion]:
    """The conditions and the motion with misses spread."""
    solution = MotionSolver(problem, ACCURACY, (None, None), None).held(HOLD)
    return solution.shooting, solution.motion


def worst(problem: MotionProblem, shooting: Shooting, wanted: Array, near: Motion) -> float:
    """The largest miss in the middle and at the end of holds beside the jump, of the motion with these outputs where matched."""
    conditions = replace(shooting, wanted=wanted)
    motion, _ = converged(conditions, near, 1e-3 * ACCURACY)
    assert motion is not None
    mesh = shooting.mesh
    y = shooting.outputs(shooting.nodes(motion)[:, 1:], np.repeat(motion.coefficients, 2, axis=1))
    middles = (mesh.edges[:-1] + mesh.edges[1:]) / 2
    wished = problem.reference(np.column_stack([middles, mesh.edges[1:]]).ravel(), inside=np.repeat(middles, 2))
    misses = (y.reshape(wished.shape) - wished).reshape(len(mesh), -1) / shooting.motion_size
    return float(np.max(np.abs(misses[np.abs(middles - JUMP) < 20 * HOLD])))


def test_the_largest_miss_is_as_small_as_matched_points_can_make_it(
    problem: MotionProblem, spread: tuple[Shooting, Motion]
) -> None:
    shooting, motion = spread
    mesh = shooting.mesh
    exact = problem.reference((mesh.edges[:-1] + mesh.edges[1:]) / 2)[:, :, None]
    moved = np.flatnonzero(np.abs(shooting.wanted - exact)[:, 0, 0] > 0)
    found = worst(problem, shooting, shooting.wanted, motion)
    assert found < 0.7 * worst(problem, shooting, exact, motion)
    assert 0 < len(moved) < 15
    assert np.all(np.min(np.abs(mesh.edges[moved, None] - problem.stops), axis=1) < 8 * HOLD)
    draws = np.random.default_rng(3)
    around = np.flatnonzero(np.abs(mesh.edges[:-1] - JUMP) < 5 * HOLD)
    for _ in range(10):
        other = shooting.wanted.copy()
        change = 0.3 * found * draws.standard_normal(len(around))
        other[around, 0, 0] += change * shooting.motion_size[0]
        assert worst(problem, shooting, other, motion) > found - SPARING * np.sum(np.abs(change)) - ACCURACY * found


def test_small_misses_stay_as_they_are(problem: MotionProblem, spread: tuple[Shooting, Motion]) -> None:
    shooting, motion = spread
    assert balanced(shooting, motion, problem.reference, problem.stops, accuracy=1e-3) is None
    assert balanced(shooting, motion, problem.reference, np.zeros(0), ACCURACY) is None


def test_a_smooth_motion_meets_its_outputs_once_in_each_hold() -> None:
    moving = mechanism(link())
    assert moving is not None
    problem = MotionProblem.of(moving, invtrack.rest_to_rest(0.0, 0.5, duration=0.3, smoothness=6), ())
    solution = MotionSolver(problem, 1e-6, (None, None), None).held(HOLD)
    mesh = solution.shooting.mesh
    wished = problem.reference((mesh.edges[:-1] + mesh.edges[1:]) / 2)
    np.testing.assert_allclose(solution.shooting.wanted[:, :, 0], wished, rtol=0, atol=1e-15)
