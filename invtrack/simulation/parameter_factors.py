"""Physical parameters that are off by factors: the plant and the schedule that a run then has."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.plans.plan import Plan
from invtrack.plant.parameters import Change, ElementParameter, ordered, parameter_at
from invtrack.plant.plant import Plant

BEFORE_ALL = 1e9
"""[s] before anything that happens: a change at that time holds from the start of every run on."""


def with_factors(
    plant: Plant, plan: Plan, factors: Mapping[str, float], options: Mapping[str, Any]
) -> tuple[Plant, dict[str, Any]]:
    """The plant, and the options of `invtrack.simulate`, of a run in which parameters have so many times their values.

    What the controller was planned for stays as it is; the real values differ, over the whole run and through every change, those
    of the plan or of a schedule among the options. Parameters are named as the plant names them, or by their path.

    Raises PlantError for a parameter that does not exist, InvtrackError for a factor that is not positive and finite.
    """
    named = {}
    for name, value in factors.items():
        plant, known = with_parameter(plant, name)
        named[known] = positive_factor(name, value)
    schedule = options.get("schedule")
    if schedule is None:
        initial = {**plant.parameter_values, **plan.model.parameters}
        changes = [Change(time, **values) for time, values in plan.schedule]
    else:
        initial, changes = plant.parameter_values, ordered(schedule)
    first = min([plan.manoeuvre[0], *(change.time for change in changes)]) - BEFORE_ALL
    scaled = [Change(first, **initial), *changes]
    return plant, {**options, "schedule": [_scaled(change, named) for change in scaled]}


def _scaled(change: Change, factors: Mapping[str, float]) -> Change:
    return Change(change.time, **{name: factors.get(name, 1.0) * value for name, value in change.parameters.items()})


def with_parameter(plant: Plant, name: str) -> tuple[Plant, str]:
    """The plant with a parameter of this name or path, and what it calls it. Raises PlantError for one that does not exist."""
    if name in plant.parameters:
        return plant, name
    parameter = parameter_at(name, plant.model)
    for known, other in plant.parameters.items():
        if isinstance(other, ElementParameter) and other.identity == parameter.identity:
            return plant, known
    channels = plant.parameter_channels
    added = Channels([*channels.names, name], [*channels.units, parameter.unit(plant.model)])
    return replace(plant, parameters={**plant.parameters, name: parameter}, parameter_channels=added), name


def positive_factor(name: str, value: float) -> float:
    """The factor; raises InvtrackError unless it is positive and finite."""
    if not (value > 0 and math.isfinite(value)):
        raise InvtrackError(f"a factor of {name!r} must be positive and finite, got {value}")
    return float(value)
