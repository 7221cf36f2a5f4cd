"""Which states are comparable, and how large one is where another is 1."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.linear import StateSpace
from invtrack.linear.state_sizes import unit_ratios
from invtrack.linear.switched import as_switched
from tests.cited_plants import cantilever_paper
from tests.inversion.nonlinear.mechanisms import satellite


def two_masses(aside: float, back: float = 0.0, *, springs: tuple[float, float] = (0.0, 0.0)) -> StateSpace:
    """Two masses of their own inputs and outputs, each on a spring; the place of the first one pushes the second one, and back."""
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[1, 0], A[3, 2] = -springs[0], -springs[1]
    A[3, 0], A[1, 2] = aside, back
    B, C = np.zeros((4, 2)), np.zeros((2, 4))
    B[1, 0] = B[3, 1] = 1.0
    C[0, 0] = C[1, 2] = 1.0
    return StateSpace(A, B, C)


@pytest.mark.parametrize(
    ("aside", "back", "springs"),
    [(1e-20, 0.0, (0.0, 0.0)), (-1e-16, 0.0, (0.0, 0.0)), (1e-20, 1e-20, (1.0, 2.0)), (1e-18, 3e-17, (0.5, 40.0))],
)
@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e9])
def test_couplings_next_to_nothing_couple_nothing(aside: float, back: float, springs: tuple[float, float], unit: float) -> None:
    """Whatever the unit of the second mass's place and force. (Without springs, two-way couplings are all there is.)"""
    sizes = np.array([1.0, 1.0, unit, unit])

    def in_units(model: StateSpace) -> StateSpace:
        B, C = model.B * sizes[:, None], model.C / sizes
        B[:, 1] /= 7.0 * unit
        return StateSpace(model.A * sizes[:, None] / sizes, B, C)

    found = unit_ratios(as_switched(in_units(two_masses(aside, back, springs=springs))))
    alone = unit_ratios(as_switched(in_units(two_masses(0.0, springs=springs))))
    assert np.all(np.abs(np.log2(found / alone)) <= 8.0)  # how fast integrators are, which is in these, is anyone's choice


def test_an_inverse_couples_what_the_plant_does_not() -> None:
    """The base of the cantilever may stand anywhere, and acts on nothing; where the tip is to be says where it is."""
    assert np.all(unit_ratios(as_switched(StateSpace(*cantilever_paper(0.0)))) > 0)


@pytest.mark.parametrize("thrust", [0.0, 1e-20, 1e-16])
def test_a_satellite_that_moves_by_metres_and_radians(thrust: float) -> None:
    """Turned as it is, rounding in thrusts that are to be zero pushes it aside: of place and attitude that makes nothing large."""
    plant = satellite()
    q = np.array([0.9, 0.3, -0.2, 0.4]) / np.linalg.norm([0.9, 0.3, -0.2, 0.4])
    there = plant.at(qpos=np.concatenate([[0.3, 1.0, 2.0], q]), ctrl=thrust * np.random.default_rng(0).normal(size=6))
    ratios = unit_ratios(as_switched(invtrack.linearize(plant, equilibrium=there)))
    assert 1e-4 < np.min(ratios) < np.max(ratios) < 1e4
