"""Linear systems whose matrices jump at known times."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, Indices, increasing_times, real_matrix, real_numbers
from invtrack.channels import Channels
from invtrack.errors import ModelError
from invtrack.linear.state_space import OperatingPoint, StateSpace, as_state_space

T = TypeVar("T")

OSCILLATION_TOLERANCE = 1e-6
"""An eigenvalue counts as an oscillation where its imaginary part exceeds this share of the fastest eigenvalue: a rigid-body mode's
double eigenvalue at zero is split by rounding to about sqrt(eps) of it."""


@dataclass(frozen=True, eq=False)
class SwitchedSystem:
    """A, B, C, D constant between known switch times t_1 < ... < t_N [s]; the state is continuous at a switch.

    systems: N + 1 models of the same states, inputs and outputs about the same operating point, for values of the same physical
    parameters; switch_times: (N,), may be empty.
    distinct: the models without repetition; numbers (N + 1,): which of them each interval has.
    Interval k reaches from t_k to t_(k+1), the first from -infinity and the last to infinity (Devasia, Paden, Rossi 1996, eq. 1).

    Raises ModelError where the numbers do not fit, times do not increase, or operating points differ (an equilibrium that moves
    with the parameter, such as a payload under gravity, is a different problem and is refused, not ignored).
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
            _require_same_frame(models[0], model, k)
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
        """The point about which all intervals hold."""
        return self.systems[0].operating_point

    @property
    def parameters(self) -> Mapping[str, float]:
        """Values of the physical parameters before the first switch, by name, as far as the models know them."""
        return self.systems[0].parameters

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


def _require_same_frame(first: StateSpace, model: StateSpace, k: int) -> None:
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
    if not model.operating_point.agrees_with(first.operating_point):
        first_point, point = first.operating_point, model.operating_point
        raise ModelError(
            f"interval {k} holds about another operating point than interval 0 (u0 {point.u0.tolist()} against "
            f"{first_point.u0.tolist()}, y0 {point.y0.tolist()} against {first_point.y0.tolist()}); intervals whose equilibria "
            "differ are not supported: linearize about a common one"
        )


def slowest_flexible_period(A: ArrayLike) -> float:
    """Period 2 pi / |Im s| [s] of the slowest oscillatory eigenvalue s of A (n, n); NaN where nothing oscillates.

    Raises ModelError for what is no square matrix of finite numbers.
    """
    matrix = real_matrix("A", A, error=ModelError)
    if matrix.shape[0] != matrix.shape[1]:
        raise ModelError(f"A must be square, got shape {matrix.shape}")
    eigenvalues = np.linalg.eigvals(matrix)
    frequencies = np.abs(eigenvalues.imag)
    flexible = frequencies[frequencies > OSCILLATION_TOLERANCE * np.max(np.abs(eigenvalues), initial=0.0)]
    return float(2 * np.pi / flexible.min()) if flexible.size else float("nan")
