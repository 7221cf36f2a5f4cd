"""Programs of a few lines that are run and printed from the same data, so that what is shown is what was done."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from invtrack.baselines import approximate_inverse, base_servo, feedback_tracking, shaper
from invtrack.control import TrackingController, bryson, lqr
from invtrack.inversion import causal_inverse, invert, modified_inversion, steady_state_feedforward
from invtrack.plant import linearize
from invtrack.redesign import Limits, StateLimit, constrained_redesign, quadratic_redesign
from invtrack.references import rest_to_rest
from invtrack.simulation import LinearPlant, simulate

DOORS: dict[str, Callable[..., Any]] = {
    "invtrack.LinearPlant": LinearPlant,
    "invtrack.TrackingController": TrackingController,
    "invtrack.baselines.approximate_inverse": approximate_inverse,
    "invtrack.baselines.base_servo": base_servo,
    "invtrack.baselines.feedback_tracking": feedback_tracking,
    "invtrack.baselines.shaper": shaper,
    "invtrack.bryson": bryson,
    "invtrack.causal_inverse": causal_inverse,
    "invtrack.constrained_redesign": constrained_redesign,
    "invtrack.inversion.steady_state_feedforward": steady_state_feedforward,
    "invtrack.invert": invert,
    "invtrack.linearize": linearize,
    "invtrack.lqr": lqr,
    "invtrack.modified_inversion": modified_inversion,
    "invtrack.quadratic_redesign": quadratic_redesign,
    "invtrack.rest_to_rest": rest_to_rest,
    "invtrack.simulate": simulate,
}
"""What lines may call, by what a program calls it."""

DIGITS = 4
"""Significant digits of the numbers that are chosen: weights, scales, times."""


LINE = 100
"""Characters of a line at most; a longer one has each argument on a line of its own."""


@dataclass(frozen=True)
class Name:
    """A name that an earlier line, or the user, has given to something."""

    text: str


@dataclass(frozen=True)
class Line:
    """target = call(*arguments, **options).

    Args:
        target: one name, or several separated by commas.
        call: one of DOORS, or a method of something named before, as "shaper.shaped".
        arguments, options: numbers, texts, lists, dicts, Limits, or Names.
    """

    target: str
    call: str
    arguments: Sequence[Any] = ()
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """As it is written in a program."""
        words = [*map(literal, self.arguments), *(f"{name}={literal(value)}" for name, value in self.options.items())]
        line = f"{self.target} = {self.call}({', '.join(words)})"
        if len(line) <= LINE:
            return line
        return f"{self.target} = {self.call}(\n" + "".join(f"    {word},\n" for word in words) + ")"

    def run(self, names: dict[str, Any], **unwritten: Any) -> None:
        """Call it with the names known so far, and keep what it returns under its own. `unwritten`: options that change nothing."""
        head, _, attribute = self.call.partition(".")
        function = getattr(names[head], attribute) if head in names else DOORS[self.call]
        given = [names[value.text] if isinstance(value, Name) else value for value in self.arguments]
        options = {key: names[value.text] if isinstance(value, Name) else value for key, value in self.options.items()}
        value = function(*given, **options, **unwritten)
        targets = [target.strip() for target in self.target.split(",")]
        names.update(zip(targets, value if len(targets) > 1 else [value], strict=True))


def rounded(values: Any) -> Any:
    """A number, or nested lists of numbers, to DIGITS significant digits."""
    if np.ndim(values):
        return [rounded(value) for value in np.asarray(values).tolist()]
    return float(f"{float(values):.{DIGITS - 1}e}")


def decimal(values: Any) -> Any:
    """A number, or a list of them, without the rounding of the last digits that sums leave."""
    return [decimal(value) for value in np.asarray(values).tolist()] if np.ndim(values) else float(f"{float(values):.12g}")


def literal(value: Any) -> str:
    """The value as it is written in a program."""
    if isinstance(value, Name):
        return value.text
    if isinstance(value, Limits):
        stated = {name: getattr(value, name) for name in ("input", "input_rate", "output")}
        words = [f"{name}={_side(side)}" for name, side in stated.items() if np.any(np.isfinite(np.asarray(side, dtype=float)))]
        states = [f"invtrack.StateLimit({each.name!r}, {literal(_row(each))}, {each.limit!r})" for each in value.states]
        words += ["states=[" + ", ".join(states) + "]"] if states else []
        return "invtrack.Limits(" + ", ".join(words) + ")"
    if isinstance(value, np.ndarray):
        return literal(value.tolist())
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{name!r}: {literal(each)}" for name, each in value.items()) + "}"
    if isinstance(value, tuple):
        return "(" + ", ".join(map(literal, value)) + ("," if len(value) == 1 else "") + ")"
    if isinstance(value, list):
        return "[" + ", ".join(map(literal, value)) + "]"
    if isinstance(value, float) and not np.isfinite(value):
        return f'float("{value}")'
    return repr(value)


def _row(limit: StateLimit) -> Any:
    return dict(limit.row) if isinstance(limit.row, Mapping) else np.asarray(limit.row, dtype=float)


def _side(side: Any) -> str:
    if isinstance(side, tuple):
        return literal(tuple(np.asarray(each, dtype=float).tolist() for each in side))
    return literal(np.asarray(side, dtype=float).tolist())
