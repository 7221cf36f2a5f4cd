"""Physical parameters that are off by named factors: the cases of a test, and the plant and schedule that a run then has."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from invtrack.arguments import by_name, flag, items
from invtrack.arrays import real_number
from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.plans.plan import Plan
from invtrack.plant.parameters import Change, ElementParameter, ordered, parameter_at
from invtrack.plant.plant import Plant

NOMINAL = "nominal"

BEFORE_ALL = 1e9
"""[s] before anything that happens: a change at that time holds from the start of every run on."""


def factor_cases(factors: Mapping[str, Sequence[float]], *, together: bool = False) -> dict[str, dict[str, float]]:
    """Factors by the names of parameters for each case of a test, by a readable name of the case.

    {"tip_mass": [0.9, 1.1]} makes "nominal", in which everything is as planned, "tip_mass-x0.9" and "tip_mass-x1.1". Parameters
    are off one at a time; `together`, in all combinations, 1 for each of them included.

    Raises InvtrackError for factors that are not positive and finite, named twice, or no list of numbers.
    """
    choices: dict[str, list[float]] = {}
    for name, given in by_name("factors", factors, expected="lists of factors by names of parameters", error=InvtrackError).items():
        listed = items(f"factors of {name!r}", given, expected="a list of factors such as [0.9, 1.1]", error=InvtrackError)
        values = [_factor(name, real_number(f"a factor of {name!r}", value, error=InvtrackError)) for value in listed]
        if len(set(values)) != len(values):
            raise InvtrackError(f"the factors of {name!r} must be distinct, got {values}")
        choices[name] = [value for value in values if value != 1]
    if flag("together", together, error=InvtrackError):
        combined = itertools.product(*([1.0, *values] for values in choices.values()))
        cases = [dict(zip(choices, values, strict=True)) for values in combined]
    else:
        cases = [{}, *({name: value} for name, values in choices.items() for value in values)]
    off = [{name: value for name, value in case.items() if value != 1} for case in cases]
    return {case_name(case): case for case in off}


def case_name(factors: Mapping[str, float]) -> str:
    """A case by its factors, "tip_mass-x0.9+arm_mass-x1.1", which pytest's -k takes; "nominal" where there are none."""
    return "+".join(f"{name}-x{value!r}" for name, value in factors.items()) or NOMINAL


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
        plant, known = _with_parameter(plant, name)
        named[known] = _factor(name, value)
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


def _with_parameter(plant: Plant, name: str) -> tuple[Plant, str]:
    """The plant with a parameter of this name or path, and what it calls it."""
    if name in plant.parameters:
        return plant, name
    parameter = parameter_at(name, plant.model)
    for known, other in plant.parameters.items():
        if isinstance(other, ElementParameter) and other.identity == parameter.identity:
            return plant, known
    channels = plant.parameter_channels
    added = Channels([*channels.names, name], [*channels.units, parameter.unit(plant.model)])
    return replace(plant, parameters={**plant.parameters, name: parameter}, parameter_channels=added), name


def _factor(name: str, value: float) -> float:
    if not (value > 0 and math.isfinite(value)):
        raise InvtrackError(f"a factor of {name!r} must be positive and finite, got {value}")
    return float(value)
