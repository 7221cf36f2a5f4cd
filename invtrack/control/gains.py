"""State feedback gains, one per interval of a switched plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, Indices, increasing_times, real_numbers, stable_poles
from invtrack.control.placement import placed_gain
from invtrack.errors import ControlError
from invtrack.linear.hidden_modes import hidden_subspaces, in_units
from invtrack.linear.mode_groups import unmoved_modes
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched


@dataclass(frozen=True, eq=False)
class GainSchedule:
    """Gains K (p, n) for u = -K x, constant between switch times (N,) [s]: N + 1 of them.

    Raises ControlError where the numbers do not fit, an entry is not finite, or times do not increase.
    """

    gains: tuple[Array, ...]
    switch_times: Array

    def __init__(self, gains: Sequence[ArrayLike], switch_times: ArrayLike = ()) -> None:
        given = items("gains", gains, expected="a list of gains K (p, n), one for each interval", error=ControlError)
        matrices = tuple(real_numbers("a gain", gain, error=ControlError) for gain in given)
        times = increasing_times("switch times of gains", switch_times, error=ControlError)
        if len(matrices) != len(times) + 1 or len({gain.shape for gain in matrices}) != 1:
            raise ControlError(
                "expected one gain more than switch times, all of one shape; got gains of shapes "
                f"{[gain.shape for gain in matrices]} and {len(times)} switch times"
            )
        if not all(np.all(np.isfinite(gain)) for gain in matrices):
            raise ControlError("a gain has entries that are not finite")
        object.__setattr__(self, "gains", matrices)
        object.__setattr__(self, "switch_times", times)

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which a simulation must begin a step."""
        return self.switch_times

    def interval(self, t: ArrayLike) -> Indices:
        """Index of the gain in force at each time."""
        times = real_numbers("times [s]", t, error=ControlError)
        if np.any(np.isnan(times)):
            raise ControlError("times [s] must be numbers, got NaN among them")
        return np.searchsorted(self.switch_times, times, side="right")


class GainsAlong(GainSchedule):
    """Gains that follow a plan: each holds over a short stretch of it.

    They change little from one stretch to the next, and act on departures from the plan alone. A simulation therefore need not
    begin a step where they change: each update uses the gain in force.
    """

    @property
    def breakpoints(self) -> Array:
        """None."""
        return np.zeros(0)


def place(model: Any, poles: Sequence[complex]) -> GainSchedule:
    """Gains that give every interval the same closed-loop poles: eig(A_k - B_k K_k) = poles.

    poles: n of them, complex ones in conjugate pairs. Up to as many equal ones as there are inputs are placed robustly (A. Tits,
    Y. Yang, IEEE Trans. Automatic Control 41, 1996), more of them one after another (A. Varga, IEEE Trans. Automatic Control 26,
    1981). A mode that no input moves may stay, if its own eigenvalue is among the poles. Source: Devasia, Paden, Rossi 1996,
    section 2.

    Raises ControlError for a wrong number of poles, poles right of the axis, and modes that no input moves: the message names
    them and the states that take part in them.
    """
    plant = as_switched(model)
    wanted = stable_poles("poles", poles, plant.n_states, error=ControlError)

    def gain(system: StateSpace) -> Array:
        hidden = hidden_subspaces([system])
        A, B, _ = in_units(system, hidden.units)
        K = placed_gain(
            A,
            B,
            wanted,
            fixed=hidden.unreached,
            modes=unmoved_modes(system),
            name="poles",
            obstacle=f"the inputs {list(system.inputs.names)} do not move",
            remedy="add an input that acts on these states",
        )
        return K / hidden.units

    return per_interval(plant, gain)


def per_interval(plant: SwitchedSystem, design: Callable[[StateSpace], Array]) -> GainSchedule:
    """The gains that a design makes of each interval's model; a refusal says which interval it is about."""

    def named(system: StateSpace) -> Array:
        try:
            return design(system)
        except ControlError as error:
            if len(plant) == 1:
                raise
            number = next(k for k, model in enumerate(plant.systems) if model is system)
            raise ControlError(f"interval {number}: {error}") from error

    return GainSchedule(plant.map(named), plant.switch_times)
