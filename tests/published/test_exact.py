"""The right values of these tests are right: polynomials whose roots are known, plants that can be read off."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial import Polynomial

from tests.linear.random_plants import assert_same_set
from tests.published.exact import ExactPlant
from tests.published.library import PLANTS
from tests.published.plant import PublishedPlant
from tests.published.polynomials import roots


def test_roots_of_wilkinsons_polynomial() -> None:
    """Double precision finds them to one digit; the coefficients have up to 19."""
    coefficients = [1]
    for root in range(1, 21):
        coefficients = [a - root * b for a, b in zip([0, *coefficients], [*coefficients, 0], strict=True)]
    np.testing.assert_allclose(np.sort(roots(coefficients).real), np.arange(1, 21), rtol=4e-16)


def test_roots_as_often_as_they_occur() -> None:
    """s^2 (s - 1)^3 (3 s + 1)^2 (s^2 + 2 s + 5)."""
    product = Polynomial([1.0])
    for factor in ([0, 0, 1], *[[-1, 1]] * 3, *[[1, 3]] * 2, [5, 2, 1]):
        product = product * Polynomial(factor)
    found = roots([round(value) for value in product.coef])
    assert_same_set(found, [0, 0, 1, 1, 1, -1 / 3, -1 / 3, -1 + 2j, -1 - 2j], 1e-15)


def test_hidden_modes_can_be_read_off_a_diagonal_plant() -> None:
    plant = ExactPlant(np.diag([1.0, 2.0, 3.0, 3.0]), [[1], [0], [1], [0]], [[1, 1, 0, 0]], [[0]])
    assert_same_set(plant.poles, [1, 2, 3, 3], 0.0)
    assert_same_set(plant.uncontrollable_modes((0,)), [2, 3], 0.0)
    assert_same_set(plant.unobservable_modes((0,)), [3, 3], 0.0)
    zeros = plant.zeros((0,), (0,))
    assert zeros is not None
    assert_same_set(zeros, [2, 3, 3], 0.0)
    assert plant.relative_degree((0,), (0,)) == (1,)


def test_an_output_that_no_input_reaches_has_no_zeros() -> None:
    plant = ExactPlant(np.diag([1.0, 2.0]), [[1], [0]], [[0, 1]], [[0]])
    assert plant.zeros((0,), (0,)) is None
    assert plant.relative_degree((0,), (0,)) is None


@pytest.mark.parametrize("plant", PLANTS, ids=str)
def test_poles_are_the_eigenvalues(plant: PublishedPlant) -> None:
    """Rounding moves a pole of multiplicity m by the m-th root of eps; fifteen integrators keep theirs, in whole numbers."""
    A, *_ = plant.matrices
    poles = plant.exact.poles
    assert_same_set(np.linalg.eigvals(A), poles, 1e-6 * max(float(np.max(np.abs(poles))), 1.0))
