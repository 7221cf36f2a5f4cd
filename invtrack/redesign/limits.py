"""Hard limits of a plan, as a user states them and as rows of numbers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers, real_vector, shown
from invtrack.channels import Channels
from invtrack.errors import RedesignError
from invtrack.linear.switched import SwitchedSystem

Range = ArrayLike | tuple[ArrayLike, ArrayLike]
"""A number or one per channel: |value| at most that. A tuple (low, high) of two such: low <= value <= high."""

Kind = Literal["input", "input rate", "path"]

StateRow = Mapping[str, float] | ArrayLike
"""Weights by state names, {"th1": 1.0, "th2": -1.0}, or one number per state."""


@dataclass(frozen=True)
class StateLimit:
    """low <= sum of row[name] x_name <= high for a combination of states, for instance the twist {"th1": 1.0, "th2": -1.0}.

    row: weights by state names (or one per state), of the states as deviations from the operating point (that before all jumps,
    where these move it). limit: a positive number for +-limit, or a tuple (low, high), in the units of the combination. name: what
    messages call it.

    Raises RedesignError for what is no name, and for weights and limits that are not numbers.
    """

    name: str
    row: StateRow
    limit: float | tuple[float, float]

    def __post_init__(self) -> None:
        """Checks everything that does not need a model."""
        if not isinstance(self.name, str) or not self.name:
            raise RedesignError(f"StateLimit(name=...) must be a text, by which messages call the limit, got {shown(self.name)}")
        weights = list(self.row.values()) if isinstance(self.row, Mapping) else self.row
        numbers = real_numbers(f"the weights of {self.name!r}", weights, error=RedesignError)
        if numbers.ndim != 1 or not np.all(np.isfinite(numbers)):
            raise RedesignError(f"the weights of {self.name!r} must be finite, one for each state, got {shown(self.row)}")
        _require_range(self.name, self.limit)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """Hard limits of a plan; whatever is not stated is free, and so is everything whose limit is infinite.

    input: absolute, in the units of the inputs (of an actuator: what it can deliver, trim included). input_rate: of its change per
    second; with it the input does not jump either. output: absolute, of the planned output. Each is a number or an array-like with
    one per channel for +-that, or a tuple (low, high) of two such. states: limits on combinations of states, as deviations.

    Raises RedesignError for limits that are not numbers, and states limits that are none or share a name.
    """

    input: Range = np.inf
    input_rate: Range = np.inf
    output: Range = np.inf
    states: Sequence[StateLimit] = ()

    def __post_init__(self) -> None:
        """Checks everything that does not need a model."""
        for name in ("input", "input_rate", "output"):
            _require_range(name, getattr(self, name))
        if not isinstance(self.states, Sequence) or not all(isinstance(each, StateLimit) for each in self.states):
            raise RedesignError(
                "Limits(states=...) must be a list of StateLimits such as "
                f"[invtrack.StateLimit('twist', {{'th1': 1.0, 'th2': -1.0}}, 0.1)], got {shown(self.states)}"
            )
        names = [each.name for each in self.states]
        if len(set(names)) != len(names):
            raise RedesignError(f"each StateLimit needs a name of its own, which messages call it by, got {names}")


@dataclass(frozen=True, eq=False)
class Bound:
    """low <= row [x; u; y] <= high, of deviations; for an input's rate, of the derivative of [x; u; y].

    Args:
        name: what messages call it.
        kind: an input and its rate keep their limits at every instant, a "path" of outputs or states where it is imposed.
        row: (n + 2 p,).
        low: smallest value, or minus infinity.
        high: largest value, or infinity.
        offset: the row's value at the operating point, so that absolute limits are low + offset and high + offset.
        unit: of the row's value, "" where it is not known.
        switch_times: of the plant (N,) [s].
        rest: the row's value where each interval is at rest, less that of the first (N + 1,).
    """

    name: str
    kind: Kind
    row: Array
    low: float
    high: float
    offset: float = 0.0
    unit: str = ""
    switch_times: Array = field(default_factory=lambda: np.zeros(0))
    rest: Array = field(default_factory=lambda: np.zeros(1))

    @property
    def size(self) -> float:
        """The larger of its finite sides: what a miss is measured against."""
        return max(abs(side) for side in (self.low, self.high) if np.isfinite(side))

    def rest_at(self, inside: Array) -> Array:
        """What is to be added to deviations from the rest in force at these times [s], for them to be held against low and high."""
        return np.asarray(self.rest[np.searchsorted(self.switch_times, inside, side="right")])

    def excess(self, values: Array) -> Array:
        """How far values lie outside, as a share of the size; negative inside."""
        return np.asarray(np.maximum(values - self.high, self.low - values) / self.size)

    def __str__(self) -> str:
        low, high = self.low + self.offset, self.high + self.offset
        return f"{self.name} between {low:.6g} and {high:.6g}"


def bounds_of(limits: Limits, plant: SwitchedSystem) -> tuple[Bound, ...]:
    """The limits as rows of [x; u; y], those that are infinite left out.

    Raises RedesignError for what is no Limits, for limits of the wrong shape, not positive or with low >= high, for names of states
    that the model does not have, and where nothing is limited at all.
    """
    if not isinstance(limits, Limits):
        raise RedesignError(f"expected limits such as invtrack.Limits(input=5.0), got {shown(limits)}")
    n, m, p, point = plant.n_states, plant.n_inputs, plant.n_outputs, plant.operating_point
    kinds: tuple[tuple[Kind, str, Range, Channels, int, Array], ...] = (
        ("input", "input", limits.input, plant.inputs, n, point.u0),
        ("input rate", "input_rate", limits.input_rate, plant.inputs, n, np.zeros(m)),
        ("path", "output", limits.output, plant.outputs, n + m, point.y0),
    )
    rows, found = np.eye(n + m + p), []
    for kind, name, value, channels, first, offset in kinds:
        low, high = _sides(name, value, len(channels), f"{name.partition('_')[0]}s {list(channels.names)}")
        title, per = ("rate of input", "/s") if kind == "input rate" else (name, "")
        found += [
            Bound(
                name=f"{title} {channel!r}",
                kind=kind,
                row=rows[first + i],
                low=float(low[i] - offset[i]),
                high=float(high[i] - offset[i]),
                offset=float(offset[i]),
                unit=unit and unit + per,
                switch_times=plant.switch_times,
                rest=np.zeros(len(plant)) if kind == "input rate" else _rest_along(rows[first + i], plant),
            )
            for i, (channel, unit) in enumerate(zip(channels.names, channels.units, strict=True))
        ]
    found += [_state_bound(limit, plant) for limit in limits.states]
    finite = tuple(bound for bound in found if np.isfinite(bound.low) or np.isfinite(bound.high))
    if not finite:
        raise RedesignError(
            "expected at least one finite limit, got none; give Limits an input, input_rate, output or states, or, without limits, "
            "use invtrack.quadratic_redesign"
        )
    return finite


def _state_bound(limit: StateLimit, plant: SwitchedSystem) -> Bound:
    row = np.append(state_row(limit.name, limit.row, plant), np.zeros(plant.n_inputs + plant.n_outputs))
    low, high = _sides(limit.name, limit.limit, 1, "combination of states")
    units = {unit for unit, weight in zip(plant.states.units, row, strict=False) if weight != 0}
    unit = units.pop() if len(units) == 1 else ""
    rest = _rest_along(row, plant)
    return Bound(repr(limit.name), "path", row, float(low[0]), float(high[0]), 0.0, unit, plant.switch_times, rest)


def _rest_along(row: Array, plant: SwitchedSystem) -> Array:
    """A row's value where each interval is at rest, less that of the first (N + 1,)."""
    rest = np.hstack([plant.rest_states, plant.rest_inputs, plant.rest_outputs]) @ row
    return np.asarray(rest - rest[0])


def _sides(name: str, value: Range, size: int, meaning: str) -> tuple[Array, Array]:
    """Lowest and highest value of each channel, both (size,)."""
    pair = isinstance(value, tuple)
    low, high = (_channels(name, side, size, meaning) for side in (value if isinstance(value, tuple) else (value, value)))
    if not pair:
        low = -high
    if np.any(high <= low):
        wrong = f"low {low.tolist()}, high {high.tolist()}" if pair else f"{high.tolist()}"
        expected = "each low below its high" if pair else "positive numbers"
        raise RedesignError(f"limit {name!r}: expected {expected}, got {wrong}; leave out what is to be free, or say infinity")
    return low, high


def _channels(name: str, value: ArrayLike, size: int, meaning: str) -> Array:
    array = np.asarray(value, dtype=float)
    if array.shape not in ((), (size,)):
        raise RedesignError(f"limit {name!r}: expected a number or {size} for the {meaning}, got shape {array.shape}")
    return np.asarray(array * np.ones(size))


def _require_range(name: str, value: Range) -> None:
    """Raises RedesignError for what is neither real numbers nor a tuple (low, high) of two such, and for NaN among them."""
    if isinstance(value, tuple) and len(value) != 2:
        raise RedesignError(f"limit {name!r}: expected a tuple (low, high) of two, got {len(value)} entries")
    for side in value if isinstance(value, tuple) else (value,):
        array = real_numbers(f"limit {name!r}", side, error=RedesignError)
        if np.any(np.isnan(array)):
            raise RedesignError(f"limit {name!r} has entries that are not numbers: {array.tolist()}")


def state_row(name: str, row: StateRow, plant: SwitchedSystem) -> Array:
    """The row (n,) that the states, as deviations from the operating point, are multiplied with.

    Raises RedesignError for states that do not exist, another number of weights than states, and weights that are not finite or
    all zero. `name` is what the message calls the combination.
    """
    states = plant.states.names
    if isinstance(row, Mapping):
        unknown = [state for state in row if state not in states]
        if unknown or not row:
            raise RedesignError(
                f"{name!r}: expected weights of some of the states {list(states)}, got {dict(row)}"
                + (f", of which {unknown} are unknown" if unknown else "")
            )
        row = [row.get(state, 0.0) for state in states]
    values = real_vector(f"the weights of {name!r}", row, states, error=RedesignError)
    if not np.any(values):
        raise RedesignError(f"the weights of {name!r} must not all be zero, got {values.tolist()}")
    return values
