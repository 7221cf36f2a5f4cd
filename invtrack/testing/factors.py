"""Physical parameters that are off by named factors: the cases of a test."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

from invtrack.arguments import by_name, flag, items
from invtrack.arrays import real_number
from invtrack.errors import InvtrackError
from invtrack.simulation.parameter_factors import positive_factor

NOMINAL = "nominal"


def factor_cases(factors: Mapping[str, Sequence[float]], *, together: bool = False) -> dict[str, dict[str, float]]:
    """Factors by the names of parameters for each case of a test, by a readable name of the case.

    {"tip_mass": [0.9, 1.1]} makes "nominal", in which everything is as planned, "tip_mass-x0.9" and "tip_mass-x1.1". Parameters
    are off one at a time; `together`, in all combinations, 1 for each of them included.

    Raises InvtrackError for factors that are not positive and finite, named twice, or no list of numbers.
    """
    choices: dict[str, list[float]] = {}
    for name, given in by_name("factors", factors, expected="lists of factors by names of parameters", error=InvtrackError).items():
        listed = items(f"factors of {name!r}", given, expected="a list of factors such as [0.9, 1.1]", error=InvtrackError)
        values = [positive_factor(name, real_number(f"a factor of {name!r}", value, error=InvtrackError)) for value in listed]
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
