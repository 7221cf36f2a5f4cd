"""Invariant zeros and the split of the internal dynamics."""

from __future__ import annotations

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.errors import NonHyperbolicError
from invtrack.linear.internal_dynamics import internal_dynamics, split_dynamics, zeros_on_axis
from invtrack.linear.state_space import StateSpace
from invtrack.linear.zeros import zeros
from tests.cited_plants import HE3_A, HE3_B, HE3_C, cantilever_paper
from tests.linear.random_plants import assert_same_set, block, pencil_zeros, plant_with

HE3 = StateSpace(HE3_A, HE3_B, HE3_C)


@pytest.mark.parametrize("tip_mass", [0.0, 10.0, 100.0, 1e4])
def test_cantilever_zeros_are_the_printed_ones_at_any_tip_mass(tip_mass: float) -> None:
    found = zeros(StateSpace(*cantilever_paper(tip_mass)))
    assert_same_set(found, [1.76534, -1.76534, 0.234538, -0.234538], 5e-6)


def test_hovering_helicopter_has_one_unstable_and_one_stable_pair_near_the_axis() -> None:
    found = zeros(HE3)
    assert_same_set(found, pencil_zeros(HE3.A, HE3.B, HE3.C, HE3.D), 1e-9)
    assert sorted(np.sign(found.real)) == [-1, -1, 1, 1]
    assert np.all(np.abs(found.real) < 0.1 * np.abs(found.imag))
    assert split_dynamics(HE3).A_u.shape == (2, 2)


@settings(deadline=None, max_examples=40, derandomize=True)
@given(st.lists(st.integers(1, 3), min_size=1, max_size=3), st.integers(0, 5), st.integers(0, 10**6))
def test_zeros_against_the_rosenbrock_pencil_and_an_independent_library(degrees: list[int], n_z: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    internal = rng.normal(size=(n_z, n_z))
    system = plant_with(rng, degrees, internal)
    found = zeros(system)
    assert len(found) == system.n_states - sum(degrees) == n_z
    assert_same_set(found, np.linalg.eigvals(internal), 1e-6)
    if max(degrees) == 1:  # then the infinite zeros are simple, and neither pencil nor library confuses them with finite ones
        assert_same_set(found, pencil_zeros(system.A, system.B, system.C, system.D), 1e-6)
        theirs = control.zeros(control.ss(system.A, system.B, system.C, system.D))
        assert_same_set(found, theirs[np.abs(theirs) < 1e4], 1e-6)


def test_zeros_with_direct_feedthrough_are_the_inverse_systems_poles() -> None:
    rng = np.random.default_rng(3)
    A, B, C, D = rng.normal(size=(5, 5)), rng.normal(size=(5, 2)), rng.normal(size=(2, 5)), np.array([[2.0, 1.0], [0.0, 1.0]])
    system = StateSpace(A, B, C, D)
    assert_same_set(zeros(system), np.linalg.eigvals(A - B @ np.linalg.solve(D, C)), 1e-9)
    assert_same_set(zeros(system), pencil_zeros(A, B, C, D), 1e-9)


def test_full_relative_degree_leaves_no_zeros() -> None:
    split = split_dynamics(StateSpace(np.diag([1.0, 1.0], k=1), [[0.0], [0.0], [1.0]], [[1.0, 0.0, 0.0]]))
    assert (split.A_s.shape, split.A_u.shape, split.internal.zeros.shape) == ((0, 0), (0, 0), (0,))


def test_modes_that_no_input_moves_are_zeros() -> None:
    """(s - 1)/((s + 2)(s + 3)) with an unobservable mode at -4 and an uncontrollable one at -5 beside it."""
    A = np.array([[0.0, 1, 0, 0], [-6, -5, 0, 0], [1, 0, -4, 0], [0, 0, 0, -5]])
    B, C = np.array([[0.0], [1.0], [1.0], [0.0]]), np.array([[-1.0, 1.0, 0.0, 1.0]])
    T = np.random.default_rng(1).normal(size=(4, 4))
    assert_same_set(zeros(StateSpace(A, B, C).transformed(T)), [1.0, -4.0, -5.0], 1e-9)


def test_repeated_zeros() -> None:
    """A triple zero at 2 in one Jordan block: rounding may spread it by the cube root of eps, no more."""
    internal = 2.0 * np.eye(3) + np.diag([1.0, 1.0], k=1)
    system = plant_with(np.random.default_rng(2), (2,), internal)
    assert_same_set(zeros(system), [2.0, 2.0, 2.0], 1e-4)
    assert split_dynamics(system).A_u.shape == (3, 3)


@pytest.mark.parametrize("seed", range(10))
def test_units_scale_zeros_with_time_and_with_nothing_else(seed: int) -> None:
    """Rigid body with a flexible mode, so that the states alone do not all act on each other."""
    A = np.array([[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, -4, -0.2]])
    B, C = np.array([[0.0], [1.0], [0.0], [1.0]]), np.array([[1.0, 0.0, -3.0, 0.0]])
    # 1/s^2 - 3/(s^2 + 0.2 s + 4) = (4 + 0.2 s - 2 s^2)/...
    expected = np.roots([-2.0, 0.2, 4.0])
    rng = np.random.default_rng(seed)
    state, time, gain = 10.0 ** rng.integers(-6, 7, size=4), 10.0 ** rng.integers(-6, 7), 10.0 ** rng.integers(-6, 7, size=2)
    system = StateSpace(time * state[:, None] * A / state, time * state[:, None] * B * gain[0], gain[1] * C / state)
    assert_same_set(split_dynamics(system).internal.zeros / time, expected, 1e-9)


@pytest.mark.parametrize(
    "internal",
    [
        block(2j),
        block(0.0),
        np.array([[0.0, 1.0], [0.0, 0.0]]),
        np.array([[0.0, 1, 1, 0], [-1, 0, 0, 1], [0, 0, 0, 1], [0, 0, -1, 0]]),
        block(1.0, -2.0, 3j),
    ],
    ids=["pair", "origin", "double at origin", "double pair", "among others"],
)
@pytest.mark.parametrize("seed", range(4))
def test_zeros_on_the_axis_are_refused(internal: np.ndarray, seed: int) -> None:
    system = plant_with(np.random.default_rng(seed), (2,), internal)
    with pytest.raises(NonHyperbolicError, match="lie on the imaginary axis"):
        split_dynamics(system)


@pytest.mark.parametrize("internal", [block(2j), np.array([[0.0, 1.0], [0.0, 0.0]])], ids=["pair", "double at origin"])
@pytest.mark.parametrize("seed", range(4))
def test_zeros_on_the_axis_are_refused_through_the_noise_of_a_numerical_linearization(internal: np.ndarray, seed: int) -> None:
    rng = np.random.default_rng(seed)
    exact = plant_with(rng, (2,), internal, mixed=False)
    noise = np.zeros((4, 4))
    noise[2:] = rng.uniform(-1e-11, 1e-11, size=(2, 4))
    system = StateSpace(exact.A + noise, exact.B, exact.C, error_estimates={"A": 1e-11})
    with pytest.raises(NonHyperbolicError, match="lie on the imaginary axis"):
        split_dynamics(system)


def test_zeros_close_to_the_axis_but_off_it_are_told_apart() -> None:
    system = plant_with(np.random.default_rng(0), (1,), block(1e-6 + 1j, -1e-6 + 2j, -1.0))
    assert zeros_on_axis(internal_dynamics(system)).size == 0
    assert split_dynamics(system).A_u.shape == (2, 2)


def test_the_split_decouples_stable_from_antistable() -> None:
    rng = np.random.default_rng(7)
    system = plant_with(rng, (1, 2), block(1.0, -0.5, 0.2 + 3j, -1 + 1j) + np.triu(rng.normal(size=(6, 6)), k=2))
    split = split_dynamics(system)
    A_eta = split.internal.A_eta
    assert_same_set(np.linalg.eigvals(split.A_s), [-0.5, -1 + 1j, -1 - 1j], 1e-9)
    assert_same_set(np.linalg.eigvals(split.A_u), [1.0, 0.2 + 3j, 0.2 - 3j], 1e-9)
    W, L = np.hstack([split.W_s, split.W_u]), np.vstack([split.L_s, split.L_u])
    assert pytest.approx(np.eye(6), abs=1e-10) == L @ W
    assert A_eta @ split.W_s == pytest.approx(split.W_s @ split.A_s, abs=1e-10)
    assert A_eta @ split.W_u == pytest.approx(split.W_u @ split.A_u, abs=1e-10)
