"""The weights with which a redesign takes of the acceptable error what it may: the dearest ones, wherever the search begins."""

from __future__ import annotations

import numpy as np
import pytest

import invtrack
from invtrack.advice.task import Task
from invtrack.advice.weights import LEAST, MOST, ROOM, corrected, planned_error, redesign_weights, weights
from invtrack.errors import RedesignError
from tests.advice.plants import crane


def task(reference: invtrack.PiecewiseSignal) -> Task:
    options = {"limits": None, "parameter_errors": 0.0, "max_preactuation": None, "timestep": 1e-2}
    return Task.of(crane(), reference, error=0.01, **options)


def test_the_same_weights_are_found_from_anywhere_and_no_dearer_ones_would_do() -> None:
    share = 0.01
    reference = invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=2)
    asked = task(reference)
    found = {redesign_weights(asked, reference, {}, share=share, guess=guess)[0] for guess in (None, -40, MOST)}
    assert len(found) == 1
    (number,) = found
    errors = [
        planned_error(asked, invtrack.quadratic_redesign(crane(), reference, **weights(asked, number + more))) for more in (0, 1)
    ]
    assert errors[0] <= ROOM * share < errors[1]


def test_what_no_weights_do_is_refused() -> None:
    reference = invtrack.rest_to_rest(0.0, 1.0, 3.0, smoothness=2)
    with pytest.raises(RedesignError, match=r"no weights bring the planned error to 0.95 % of the motion; .* it is 10 %; allow"):
        redesign_weights(task(reference), reference, {LEAST: -1.0}, share=0.01)


def test_weights_are_corrected_where_the_motion_misses_by_more_or_much_less() -> None:
    assert corrected(-30, 0.9 * ROOM * 0.01, share=0.01) == -30
    # An error grows as the root of the weight: four times the error takes a sixteenth of it.
    assert corrected(-30, 4 * ROOM * 0.01, share=0.01) == -30 - int(np.ceil(10 * np.log10(16)))
    assert corrected(-30, ROOM * 0.01 / 4, share=0.01) > -30
