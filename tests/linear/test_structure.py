"""The structure algorithm: plants whose outputs must be combined before the inputs can be found from them."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import RelativeDegreeError
from invtrack.linear import normal_form, relative_degree, zero_report, zeros
from invtrack.linear.state_space import StateSpace
from tests.linear.random_plants import assert_same_set, pencil_zeros, rotation
from tests.published.plant import PublishedPlant
from tests.published.textbook import EMAMI_3, EMAMI_4


def plant_without_relative_degree(seed: int) -> StateSpace:
    """Feedthrough of low rank, leading gains C B of low rank, both, or an input that acts one integration later than the others."""
    rng = np.random.default_rng(seed)
    p = int(rng.integers(2, 5))
    n = int(rng.integers(2 * p, 2 * p + 4))
    A, B, C, D = rng.normal(size=(n, n)), rng.normal(size=(n, p)), rng.normal(size=(p, n)), np.zeros((p, p))
    kind, rank = seed % 4, int(rng.integers(1, p))
    if kind in (0, 2):
        D = rng.normal(size=(p, rank)) @ rng.normal(size=(rank, p))
    if kind in (1, 2):
        B -= np.linalg.pinv(C) @ (C @ B - rng.normal(size=(p, rank)) @ rng.normal(size=(rank, p)))
    if kind == 3:
        A = scipy.linalg.block_diag(A, -1.0)
        A[:n, n], B, C = B[:, 0], np.vstack([np.hstack([np.zeros((n, 1)), B[:, 1:]]), np.eye(p)[:1]]), np.c_[C, np.zeros(p)]
    T = rotation(rng, len(A))
    return StateSpace(T @ A @ T.T, T @ B, C @ T.T, D)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.integers(0, 10**6))
def test_zeros_are_those_of_the_pencil_and_the_rest_lie_at_infinity(seed: int) -> None:
    plant = plant_without_relative_degree(seed)
    expected = pencil_zeros(plant.A, plant.B, plant.C, plant.D)
    assert_same_set(zeros(plant), expected, 1e-6 * max(1.0, np.max(np.abs(expected), initial=0.0)))
    assert sum(normal_form(plant).orders) == plant.n_states - len(expected)


@settings(deadline=None, max_examples=30, derandomize=True)
@given(st.integers(0, 10**6))
def test_rows_are_the_combinations_of_derivatives_that_they_are_said_to_be(seed: int) -> None:
    """As transfer functions: C* (s I - A)^-1 B = Z(s) G(s) and A_x (s I - A)^-1 B + B_y = X(s) G(s)."""
    plant = plant_without_relative_degree(seed)
    form = normal_form(plant)
    for s in (0.7 + 1.1j, -2.0 + 0.3j, 5.0j):
        response = np.linalg.solve(s * np.eye(plant.n_states) - plant.A, plant.B)
        G = plant.C @ response + plant.D
        Z, X = (sum(M * s**k for k, M in enumerate(rows.coefficients)) for rows in (form.zeta, form.chi))
        for got, expected in ((form.C_star @ response, Z @ G), (form.A_x @ response + form.B_y, X @ G)):
            assert got == pytest.approx(expected, rel=1e-8, abs=1e-8 * np.max(np.abs(expected), initial=1.0))


@settings(deadline=None, max_examples=15, derandomize=True)
@given(st.integers(0, 10**6))
def test_units_of_states_inputs_outputs_and_time_do_not_matter(seed: int) -> None:
    plant, rng = plant_without_relative_degree(seed), np.random.default_rng(seed)
    states, inputs, outputs = (10.0 ** rng.integers(-6, 7, size) for size in (plant.n_states, *[plant.n_outputs] * 2))
    time = 10.0 ** rng.integers(-6, 7)
    other = StateSpace(
        time * states[:, None] * plant.A / states,
        time * states[:, None] * plant.B * inputs,
        outputs[:, None] * plant.C / states,
        outputs[:, None] * plant.D * inputs,
    )
    assert sorted(normal_form(other).orders) == sorted(normal_form(plant).orders)
    expected = zeros(plant)
    assert_same_set(zeros(other) / time, expected, 1e-6 * max(1.0, np.max(np.abs(expected), initial=0.0)))


def test_a_chain_that_needs_more_derivatives_of_one_output_than_it_has_states_before_the_input() -> None:
    """y1 = x1, y2 = x2 with x1' = x3 + u1, x2' = u1, x3' = u2: y1' - y2' = x3, so u2 = y1'' - y2''; no zeros."""
    A, B, C = np.zeros((3, 3)), np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.eye(3)[:2]
    A[0, 2] = 1.0
    form = normal_form(StateSpace(A, B, C))
    assert (sorted(form.orders), form.derivatives, form.relative_degree, form.V.shape[1]) == ([1, 2], (2, 2), None, 0)
    report = str(zero_report(StateSpace(A, B, C)))
    assert report.startswith(
        "0 zero(s); no vector relative degree, zeros at infinity of orders (1, 2), input from derivatives up to"
    )


@pytest.mark.parametrize(("published", "orders", "derivatives"), [(EMAMI_3, (0, 2), (2, 2)), (EMAMI_4, (1, 2), (2, 2))])
def test_orders_at_infinity_of_published_examples(
    published: PublishedPlant, orders: tuple[int, ...], derivatives: tuple[int, ...]
) -> None:
    """A singular feedthrough; a second input that acts on both outputs before the first does."""
    report = zero_report(published.square())
    assert (report.relative_degree, report.infinite_orders, report.derivatives) == (None, orders, derivatives)


def test_the_relative_degree_is_refused_where_there_is_none_with_what_the_inverse_takes() -> None:
    plant = StateSpace([[-1.0, 0.0], [0.0, -2.0]], np.eye(2), np.eye(2), np.ones((2, 2)))
    with pytest.raises(
        RelativeDegreeError, match=r"no vector relative degree: .* up to the orders \(1, 1\).*invtrack.invert finds it"
    ):
        relative_degree(plant)


SECOND_ORDER = np.array([[0.0, 1.0], [-2.0, -3.0]])


@pytest.mark.parametrize(
    ("plant", "reason"),
    [
        (StateSpace(SECOND_ORDER, np.eye(2), [[1.0, 0.0], [0.0, 0.0]]), "output 'y2' is not reached by any input"),
        (StateSpace(SECOND_ORDER, [[0.0, 0.0], [1.0, 0.0]], np.eye(2)), "input 'u2' reaches no output"),
        (
            StateSpace(SECOND_ORDER, [[0.0, 0.0], [1.0, -2.0]], np.eye(2)),
            r"inputs are not independent: u1 \+ 0.5 u2 acts on nothing",
        ),
        (
            StateSpace(SECOND_ORDER, np.eye(2), [[1.0, 1.0], [3.0, 3.0]]),
            r"outputs are not independent: y1 - 0.3333 y2 is always zero",
        ),
        (
            StateSpace(np.diag([-1.0, -2.0, -3.0]), [[1.0, 1.0], [0.0, 0.0], [1.0, 1.0]], [[1.0, 1, 0], [1, 0, 0]]),
            "inputs are not independent: u1 - u2 acts on nothing",
        ),
        (
            StateSpace(np.diag([-1.0, -2.0, -3.0]), [[1.0, 1.0], [0.0, 0.0], [0.0, 1.0]], [[1.0, 1, 0], [1, 0, 0]]),
            r"normal rank 1 of 2 \(no input moves y1 - y2\)",
        ),
        (
            StateSpace([[-1.0, 0, 0], [1, -2, 0], [0, 0, -3]], [[1.0, 1.0], [0, 0], [0, 1.0]], np.eye(3)[:2]),
            r"normal rank 1 of 2 \(they obey an equation of their own\)",
        ),
    ],
)
def test_a_singular_transfer_matrix_is_refused_with_the_condition_that_fails(plant: StateSpace, reason: str) -> None:
    with pytest.raises(RelativeDegreeError, match=rf"{reason}.*quadratic_redesign"):
        normal_form(plant)


@pytest.mark.parametrize("seed", range(20))
def test_an_input_that_only_rounding_lets_in_is_no_input(seed: int) -> None:
    """The second input acts one integration later than the first; in other coordinates rounding fills its column of C B."""
    A, B, C = np.diag([1.0, 1.0], k=1), np.array([[1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), np.eye(3)[:2]
    T = np.random.default_rng(seed).normal(size=(3, 3))
    form = normal_form(StateSpace(A, B, C).transformed(T))
    assert (sorted(form.orders), form.V.shape[1]) == ([1, 2], 0)


@pytest.mark.parametrize("unit", [1.0, 1e6])
@pytest.mark.parametrize(
    ("matrix", "entry"), [("C", (0, 1)), ("C", (0, 2)), ("C", (0, 3)), ("A", (0, 2)), ("A", (1, 3)), ("B", (1, 0))]
)
def test_what_rounding_left_of_a_zero_shortens_no_chain(matrix: str, entry: tuple[int, int], unit: float) -> None:
    """y has the third derivative 2 eta - y + u, eta' = -3 eta + y; one of the zeros between input and output is 1e-17 instead."""
    matrices = {
        "A": np.array([[0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 2.0], [1.0, 0.0, 0.0, -3.0]]),
        "B": np.array([[0.0], [0.0], [1.0], [0.0]]),
        "C": np.array([[1.0, 0.0, 0.0, 0.0]]),
    }
    matrices[matrix][entry] = 1e-17
    plant = StateSpace(**matrices).transformed(np.diag([1.0, unit, 1.0, 1 / unit]))
    assert relative_degree(plant) == (3,)
    assert zeros(plant) == pytest.approx([-3.0], rel=1e-12)


def test_a_weak_but_clear_coupling_is_part_of_a_chain() -> None:
    """1e-9 of the stiffness couples the mass that is pushed to the one that is followed."""
    A = np.array([[0.0, 1.0, 0.0, 0.0], [-1.0, 0.0, 1e-9, 0.0], [0.0, 0.0, 0.0, 1.0], [1e-9, 0.0, -1.0, 0.0]])
    assert relative_degree(StateSpace(A, np.eye(4)[:, [3]], np.eye(4)[[0]])) == (4,)


def test_gains_within_the_models_error_count_as_dependent() -> None:
    plant = StateSpace([[0.0, 1.0], [-1.0, -1.0]], [[1.0, 1.0], [1.0, 1.0 + 1e-7]], np.eye(2))
    assert relative_degree(plant) == (1, 1)
    with pytest.raises(RelativeDegreeError):
        normal_form(StateSpace(plant.A, plant.B, plant.C, error_estimates={"B": 1e-6}))


@pytest.mark.parametrize("seed", [4, 12, 13])
def test_dependent_inputs_are_named_where_rounding_outgrows_what_a_long_chain_passes_on(seed: int) -> None:
    """60 states without structure, the last input a combination of the others: its terms outgrow each output's derivatives within
    twenty of them, one gain after the other, and none of what is left may pass for an independent one."""
    rng = np.random.default_rng(seed)
    A, B = rng.normal(size=(60, 60)) / np.sqrt(60), rng.normal(size=(60, 3))
    B[:, 2] = B[:, :2] @ rng.normal(size=2)
    plant = StateSpace(A, B * [1.0, 1e3, 1e-3], rng.normal(size=(3, 60)))
    with pytest.raises(RelativeDegreeError, match="the inputs are not independent"):
        normal_form(plant)
