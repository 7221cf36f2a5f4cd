"""The two-sided mechanism itself: what takes the continuous part apart, and a problem with a solution in closed form."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from invtrack.inversion.bounded_solution import inverse_problem
from invtrack.inversion.inverse_system import InverseSystem, hyperbolic_splits, inverse_systems
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.stretch import transitions
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem, drive_units
from invtrack.plans.two_sided_problem import TwoSidedProblem
from invtrack.redesign.cost import as_weights
from invtrack.redesign.optimum import optimum
from invtrack.references.profiles import raised_cosine, rest_to_rest
from tests.cited_plants import cantilever_paper

CANTILEVER = StateSpace(*cantilever_paper(10.0))


def systems() -> dict[str, TwoSidedSystem]:
    plant = SwitchedSystem([CANTILEVER])
    return {
        "inverse": InverseSystem.of(CANTILEVER, hyperbolic_splits(plant)[0]).system,
        "optimum": optimum(CANTILEVER, as_weights(plant, R=1e-3, Q_x=0.0, Q_y=1.0)).system,
    }


@pytest.mark.parametrize("name", ["inverse", "optimum"])
@pytest.mark.parametrize("units", [(1.0, 1.0), (8.0, 0.25)])
def test_what_is_continuous_comes_apart_into_the_states(name: str, units: tuple[float, float]) -> None:
    system = systems()[name].in_units(*units)
    rho, n_f, n_b = system.prescribed, system.forward.size, system.backward.size
    apart = system.T @ np.hstack([system.forward.J, system.backward.J])
    assert apart == pytest.approx(np.vstack([np.zeros((rho, n_f + n_b)), np.eye(n_f + n_b)]), abs=1e-9)


@pytest.mark.parametrize("name", ["inverse", "optimum"])
def test_each_part_decays_in_its_own_direction(name: str) -> None:
    system = systems()[name]
    assert np.max(np.linalg.eigvals(system.forward.A).real) < 0
    assert np.min(np.linalg.eigvals(system.backward.A).real) > 0


def scalar(rate: float, *, jump: float) -> DrivenSystem:
    """z_f' = -rate z_f + w, z_b' = rate z_b, w' = 0; [z_f; jump z_b] is continuous."""
    one = np.eye(1)
    J_f, J_b = np.array([[1.0], [0.0]]), np.array([[0.0], [jump]])
    system = TwoSidedSystem(Part(-rate * one, one, J_f), Part(rate * one, one, J_b), np.diag([1.0, 1 / jump]))
    zero = np.zeros((1, 1))
    return DrivenSystem(system, S=zero, D_f=one, D_b=zero, X_w=zero, J_w=np.zeros((2, 1)))


def test_a_problem_of_two_intervals_in_closed_form() -> None:
    """w = 0, then 2 from t = 0 on, -1 for z_b's drive nowhere: z_f charges through the switch at 1, z_b stays at rest."""
    first, second = scalar(1.0, jump=1.0), scalar(3.0, jump=5.0)
    problem = TwoSidedProblem(
        breakpoints=np.array([0.0, 1.0, 4.0]),
        driven=[first, second],
        which=np.array([0, 0, 1, 1]),
        w_start=np.array([[0.0], [2.0], [2.0], [2.0]]),
        w_end=np.array([[0.0], [2.0], [2.0], [2.0]]),
        owner=np.array([0, 0, 1, 1]),
        systems=[first.system, second.system],
        switch_times=np.array([1.0]),
        shifts=np.zeros((1, 2)),
        peaks=[np.zeros(0)],
    )
    solution = problem.solve()
    values = solution.trajectory().at([-5.0, 0.5, 1.0, 2.0, 9.0], None)[:, 0]
    at_switch = 2 * (1 - np.exp(-1.0))
    late = [2 / 3 + (at_switch - 2 / 3) * np.exp(-3 * s) for s in (0.0, 1.0, 8.0)]
    assert values == pytest.approx([0.0, 2 * (1 - np.exp(-0.5)), *late], abs=1e-12)
    assert (solution.boundary.freedom, solution.compatibility_rows) == (0, [0])


def test_units_bring_the_drive_to_the_size_of_the_dynamics() -> None:
    weak, strong = scalar(1.0, jump=1.0), scalar(4.0, jump=1.0)
    driven = [weak, DrivenSystem(strong.system, strong.S, 1000 * strong.D_f, 3e-5 + strong.D_b, strong.X_w, strong.J_w)]
    forward, backward = drive_units(driven)
    assert forward == 256.0  # 1000 / 4, the next power of two
    assert backward == 2.0**-17  # 3e-5 / 4


def test_intervals_of_one_model_share_their_system() -> None:
    light, heavy = (StateSpace(*cantilever_paper(mass)) for mass in (0.0, 100.0))
    times = np.linspace(0.5, 6.0, 7)
    problem = PlanningProblem.of(SwitchedSystem([light, heavy] * 4, times), raised_cosine(2.0))
    found = inverse_problem(problem, inverse_systems(problem.plant, hyperbolic_splits(problem.plant)))
    assert len({id(system) for system in found.systems}) == 2
    assert all(a is not b for a, b in pairwise(found.systems))


def test_a_stretch_outside_the_manoeuvre_carries_its_states_over_no_time() -> None:
    late = SwitchedSystem([CANTILEVER, StateSpace(*cantilever_paper(0.0))], [50.0])
    problem = PlanningProblem.of(late, rest_to_rest(0.0, 1.0, duration=2.0))
    assert problem.manoeuvre == (0.0, 50.0)
    solution = inverse_problem(problem, inverse_systems(problem.plant, hyperbolic_splits(problem.plant))).solve()
    assert [len(stretch.lengths) for stretch in solution.stretches] == [2, 0]
    for part in (0, 1):
        assert transitions(solution.stretches, part)[1] == pytest.approx(np.eye(2))
