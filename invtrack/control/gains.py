"""State feedback gains, one per interval of a switched plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, Indices, increasing_times, real_numbers, real_weight, stable_poles
from invtrack.control.placement import placed_gain
from invtrack.errors import ControlError
from invtrack.linear.hidden_modes import hidden_subspaces, in_units
from invtrack.linear.mode_groups import listed, unmoved_modes, unseen_modes
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched

WEIGHED = 1e-12
"""An eigenvalue of Q, once its diagonal is scaled to one, weighs nothing below this share of the largest."""


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

    def interval(self, t: ArrayLike) -> Indices:
        """Index of the gain in force at each time."""
        times = real_numbers("times [s]", t, error=ControlError)
        if np.any(np.isnan(times)):
            raise ControlError("times [s] must be numbers, got NaN among them")
        return np.searchsorted(self.switch_times, times, side="right")


def lqr(model: Any, *, Q: ArrayLike, R: ArrayLike) -> GainSchedule:
    """Gains that minimise the integral of x'Q x + u'R u on each interval by itself: K = R^-1 B'X, A'X + X A - X B R^-1 B'X + Q = 0.

    Q (n, n) positive semidefinite, R (m, m) positive definite, in the units of states and inputs: an entry of Q weighs a radian
    squared against a metre squared. A number stands for that multiple of the identity, which weighs one unit of each state alike;
    where units differ, `bryson` makes weights from the largest deviations that are acceptable.

    Raises ControlError for weights of the wrong shape or sign, and for a plant that cannot be stabilized: the message names the
    modes that no input moves, or that Q does not weigh, and the states that take part in them.
    """
    plant = as_switched(model)
    n, m = plant.n_states, plant.n_inputs
    state_weight = real_weight("Q", Q, n, meaning=f"states {list(plant.states.names)}", error=ControlError)
    input_weight = real_weight("R", R, m, meaning=f"inputs {list(plant.inputs.names)}", definite=True, error=ControlError)

    def gain(system: StateSpace) -> Array:
        try:
            X = scipy.linalg.solve_continuous_are(system.A, system.B, state_weight, input_weight)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise ControlError(f"no LQR gain: {_obstacle(system, state_weight) or error}") from error
        K = np.asarray(np.linalg.solve(input_weight, system.B.T @ X))
        poles = np.linalg.eigvals(system.A - system.B @ K)
        if np.any(poles.real >= 0):
            reason = _obstacle(system, state_weight)
            raise ControlError(
                f"no LQR gain: {reason}"
                if reason
                else f"the LQR gain does not stabilize the plant: closed-loop poles {np.round(poles, 6).tolist()}; the weights of "
                "some states or inputs may differ by too many orders of magnitude"
            )
        return K

    return _per_interval(plant, gain)


def _obstacle(system: StateSpace, Q: Array) -> str:
    """Why no gain of least cost stabilizes the plant, "" where nothing is found."""
    unmoved = [group for group in unmoved_modes(system) if group.side >= 0]
    if unmoved:
        return (
            f"the inputs {list(system.inputs.names)} do not move {listed(unmoved)}, on or right of the imaginary axis, so no "
            "feedback stabilizes the plant; add an input that acts on these states, or leave them out of the model where nothing "
            "disturbs them"
        )
    unweighed = [group for group in unseen_modes(_weighed(system, Q)) if group.side == 0]
    if unweighed:
        return (
            f"Q does not weigh {listed(unweighed)}, on the imaginary axis, so least cost leaves it as it is; give Q an entry for "
            "one of these states, however small"
        )
    return ""


def _weighed(system: StateSpace, Q: Array) -> StateSpace:
    """The plant with outputs z for which z'z = x'Q x."""
    size = np.sqrt(np.where(np.diag(Q) > 0, np.diag(Q), 1.0))
    values, vectors = np.linalg.eigh(Q / np.outer(size, size))
    factor = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
    shown = values > WEIGHED * max(np.max(values), 0.0)
    return StateSpace(system.A, system.B, factor[shown] if np.any(shown) else np.zeros((1, len(Q))), states=system.states)


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

    return _per_interval(plant, gain)


def _per_interval(plant: SwitchedSystem, design: Callable[[StateSpace], Array]) -> GainSchedule:
    def named(system: StateSpace) -> Array:
        try:
            return design(system)
        except ControlError as error:
            if len(plant) == 1:
                raise
            number = next(k for k, model in enumerate(plant.systems) if model is system)
            raise ControlError(f"interval {number}: {error}") from error

    return GainSchedule(plant.map(named), plant.switch_times)
