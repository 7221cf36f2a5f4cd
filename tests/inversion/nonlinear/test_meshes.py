"""Meshes that grow outward and change while Newton's method converges, and what is carried from one to the next."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import invtrack
from invtrack.inversion.nonlinear.choice import LEAST_GAP
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.newton import Iteration, converged, remaining
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.refinement import wanted_at
from invtrack.inversion.nonlinear.solver import LEFT, MotionSolver, Solution
from invtrack.inversion.nonlinear.tails import known, tail_errors
from invtrack.plans.dynamics import mechanism
from tests.inversion.nonlinear.mechanisms import cart_pole, link

ACCURACY = 1e-8


def solved(plant: invtrack.Plant, reference: invtrack.PiecewiseSignal) -> tuple[MotionProblem, Solution]:
    moving = mechanism(plant)
    assert moving is not None
    problem = MotionProblem.of(moving, reference, ())
    return problem, MotionSolver(problem, ACCURACY, (None, None), None).refined()


@pytest.fixture(scope="module")
def cart() -> tuple[MotionProblem, Solution]:
    return solved(cart_pole(), invtrack.rest_to_rest(0.0, 10.0, duration=2.0))


@pytest.fixture(scope="module")
def rod() -> tuple[MotionProblem, Solution]:
    return solved(link(), invtrack.rest_to_rest(0.0, np.pi / 2, duration=1.0))


@pytest.mark.parametrize("make", ["cart", "rod"])
def test_no_more_than_allowed_is_left_to_find(make: str, request: pytest.FixtureRequest) -> None:
    """By further steps from where Newton's method stopped on an estimate."""
    _, solution = request.getfixturevalue(make)
    assert remaining(solution.log) <= LEFT * ACCURACY
    _, log = converged(solution.shooting, solution.motion, 0.0)
    assert log[0].step <= LEFT * ACCURACY


def test_what_is_left_is_judged_by_quadratic_convergence() -> None:
    def step(size: float, mesh: int) -> Iteration:
        return Iteration(1.0, 0.0, 0.0, size, mesh, 10, 4)

    first = [step(1.0, 1)]
    assert remaining(first) == 1.0
    two = [*first, step(0.1, 1)]
    assert remaining(two) == pytest.approx(0.1 * 0.1**2)
    assert remaining([*two, step(1e-2, 2)]) == pytest.approx(0.1 * 1e-2**2)  # by the motion, though on another mesh
    assert remaining([*two, step(1e-6, 2)]) == pytest.approx(1e-10)  # derivatives are not exact


def test_elements_grow_outward_and_resolve_what_lives_there(cart: tuple[MotionProblem, Solution]) -> None:
    problem, solution = cart
    mesh, (begin, end) = solution.shooting.mesh, problem.manoeuvre
    before, after = mesh.lengths[mesh.edges[1:] <= begin][::-1], mesh.lengths[mesh.edges[:-1] >= end]
    (decaying, growing) = np.sort(problem.zeros[0].real)[[0, -1]]
    for lengths, fastest in ((before, growing), (after, -decaying)):
        assert len(lengths) >= 12
        assert np.max(lengths) > 2 * lengths[0]
        assert np.max(lengths) * fastest <= 0.5 * (1 + 1e-9)
        assert np.max(lengths[1:] / lengths[:-1]) <= 2 * 1.4 * (1 + 1e-9)  # one may have been halved


def test_the_rows_of_the_ends_are_those_of_their_own_elements(rod: tuple[MotionProblem, Solution]) -> None:
    problem, solution = rod
    mesh, scheme = solution.shooting.mesh, solution.shooting.scheme
    for end, number in zip(solution.shooting.ends, (0, -1), strict=True):
        again = End.of(problem.dynamics[number], problem.rests[number], scheme, float(mesh.lengths[number]), problem.zeros[number])
        np.testing.assert_allclose(end.M, again.M)
        assert end.gap >= LEAST_GAP
    assert mesh.lengths[0] > problem.manoeuvre[1] / 50  # longer than those of the manoeuvre


def test_linear_tails_are_off_by_the_square_of_what_is_left(cart: tuple[MotionProblem, Solution]) -> None:
    """Cut by d on either side, tails begin at exp(z d) of the distance from rest; the pole's motion is odd, and off by the cube."""
    problem, solution = cart
    motion, ends = solution.motion, solution.shooting.ends
    shooting = replace(solution.shooting, ends=(replace(ends[0], curved=None), replace(ends[1], curved=None)))
    errors = [tail_errors(problem, shooting, motion)[0]]
    mesh = shooting.mesh
    for cut in (3, 5):
        shorter = replace(
            shooting, mesh=Mesh(mesh.edges[cut:], mesh.interval[cut:]), wanted=shooting.wanted[cut:], number=shooting.number + 1
        )
        part = replace(motion, points=motion.points[cut:], coefficients=motion.coefficients[cut:])
        again, _ = converged(shorter, part, 1e-10)
        assert again is not None
        errors.append(tail_errors(problem, shorter, again)[0])
    grown = np.log(np.array(errors[1:]) / errors[0]) / (mesh.edges[[3, 5]] - mesh.edges[0]) / np.max(problem.zeros[0].real)
    np.testing.assert_allclose(grown, 3.0, atol=0.3)


def test_a_motion_is_carried_over_to_another_mesh(rod: tuple[MotionProblem, Solution]) -> None:
    """Within its own mesh as it is, beyond as it dies out: what is carried over meets the conditions there."""
    problem, solution = rod
    shooting, motion = solution.shooting, solution.motion
    whole = known(problem, shooting, motion)
    same = whole.on(shooting.mesh, shooting.scheme.count)
    np.testing.assert_array_equal(same.points, motion.points)
    np.testing.assert_allclose(same.coefficients, motion.coefficients, atol=1e-13 * np.max(np.abs(motion.coefficients)))
    finer = shooting.mesh.split(np.full(len(shooting.mesh), 3)).with_more(np.full(4, 0.01), np.full(4, 0.01))
    wanted = wanted_at(finer, problem.reference, np.arange(1, shooting.scheme.steps + 1) / shooting.scheme.steps)
    matched = np.stack([wanted[:, points - 1, i] for i, points in enumerate(shooting.scheme.points)], axis=1)
    carried = whole.on(finer, shooting.scheme.count)
    fine = replace(shooting, mesh=finer, wanted=matched)
    gaps, away = fine.misses(carried, fine.nodes(carried))
    assert np.max(np.abs(gaps) / shooting.sizes(motion)) <= 1e-7
    assert np.max(np.abs(away)) <= 1e-7 * np.pi / 2
