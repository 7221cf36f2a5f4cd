"""What a sweep keeps of one point."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from invtrack.arguments import by_name
from invtrack.arrays import Array, real_numbers, shown
from invtrack.errors import SweepError
from invtrack.sweeps.design import OWN_COLUMNS, Value

Number = float | bool | str | None
Status = Literal["completed", "diverged", "refused"]


@dataclass(frozen=True, eq=False)
class Outcome:
    """What came of one point, wherever it was computed.

    numbers: by name; None where one is not defined. traces: lists of numbers by name, such as the error over time.
    """

    status: Status
    reason: str = ""
    numbers: Mapping[str, Number] = field(default_factory=dict)
    traces: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Row:
    """One point of a sweep and what came of it.

    Args:
        index: number of the point in the design.
        point: values by the names of parameters.
        seed: what the study was given for everything random.
        status: "completed", "diverged" or "refused".
        reason: why it diverged or was refused; of a completed one, which numbers are not defined, and why.
        numbers: what was measured, in SI units; None where it is not defined.
        traces: lists (m,) of numbers, such as the errors at the sweep's `error_times`.
    """

    index: int
    point: Mapping[str, Value]
    seed: int
    status: Status
    reason: str
    numbers: Mapping[str, Number]
    traces: Mapping[str, Array]

    @classmethod
    def of(cls, index: int, point: Mapping[str, Value], seed: int, outcome: Outcome) -> Row:
        """The row of a point with this outcome. Raises SweepError where two things in it have one name."""
        names = [*OWN_COLUMNS, *point, *outcome.numbers, *outcome.traces]
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise SweepError(f"expected parameters and numbers under names of their own, got {', '.join(twice)} twice")
        return cls(index, point, seed, outcome.status, outcome.reason, outcome.numbers, outcome.traces)

    @cached_property
    def key(self) -> str:
        """What tells the row from all others of its study: a digest of point and seed."""
        return key_of(self.point, self.seed)

    @cached_property
    def digest(self) -> str:
        """Of everything that the row holds but its number in the design, bit for bit: by it damage is seen."""
        numbers = {name: _exact(value) for name, value in self.numbers.items() if value is not None}
        traces = {name: np.asarray(values, dtype="<f8").tobytes().hex() for name, values in self.traces.items()}
        return _digest([self.key, self.status, self.reason, numbers, traces])

    def equals(self, other: Row) -> bool:
        """Whether both are the same point with the same outcome, bit for bit."""
        return self.digest == other.digest


def key_of(point: Mapping[str, Value], seed: int) -> str:
    """The key of a row."""
    return _digest([{name: _exact(value) for name, value in point.items()}, seed])


def outcome_of(returned: object) -> Outcome:
    """What a study's function returned that is no run: numbers, texts, None, and lists of numbers, by name.

    Under "notes", as in the metrics of a run, it may say of some of them why they are None. Raises SweepError for anything else.
    """
    expected = "a RunResult, or numbers, texts and lists of numbers by their names"
    numbers: dict[str, Number] = {}
    traces: dict[str, Array] = {}
    found = dict(by_name("what the study returns", returned, expected=expected, error=SweepError))
    notes = by_name("notes that the study returns", found.pop("notes", {}), expected="texts by names of numbers", error=SweepError)
    for name, value in found.items():
        plain: Any = value.item() if isinstance(value, np.generic) else value
        if plain is None or isinstance(plain, (bool, str)):
            numbers[name] = plain
        elif isinstance(plain, (int, float)):
            numbers[name] = float(plain)
        elif isinstance(plain, (list, tuple, np.ndarray)):
            traces[name] = real_numbers(f"{name!r} that the study returns", plain, error=SweepError)
            if traces[name].ndim != 1:
                raise SweepError(f"{name!r} that the study returns must be a list of numbers (m,), got shape {traces[name].shape}")
        else:
            raise SweepError(f"the study must return {expected}, got {shown(value)} as {name!r}")
    undefined = [f"{name}: {notes[name]}" for name, value in numbers.items() if value is None and name in notes]
    return Outcome("completed", "; ".join(undefined), numbers, traces)


def _exact(value: Any) -> Any:
    """A value as JSON that keeps every bit and tells 1 from 1.0."""
    return {"float": value.hex()} if isinstance(value, float) else value


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:32]
