"""Flexible modes of a plant, as input shapers are made for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, finite_number, real_numbers, whole_number
from invtrack.control.gains import GainSchedule
from invtrack.errors import ControlError
from invtrack.linear.oscillation import oscillatory_eigenvalues
from invtrack.linear.switched import as_switched

NO_DAMPING = 1e-9
"""A negative damping ratio of this size is that of an undamped mode, rounded."""

LARGEST_DAMPING = 0.5
"""Modes with a larger damping ratio die out by themselves within the time that a shaper would take."""


class Mode(NamedTuple):
    """An oscillation s^2 + 2 damping frequency s + frequency^2 = 0.

    frequency: undamped natural frequency [rad/s]; damping: ratio to critical damping, from 0 to below 1.
    """

    frequency: float
    damping: float

    @property
    def damped_period(self) -> float:
        """2 pi / (frequency sqrt(1 - damping^2)) [s]."""
        return float(2 * np.pi / (self.frequency * np.sqrt((1 - self.damping) * (1 + self.damping))))


def flexible_modes(
    model: Any, *, gains: GainSchedule | ArrayLike | None = None, interval: int = 0, most_damping: float = LARGEST_DAMPING
) -> tuple[Mode, ...]:
    """The flexible modes of a plant, or of the closed loop u = -K x around it, slowest first.

    A shaper for what a servo's command excites is made for the modes of the loop, not of the plant: feedback moves them.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D.
        gains: the feedback, as `lqr` and `base_servo` make it, or one gain K (m, n); none unless stated.
        interval: of a model that switches, the one whose modes are meant.
        most_damping: modes with a larger damping ratio are left out.

    Raises ControlError for gains that do not fit, an interval that there is none of, and a mode that grows.
    """
    plant = as_switched(model)
    limit = finite_number("most_damping", most_damping, error=ControlError)
    number = whole_number("interval", interval, highest=len(plant) - 1, error=ControlError)
    system, A = plant.systems[number], plant.systems[number].A
    if gains is not None:
        K = _gain(gains, plant.switch_times, number)
        if K.shape != (plant.n_inputs, plant.n_states):
            raise ControlError(f"gains have shape {K.shape}, expected {(plant.n_inputs, plant.n_states)} for this model")
        A = A - system.B @ K
    oscillating = oscillatory_eigenvalues(replace(system, A=A))
    damping = -oscillating.real / np.abs(oscillating)
    growing = oscillating[damping < -NO_DAMPING]
    if len(growing):
        raise ControlError(
            f"a mode at {growing[0]:.4g} rad/s grows, so no shaper can leave it at rest; stabilize it with feedback first (gains=)"
        )
    found = [Mode(float(abs(s)), max(0.0, float(zeta))) for s, zeta in zip(oscillating, damping, strict=True) if zeta <= limit]
    return tuple(sorted(found))


def _gain(gains: GainSchedule | ArrayLike, switch_times: Array, number: int) -> Array:
    """The gain in force at the start of an interval between the switch times of a plant."""
    if not isinstance(gains, GainSchedule):
        gains = GainSchedule([gains])
    return gains.gains[int(gains.interval(switch_times[number - 1 : number])[0]) if number else 0]


def as_modes(modes: Sequence[tuple[float, float]]) -> tuple[Mode, ...]:
    """Modes from pairs of a frequency [rad/s] and a damping ratio, in range. Raises ControlError for anything else."""
    listed = items("modes", modes, expected="a list of pairs (frequency [rad/s], damping ratio)", error=ControlError)
    found = []
    for number, pair in enumerate(listed):
        values = real_numbers(f"mode {number}", pair, error=ControlError)
        if values.shape != (2,):
            raise ControlError(
                f"mode {number} must be a pair (frequency [rad/s], damping ratio), got {pair!r}; one mode is a list of one pair"
            )
        frequency, damping = values.tolist()
        if not (0 < frequency < np.inf and 0 <= damping < 1):
            raise ControlError(
                f"mode {number} must have a positive frequency [rad/s] and a damping ratio from 0 to below 1, got {frequency} "
                f"and {damping}"
            )
        found.append(Mode(frequency, damping))
    return tuple(found)
