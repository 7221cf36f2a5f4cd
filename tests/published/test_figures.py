"""What the literature prints of its plants: poles, zeros, gains at rest."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from invtrack.inversion import invert
from invtrack.linear import zeros
from invtrack.references import rest_to_rest
from tests.linear.random_plants import assert_same_set
from tests.published.library import PLANTS, cases
from tests.published.mechanisms import CART_PENDULUM
from tests.published.plant import PublishedPlant
from tests.published.processes import DISTILLATION_LV, TANK_MINIMUM_PHASE, TANK_NONMINIMUM_PHASE
from tests.published.table import document


def test_there_are_plants_enough() -> None:
    assert len({plant.name for plant in PLANTS}) == len(PLANTS) >= 30
    assert sum(plant.zeros is not None for plant in PLANTS) >= 12


@pytest.mark.parametrize("plant", cases(plant for plant in PLANTS if plant.poles is not None))
def test_poles(plant: PublishedPlant) -> None:
    assert plant.poles is not None
    assert_same_set(plant.exact.poles, plant.poles.values, plant.poles.rounding)


@pytest.mark.parametrize("plant", cases(plant for plant in PLANTS if plant.zeros is not None))
def test_zeros(plant: PublishedPlant) -> None:
    """A double zero moves by the root of what rounding does to the matrices: 1e-7."""
    assert plant.zeros is not None
    assert_same_set(zeros(plant.square()), plant.zeros.values, plant.zeros.rounding + 1e-7)


@pytest.mark.parametrize(
    ("plant", "splits", "constants"),
    [(TANK_MINIMUM_PHASE, (0.70, 0.60), (23.0, 30.0)), (TANK_NONMINIMUM_PHASE, (0.43, 0.34), (39.0, 56.0))],
    ids=["minimum phase", "nonminimum phase"],
)
def test_quadruple_tank(plant: PublishedPlant, splits: tuple[float, float], constants: tuple[float, float]) -> None:
    """The zeros are the roots of (1 + s T3)(1 + s T4) = (1 - g1)(1 - g2) / (g1 g2)."""
    (g1, g2), (T3, T4) = splits, constants
    expected = np.roots([T3 * T4, T3 + T4, 1 - (1 - g1) * (1 - g2) / (g1 * g2)])
    assert_same_set(zeros(plant.square()), expected, 1e-14)


def test_pendulum_on_a_cart() -> None:
    """With the cart held still the pendulum falls as it does about a fixed hinge: the zeros are +-sqrt(m g l / (I + m l^2)).

    Mass 0.2 kg, length to its centre 0.3 m, moment of inertia 0.006 kg m^2, gravity 9.8 m/s^2 (same source).
    """
    rate = np.sqrt(0.2 * 9.8 * 0.3 / (0.006 + 0.2 * 0.3**2))
    assert_same_set(zeros(CART_PENDULUM.square()), [rate, -rate], 5e-4)


@pytest.mark.parametrize("plant", cases(plant for plant in PLANTS if plant.gain is not None))
def test_the_input_that_holds_the_outputs_of_a_constant_input_is_that_input(plant: PublishedPlant) -> None:
    """G(0) e_j is held by e_j; how far the printed digits are off is seen through G(0)^-1."""
    assert plant.gain is not None
    gain, rounding = (np.array(part, dtype=float) for part in plant.gain)
    system = plant.square()
    off = np.abs(np.linalg.inv(gain)) @ rounding  # of a column, to first order
    for j, column in enumerate(gain.T):
        plan = invert(system, rest_to_rest(np.zeros(len(gain)), column, plant.duration, smoothness=2))
        held = plan.inputs([plan.end + 1e4 * plant.duration])[0]
        assert np.all(np.abs(held - np.eye(len(gain))[j]) <= 2 * off[:, j])


def test_relative_gain_of_a_high_purity_column() -> None:
    """lambda_11 = g_11 (G(0)^-1)_11 = 35.1: the input that moves the top composition alone, times its gain."""
    plan = invert(DISTILLATION_LV.square(), rest_to_rest([0.0, 0.0], [1.0, 0.0], DISTILLATION_LV.duration, smoothness=2))
    assert 0.878 * plan.inputs([plan.end])[0, 0] == pytest.approx(35.1, abs=0.05)


def test_the_page_of_published_plants_is_up_to_date() -> None:
    """`python -m tests.published.table > docs/published_plants.md` writes it anew."""
    page = Path(__file__).parents[2] / "docs" / "published_plants.md"
    assert page.read_text(encoding="utf-8") == document()
