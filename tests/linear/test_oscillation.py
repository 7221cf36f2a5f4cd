"""The slowest oscillation: that of a flexible mode, whatever rounding makes of those that do not oscillate."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.errors import ModelError
from invtrack.linear import StateSpace, slowest_flexible_period
from tests.inversion.nonlinear.mechanisms import satellite


def chain(*stiffnesses: float, noise: float = 0.0) -> StateSpace:
    """Free masses of 1 kg in a row on springs, pushed and seen at the first; noise: of the size of rounding in every entry of A."""
    count = len(stiffnesses) + 1
    K = np.zeros((count, count))
    for i, k in enumerate(stiffnesses):
        K[i : i + 2, i : i + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    A = np.block([[np.zeros((count, count)), np.eye(count)], [-K, np.zeros((count, count))]])
    A = A + noise * np.random.default_rng(3).normal(size=A.shape)
    B, C = np.zeros((2 * count, 1)), np.zeros((1, 2 * count))
    B[count], C[0, 0] = 1.0, 1.0
    return StateSpace(A, B, C, error_estimates={"A": 3 * noise})


@pytest.mark.parametrize("noise", [0.0, 1e-16, 1e-10])
def test_two_free_masses_swing_against_each_other(noise: float) -> None:
    """sqrt(2 k / m); their common motion, a double eigenvalue at zero, is split by noise to its root."""
    assert slowest_flexible_period(chain(8.0, noise=noise)) == pytest.approx(2 * np.pi / 4.0, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-8, 1.0, 1e8])
def test_units_of_time_and_of_states_do_not_matter(unit: float) -> None:
    model = chain(8.0, noise=1e-12)
    sizes = np.array([1e-6, 1e6, 1.0, 1e3])
    other = StateSpace(
        unit * model.A * sizes[:, None] / sizes,
        model.B * sizes[:, None],
        model.C / sizes,
        error_estimates={"A": unit * model.errors("A") * sizes[:, None] / sizes},
    )
    assert slowest_flexible_period(other) == pytest.approx(slowest_flexible_period(model) / unit, rel=1e-6)


def test_a_mode_a_billion_times_slower_than_the_fastest_is_one() -> None:
    """Two oscillators that share nothing but their input: 1e-3 and 1e6 rad/s."""
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 0], A[3, 2] = -1e-6, -1e12
    model = StateSpace(A, [[0.0], [1.0], [0.0], [1.0]], [[1.0, 0.0, 1.0, 0.0]])
    assert slowest_flexible_period(model) == pytest.approx(2 * np.pi / 1e-3, rel=1e-6)


@pytest.mark.parametrize("thrust", [0.0, 1e-20, 1e-16])
def test_a_satellite_does_not_oscillate(thrust: float) -> None:
    """Nor by the rounding in the thrusts that are to be zero, which push it aside where it turns."""
    plant = satellite()
    q = np.array([0.9, 0.3, -0.2, 0.4]) / np.linalg.norm([0.9, 0.3, -0.2, 0.4])
    there = plant.at(qpos=np.concatenate([[0.3, 1.0, 2.0], q]), ctrl=thrust * np.random.default_rng(0).normal(size=6))
    assert np.isnan(slowest_flexible_period(invtrack.linearize(plant, equilibrium=there)))


def test_what_only_decays_or_grows_does_not_oscillate() -> None:
    assert np.isnan(slowest_flexible_period(StateSpace([[-1.0, 1.0], [0.0, 2.0]], [[0.0], [1.0]], [[1.0, 0.0]])))


def test_what_is_no_model_is_refused() -> None:
    with pytest.raises(ModelError, match="expected"):
        slowest_flexible_period(np.eye(2))
