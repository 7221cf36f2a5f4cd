"""Position servo of a base: proportional and derivative feedback of one coordinate to the input that drives it."""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.arguments import require_text
from invtrack.arrays import Array, finite_number
from invtrack.control.gains import GainSchedule, per_interval
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import as_switched

RELATED = 1e-9
"""What drives a state by less than this share of what drives it most, states in comparable units, does not drive it."""


def base_servo(model: Any, *, position: str, frequency: float, damping: float = 1.0, input: str | None = None) -> GainSchedule:
    """Gains of a PD servo that holds one position q by one input, and feeds back nothing else: u = u_0 - k_p (q - q_0) - k_d q'.

    From rest the input accelerates the position by q'' = b u. A mass of 1 / b alone would follow q'' + 2 damping frequency q' +
    frequency^2 q = 0: k_p = frequency^2 / b and k_d = 2 damping frequency / b, in each interval of a model that switches. What
    hangs on the base shakes it, so the poles of the whole loop are others: `flexible_modes` says which.

    A controller with these gains around a plan is the servo with a command. `feedback_tracking(model, reference, gains=servo)` is
    the plan of the command that is the position wanted, with `command=` of the same command shaped; around the plan by `invert` the
    same servo is commanded by the inverse.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D, in which the rate of the position is a state, too.
        position: name of the state that is held.
        frequency: how fast the servo is [rad/s].
        damping: its damping ratio.
        input: name of the input that drives the position; may be left out where there is one input only.

    Raises ControlError for names that there are none of, a position whose rate is no state, an input that does not drive it, and
    numbers that are not positive.
    """
    plant = as_switched(model)
    w, zeta = (finite_number(name, value, error=ControlError) for name, value in (("frequency", frequency), ("damping", damping)))
    if not (w > 0 and zeta > 0):
        raise ControlError(f"frequency and damping of a servo must be positive, got {frequency} and {damping}")
    names = plant.inputs.names
    if input is None and len(names) > 1:
        raise ControlError(f"say which input drives the position: input= one of {list(names)}")
    at, by = _number("position", position, plant.states.names), 0 if input is None else _number("input", input, names)

    def gain(system: StateSpace) -> Array:
        rate = _rate(system, at)
        B = system.B[:, by] / plant_units(system)
        b = system.B[rate, by]
        if not abs(B[rate]) > RELATED * np.max(np.abs(B)):
            raise ControlError(
                f"the input {names[by]!r} does not drive the position {position!r}; name the input that does, or another position"
            )
        K = np.zeros((system.n_inputs, system.n_states))
        K[by, at], K[by, rate] = w * w / (system.A[at, rate] * b), 2 * zeta * w / b
        return K

    return per_interval(plant, gain)


def _number(kind: str, name: str, names: tuple[str, ...]) -> int:
    """Number of the channel of this name."""
    if require_text(kind, name, error=ControlError) not in names:
        raise ControlError(f"{kind} must be one of {list(names)}, got {name!r}")
    return names.index(name)


def _rate(system: StateSpace, at: int) -> int:
    """Number of the state that is the rate of state number `at`, but for their units."""
    units = plant_units(system)
    drives, inputs = np.abs(system.A[at] * units), np.abs(system.B / units[:, np.newaxis])
    rate = int(np.argmax(drives))
    others = np.delete(drives, rate)
    alone = np.all(others <= RELATED * drives[rate]) and np.all(inputs[at] <= RELATED * np.max(inputs))
    if rate == at or not drives[rate] > 0 or not alone:
        raise ControlError(
            f"no state is the rate of {system.states.names[at]!r}, as a servo with a derivative part needs it; name a position "
            f"among {list(system.states.names)} whose rate is a state, or use invtrack.lqr"
        )
    return rate
