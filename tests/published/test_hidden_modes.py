"""Which zeros of published plants are hidden modes, and what the others cost in preactuation, against exact arithmetic."""

from __future__ import annotations

import numpy as np
import pytest

from invtrack.linear import ZeroReport, zero_report
from tests.linear.random_plants import assert_same_set
from tests.published.library import NO_VECTOR_RELATIVE_DEGREE, PLANTS, SINGULAR, cases
from tests.published.plant import Choice, PublishedPlant

INVERTIBLE = [plant for plant in PLANTS if plant not in SINGULAR]


def assert_right_modes(plant: PublishedPlant, choice: Choice, report: ZeroReport) -> None:
    outputs, inputs = choice
    size = max(float(np.max(np.abs(plant.exact.poles))), 1.0)
    unreached = [zero.value for zero in report.zeros if zero.uncontrollable]
    unseen = [zero.value for zero in report.hidden if zero.kind != "uncontrollable mode"]
    assert_same_set(unreached, plant.exact.uncontrollable_modes(inputs), 1e-8 * size)
    assert_same_set(unseen, plant.exact.unobservable_modes(outputs), 1e-8 * size)


@pytest.mark.parametrize("plant", cases(INVERTIBLE))
def test_hidden_modes(plant: PublishedPlant) -> None:
    """The J-100 with a sensor unused, gusts in the transport aircraft, a bed of the ammonia reactor behind the outputs."""
    choices = plant.choices if plant.exact.n < 15 and plant not in NO_VECTOR_RELATIVE_DEGREE else [plant.chosen]
    for choice in choices:
        if choice == plant.chosen or plant.exact.relative_degree(*choice) is not None:
            assert_right_modes(plant, choice, zero_report(plant.square(choice)))


@pytest.mark.parametrize("plant", cases(INVERTIBLE))
def test_preactuation_follows_from_the_slowest_zero_on_the_right(plant: PublishedPlant) -> None:
    right = plant.exact.zeros(*plant.chosen)
    assert right is not None
    rates = right.real[right.real > 1e-12 * np.abs(right)]
    expected = np.log(100.0) / np.min(rates) if rates.size else 0.0
    assert zero_report(plant.square()).preactuation_time == pytest.approx(expected, rel=1e-9)
