"""Linear systems whose matrices jump at known times."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, Indices, increasing_times, real_numbers
from invtrack.channels import Channels
from invtrack.errors import ModelError
from invtrack.linear.state_space import OperatingPoint, StateSpace, as_state_space

T = TypeVar("T")

SAME_POINT = 1e-9
"""Entries of two configurations that differ by no more, absolutely or as a share, are the same to rounding."""

SHOWN_TIMES = 5
"""Switch times that a line tells."""


@dataclass(frozen=True, eq=False, repr=False)
class SwitchedSystem:
    """A, B, C, D constant between known switch times t_1 < ... < t_N [s]; the state is continuous at a switch.

    x' = A_k (x - rest_k) + B_k (u - u0_k), y = y0_k + C_k (x - rest_k) + D_k (u - u0_k): each interval has its own equilibrium,
    which a payload that is picked up moves. All states x are measured from the x0 of the first interval.

    systems: N + 1 models of the same states, inputs and outputs, for values of the same physical parameters; switch_times: (N,),
    may be empty. Models with an x0 of their own (n,) are put into the frame of the first one: `systems` has them with its x0, and
    with their `rest` as much moved.
    distinct: the models without repetition; numbers (N + 1,): which of them each interval has.
    Interval k reaches from t_k to t_(k+1), the first from -infinity and the last to infinity (Devasia, Paden, Rossi 1996, eq. 1).

    Raises ModelError where the numbers do not fit, times do not increase, or states are measured from different x0 that are longer
    than the state (a mechanism's configurations, of which the plain difference is no state).
    """

    systems: tuple[StateSpace, ...]
    switch_times: Array
    distinct: tuple[StateSpace, ...] = field(init=False)
    numbers: Indices = field(init=False)

    def __init__(self, systems: Sequence[Any], switch_times: ArrayLike = ()) -> None:
        given = items("systems", systems, expected="a list of models, one for each interval", error=ModelError)
        models = tuple(as_state_space(system) for system in given)
        times = increasing_times("switch times", switch_times, error=ModelError)
        if len(models) != len(times) + 1:
            raise ModelError(f"expected one more system than switch times, got {len(models)} systems and {len(times)} switch times")
        for k, model in enumerate(models[1:], start=1):
            _require_same_channels(models[0], model, k)
        framed = {id(model): _in_frame(model, models[0], k) for k, model in enumerate(models)}
        models = tuple(framed[id(model)] for model in models)
        times.setflags(write=False)
        object.__setattr__(self, "systems", models)
        object.__setattr__(self, "switch_times", times)
        distinct = {id(model): model for model in models}
        place = {key: number for number, key in enumerate(distinct)}
        object.__setattr__(self, "distinct", tuple(distinct.values()))
        object.__setattr__(self, "numbers", np.array([place[id(model)] for model in models], dtype=np.intp))

    def __len__(self) -> int:
        """Number of intervals N + 1."""
        return len(self.systems)

    def map(self, function: Callable[[StateSpace], T]) -> tuple[T, ...]:
        """function(system) of each interval, worked out once for each distinct model: intervals that share one share the result."""
        results = [function(model) for model in self.distinct]
        return tuple(results[number] for number in self.numbers)

    def is_endless(self, system: StateSpace) -> bool:
        """Whether one of the models holds before the first or after the last switch, for ever."""
        return system is self.systems[0] or system is self.systems[-1]

    def __repr__(self) -> str:
        """What it is, without its matrices."""
        if not len(self.switch_times):
            return f"<SwitchedSystem that does not switch: {repr(self.systems[0])[1:-1]}>"
        times = ", ".join(f"{time:.6g}" for time in self.switch_times[:SHOWN_TIMES])
        more = f" and {len(self.switch_times) - SHOWN_TIMES} later times" if len(self.switch_times) > SHOWN_TIMES else ""
        return f"<SwitchedSystem that switches at {times} s{more}, from {repr(self.systems[0])[1:-1]}>"

    @property
    def n_states(self) -> int:
        """Number of states n."""
        return self.systems[0].n_states

    @property
    def n_inputs(self) -> int:
        """Number of inputs m."""
        return self.systems[0].n_inputs

    @property
    def n_outputs(self) -> int:
        """Number of outputs p."""
        return self.systems[0].n_outputs

    @property
    def input_limits(self) -> Array:
        """Smallest and largest value of each input that every interval allows (m, 2), absolute."""
        limits = np.array([system.input_limits for system in self.distinct])
        return np.column_stack([np.max(limits[:, :, 0], axis=0), np.min(limits[:, :, 1], axis=0)])

    @property
    def states(self) -> Channels:
        """The states, the same in every interval."""
        return self.systems[0].states

    @property
    def inputs(self) -> Channels:
        """The inputs, the same in every interval."""
        return self.systems[0].inputs

    @property
    def outputs(self) -> Channels:
        """The outputs, the same in every interval."""
        return self.systems[0].outputs

    @property
    def measurements(self) -> Channels:
        """What a controller can measure, as the first interval calls it."""
        return self.systems[0].measurement.channels

    @property
    def operating_point(self) -> OperatingPoint:
        """The point about which the first interval holds; all states are measured from its x0."""
        return self.systems[0].operating_point

    @cached_property
    def rest_states(self) -> Array:
        """The state in which each interval is at rest (N + 1, n)."""
        return np.array([system.rest for system in self.systems])

    @cached_property
    def rest_inputs(self) -> Array:
        """The input at which each interval is at rest (N + 1, p)."""
        return np.array([system.operating_point.u0 for system in self.systems])

    @cached_property
    def rest_outputs(self) -> Array:
        """The output at which each interval is at rest (N + 1, p)."""
        return np.array([system.operating_point.y0 for system in self.systems])

    @cached_property
    def shifts(self) -> Array:
        """By how much the deviation of the state from rest jumps at each switch, since the state does not (N, n)."""
        return np.asarray(-np.diff(self.rest_states, axis=0))

    @cached_property
    def rests_in_one_place(self) -> bool:
        """Whether all intervals are at rest in the same state, with the same input and output."""
        return not any(np.any(np.diff(rest, axis=0)) for rest in (self.rest_states, self.rest_inputs, self.rest_outputs))

    @property
    def parameters(self) -> Mapping[str, float]:
        """Values of the physical parameters before the first switch, by name, as far as the models know them."""
        return self.systems[0].parameters

    @property
    def left_out(self) -> tuple[str, ...]:
        """What the real plant has besides in any of the intervals, each once."""
        return tuple(dict.fromkeys(text for system in self.distinct for text in system.left_out))

    @property
    def schedule(self) -> tuple[tuple[float, dict[str, float]], ...]:
        """When which physical parameters take other values: (switch time [s], {name: new value}), where any does."""
        pairs = zip(self.switch_times.tolist(), itertools.pairwise(self.systems), strict=True)
        changes = [(t, {name: v for name, v in new.parameters.items() if v != old.parameters[name]}) for t, (old, new) in pairs]
        return tuple((time, values) for time, values in changes if values)

    def interval(self, t: ArrayLike) -> Indices:
        """Index of the interval that holds each time; a switch time itself belongs to the interval that it starts."""
        times = real_numbers("times [s]", t, error=ModelError)
        if np.any(np.isnan(times)):
            raise ModelError("times [s] must be numbers, got NaN among them")
        return np.searchsorted(self.switch_times, times, side="right")


def as_switched(model: Any) -> SwitchedSystem:
    """A SwitchedSystem from itself, or with one interval from anything that `as_state_space` takes."""
    return model if isinstance(model, SwitchedSystem) else SwitchedSystem([model])


def _require_same_channels(first: StateSpace, model: StateSpace, k: int) -> None:
    for kind in ("states", "inputs", "outputs"):
        expected, got = getattr(first, kind), getattr(model, kind)
        if not got.fits(expected):
            raise ModelError(f"interval {k} has the {kind} {got}, interval 0 has {expected}; they must be the same")
    if model.parameters.keys() != first.parameters.keys():
        known, expected = (", ".join(system.parameters) or "none" for system in (model, first))
        raise ModelError(
            f"interval {k} holds for values of the parameters {known}, interval 0 of {expected}; linearize all intervals from one "
            "plant, or state `parameters` of the same names for all of them"
        )


def _in_frame(model: StateSpace, first: StateSpace, k: int) -> StateSpace:
    """The model with its states measured from the x0 of the first one."""
    x0, origin = model.operating_point.x0, first.operating_point.x0
    if np.array_equal(x0, origin):
        return model
    if x0.shape != origin.shape or (len(x0) != model.n_states and not np.allclose(x0, origin, rtol=SAME_POINT, atol=SAME_POINT)):
        raise ModelError(
            f"interval {k} measures its states from the x0 {x0.tolist()}, interval 0 from {origin.tolist()}, of which no difference"
            f" of the {model.n_states} states can be told; linearize all intervals from one plant at one operating point, and say "
            'where the equilibrium is after a change: invtrack.linearize(plant, equilibrium="same outputs", ...)'
        )
    moved = x0 - origin if len(x0) == model.n_states else 0.0
    return replace(model, operating_point=replace(model.operating_point, x0=origin), rest=model.rest + moved)
