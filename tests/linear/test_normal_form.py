"""Vector relative degree and the normal form."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import RelativeDegreeError
from invtrack.linear.normal_form import normal_form, relative_degree
from invtrack.linear.state_space import StateSpace
from tests.cited_plants import TWO_DISC_A, TWO_DISC_B, TWO_DISC_C, cantilever_paper
from tests.linear.random_plants import block, plant_with

DEGREES = st.lists(st.integers(1, 3), min_size=1, max_size=3)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(DEGREES, st.integers(0, 4), st.integers(0, 10**6))
def test_relative_degree_is_the_one_that_was_built_in(degrees: list[int], n_z: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    assert relative_degree(plant_with(rng, degrees, rng.normal(size=(n_z, n_z)))) == tuple(degrees)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(DEGREES, st.integers(0, 4), st.integers(0, 10**6))
def test_coordinates_are_complementary(degrees: list[int], n_z: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    system = plant_with(rng, degrees, rng.normal(size=(n_z, n_z)))
    form = normal_form(system)
    T, T_inverse = np.vstack([form.C_star, form.N]), np.hstack([form.P, form.V])
    assert T @ T_inverse == pytest.approx(np.eye(system.n_states), abs=1e-9)
    rows = [i for i, r in enumerate(degrees) for _ in range(r)]
    orders = [k for r in degrees for k in range(r)]
    for row, i, k in zip(form.C_star, rows, orders, strict=True):
        assert row == pytest.approx(system.C[i] @ np.linalg.matrix_power(system.A, k), abs=1e-9)


def test_tracking_law_makes_the_highest_derivative_the_new_input() -> None:
    """With u = F x + G v the outputs obey y^(r) = v whatever the state."""
    rng = np.random.default_rng(5)
    system = plant_with(rng, (1, 3), block(1.0, -2.0))
    F, G, _ = normal_form(system).tracking_law()
    for i, r in enumerate((1, 3)):
        last = system.C[i] @ np.linalg.matrix_power(system.A, r - 1)
        assert last @ (system.A + system.B @ F) == pytest.approx(np.zeros(6), abs=1e-9)
        assert last @ system.B @ G == pytest.approx(np.eye(2)[i], abs=1e-9)


@pytest.mark.parametrize("tip_mass", [0.0, 10.0, 100.0])
def test_cantilever_has_relative_degree_two(tip_mass: float) -> None:
    assert relative_degree(StateSpace(*cantilever_paper(tip_mass))) == (2,)


def test_direct_feedthrough_is_relative_degree_zero() -> None:
    system = StateSpace([[-2.0, 0.0], [1.0, -1.0]], np.eye(2), np.eye(2), [[1.0, 0.0], [0.0, 0.0]])
    assert relative_degree(system) == (0, 1)


def test_uneven_scales_do_not_hide_the_relative_degree() -> None:
    """States, inputs, outputs and time in units apart by up to 1e12."""
    rng = np.random.default_rng(8)
    base = plant_with(rng, (1, 2), block(0.5, -1.0, 0.3 + 2j), mixed=False)
    for _ in range(20):
        state, inputs, outputs = (10.0 ** rng.integers(-6, 7, size) for size in (7, 2, 2))
        time = 10.0 ** rng.integers(-6, 7)
        system = StateSpace(
            time * state[:, None] * base.A / state, time * state[:, None] * base.B * inputs, outputs[:, None] * base.C / state
        )
        assert relative_degree(system) == (1, 2)


def test_an_output_that_no_input_reaches_is_refused_by_name() -> None:
    system = StateSpace(np.diag([-1.0, -2.0]), [[1.0], [0.0]], [[0.0, 1.0]], outputs=["idle"])
    with pytest.raises(RelativeDegreeError, match="output 'idle' is not reached by any input"):
        relative_degree(system)


def test_inputs_that_can_hardly_be_told_apart_are_refused_with_the_condition_number() -> None:
    """B_y = [[1, 1], [1, 1 + 1e-10]]."""
    system = StateSpace([[0.0, 1.0], [-1.0, -1.0]], [[1.0, 1.0], [1.0, 1.0 + 1e-10]], np.eye(2))
    with pytest.raises(RelativeDegreeError, match=r"condition number \d\.\de\+1\d \(limit 1e\+10\)"):
        relative_degree(system)


def test_a_gain_within_the_models_error_counts_as_zero() -> None:
    A, B, C = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[1e-9], [1.0]]), np.array([[1.0, 0.0]])
    assert relative_degree(StateSpace(A, B, C)) == (1,)
    assert relative_degree(StateSpace(A, B, C, error_estimates={"B": 1e-8})) == (2,)


@pytest.mark.parametrize("seed", range(20))
def test_coordinates_turned_until_the_output_is_one_of_them_leave_the_relative_degree(seed: int) -> None:
    """Then B holds rounding where it would be zero, and C picks just that."""
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    A, B, C = turn.T @ TWO_DISC_A @ turn, turn.T @ TWO_DISC_B, TWO_DISC_C @ turn
    align = np.linalg.qr(np.column_stack([C[0], rng.normal(size=(4, 3))]))[0]
    C = np.array([[C[0] @ align[:, 0], 0.0, 0.0, 0.0]])
    assert relative_degree(StateSpace(align.T @ A @ align, align.T @ B, C)) == (2,)


@pytest.mark.parametrize("masses", [3, 10, 15])
def test_long_chains_pass_on_less_than_the_rounding_of_their_norms(masses: int) -> None:
    """A force on the first mass reaches the last through the dampers, by 0.1 per mass, beside stiffnesses of 100."""
    L = np.diag([1.0, *[2.0] * (masses - 2), 1.0]) - np.diag(np.ones(masses - 1), 1) - np.diag(np.ones(masses - 1), -1)
    A = np.block([[np.zeros_like(L), np.eye(masses)], [-100.0 * L, -0.1 * L]])
    B, C = np.zeros((2 * masses, 1)), np.zeros((1, 2 * masses))
    B[masses], C[0, masses - 1] = 1.0, 1.0
    assert relative_degree(StateSpace(A, B, C)) == (masses + 1,)
