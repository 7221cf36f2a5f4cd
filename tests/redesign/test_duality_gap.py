"""The duality gap of a redesign tells a right optimum from a wrong one, and by how much the wrong one is too dear."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided_problem import two_sided_problem
from invtrack.redesign.cost import as_weights
from invtrack.redesign.least_cost import LeastCost, held_still
from invtrack.redesign.optimality import Conditions
from invtrack.redesign.optimum import Optimum, TrackedSystem, optimum
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.profiles import rest_to_rest
from tests.redesign.plants import (
    DIRECT,
    FULL,
    FULL_WEIGHTS,
    HEAVIER,
    MINIMUM,
    NONMINIMUM,
    TWO_DISC,
    TWO_DISC_WEIGHTS,
    UNSTABLE,
    WEIGHTS,
    there_and_back,
    two_channels,
)

CASES: dict[str, tuple[Any, Any, dict[str, Any]]] = {
    "nonminimum-phase": (NONMINIMUM, there_and_back(), WEIGHTS),
    "direct": (DIRECT, there_and_back(), WEIGHTS),
    "unstable": (UNSTABLE, there_and_back(), WEIGHTS),
    "two channels": (FULL, two_channels(), FULL_WEIGHTS),
    "jumps": (SwitchedSystem([NONMINIMUM, HEAVIER, MINIMUM], [0.5, 3.0]), there_and_back(), WEIGHTS),
    "rigid body": (TWO_DISC, rest_to_rest(0.0, 1.0, 5.0), TWO_DISC_WEIGHTS),
}


@pytest.mark.parametrize("case", CASES)
def test_the_gap_of_an_optimum_is_rounding(case: str) -> None:
    model, reference, weights = CASES[case]
    plan = quadratic_redesign(model, reference, **weights)
    assert 0 <= plan.optimality_gap < 1e-11
    assert f"at most {plan.optimality_gap:.1e} of its cost above the least" in repr(plan)


def solved(change: Callable[[Optimum], Optimum], R: float) -> tuple[float, float]:
    """Gap and cost of what a changed optimum makes of the problem."""
    problem = held_still(PlanningProblem.of(NONMINIMUM, there_and_back()))
    weights = as_weights(problem.plant, R=R, Q_x=WEIGHTS["Q_x"], Q_y=WEIGHTS["Q_y"])
    system = TrackedSystem.of([NONMINIMUM])
    trajectory: Trajectory = two_sided_problem(problem, [change(optimum(system, weights))], one_unit=False).solve().trajectory()
    still = np.zeros((len(problem.deviation.breakpoints), NONMINIMUM.n_states))
    gap = Conditions([system], problem.owner, weights, problem.deviation, still).gap(trajectory).total
    return gap, LeastCost([problem], weights).cost(trajectory)


def changed(found: Optimum, part: str, name: str, factor: float) -> Optimum:
    """One matrix of one part of an optimum by a factor."""
    old = getattr(found.system, part)
    return replace(found, system=replace(found.system, **{part: replace(old, **{name: factor * getattr(old, name)})}))


def other_weights(found: Optimum) -> Optimum:
    """The optimum for another weight of the output: a plan that moves as the plant does, and is not optimal."""
    weights = as_weights(SwitchedSystem([NONMINIMUM]), R=0.2, Q_x=WEIGHTS["Q_x"], Q_y=1.1 * WEIGHTS["Q_y"])
    return optimum(TrackedSystem.of([NONMINIMUM]), weights)


@pytest.mark.parametrize(
    "corrupt",
    [
        other_weights,
        lambda found: changed(found, "forward", "X", 1.001),
        lambda found: changed(found, "forward", "A", 1.001),
        lambda found: changed(found, "backward", "X", 1.001),
        lambda found: changed(found, "backward", "A", 0.999),
        lambda found: replace(found, E_f=1.001 * found.E_f),
        lambda found: replace(found, E_b=1.001 * found.E_b),
    ],
    ids=["weight", "K and P", "A_c", "L", "A_c'", "drive of x", "drive of the costate"],
)
def test_a_wrong_optimum_is_seen(corrupt: Callable[[Optimum], Optimum]) -> None:
    right, least = solved(lambda found: found, 0.2)
    wrong, dearer = solved(corrupt, 0.2)
    assert right < 1e-12
    assert wrong > 1e-8
    # No plan that moves as the plant does costs more than the gap says above the least.
    if corrupt is other_weights:
        assert 0 < dearer - least <= 1.000001 * wrong * dearer
