"""All published plants, and which of them wait for what the package cannot do yet."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import pytest

from tests.published.aircraft import AIRCRAFT, ASTOVL, L1011
from tests.published.engines import ENGINES, GAS_TURBINE, J100
from tests.published.helicopters import HELICOPTERS
from tests.published.mechanisms import MECHANISMS, SPACE_STRUCTURE
from tests.published.plant import PublishedPlant
from tests.published.processes import AMMONIA_REACTOR, BATCH_REACTOR, DRUM_BOILER, PROCESSES
from tests.published.textbook import EMAMI_3, EMAMI_4, EMAMI_6, EMAMI_7, TEXTBOOK

PLANTS: tuple[PublishedPlant, ...] = (*AIRCRAFT, *HELICOPTERS, *PROCESSES, *ENGINES, *MECHANISMS, *TEXTBOOK)

SINGULAR = (EMAMI_6, EMAMI_7)
"""Plants with an output that no input reaches."""

ZEROS_ON_THE_AXIS = (L1011, ASTOVL, SPACE_STRUCTURE)
"""Plants with zeros at the origin: rates as outputs, or an attitude that the outputs do not depend on."""

# The transfer matrix is invertible, but B_y is singular: for the outputs to invert, and for some other choice of them.
NO_VECTOR_RELATIVE_DEGREE = (J100, GAS_TURBINE, DRUM_BOILER, EMAMI_3, EMAMI_4)
NO_VECTOR_RELATIVE_DEGREE_IN_A_CHOICE = (*NO_VECTOR_RELATIVE_DEGREE, AMMONIA_REACTOR, BATCH_REACTOR)


def cases(plants: Iterable[PublishedPlant]) -> list[Any]:
    """The plants as parameters of a test."""
    return [pytest.param(plant, id=plant.name) for plant in plants]
