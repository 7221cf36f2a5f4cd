"""Relative degree and zeros of published plants, for every choice of outputs, against exact arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.errors import RelativeDegreeError
from invtrack.linear import relative_degree, zeros
from tests.linear.random_plants import assert_same_set
from tests.published.library import NO_VECTOR_RELATIVE_DEGREE_IN_A_CHOICE, PLANTS, cases
from tests.published.plant import Choice, PublishedPlant

ACCURACY = 1e-8
"""Of a zero, as a share of the fastest pole or zero."""


def assert_right_zeros(plant: PublishedPlant, choice: Choice) -> None:
    right = plant.exact.zeros(*choice)
    assert right is not None
    size = max(float(np.max(np.abs(part), initial=0.0)) for part in (right, plant.exact.poles))
    assert_same_set(zeros(plant.square(choice)), right, ACCURACY * max(size, 1.0))


@pytest.mark.parametrize("plant", cases(PLANTS))
def test_every_choice_with_a_vector_relative_degree(plant: PublishedPlant) -> None:
    for choice in plant.choices:
        right = plant.exact.relative_degree(*choice)
        if right is not None:
            assert relative_degree(plant.square(choice)) == right
            assert_right_zeros(plant, choice)


@pytest.mark.parametrize("plant", cases(NO_VECTOR_RELATIVE_DEGREE_IN_A_CHOICE))
def test_every_choice_without_one_is_told(plant: PublishedPlant) -> None:
    without = [choice for choice in plant.choices if plant.exact.relative_degree(*choice) is None]
    assert without
    for choice in without:
        with pytest.raises(RelativeDegreeError):
            relative_degree(plant.square(choice))


@pytest.mark.parametrize("plant", cases(NO_VECTOR_RELATIVE_DEGREE_IN_A_CHOICE))
def test_every_choice_without_one_has_its_zeros(plant: PublishedPlant) -> None:
    """All ten choices of the J-100's outputs, and 16 of the ammonia reactor's."""
    for choice in plant.choices:
        if plant.exact.relative_degree(*choice) is None and plant.exact.zeros(*choice) is not None:
            assert_right_zeros(plant, choice)


@pytest.mark.parametrize("plant", cases(PLANTS))
def test_every_choice_with_a_singular_transfer_matrix_is_refused(plant: PublishedPlant) -> None:
    for choice in plant.choices:
        if plant.exact.zeros(*choice) is None:
            with pytest.raises(RelativeDegreeError):
                zeros(plant.square(choice))
