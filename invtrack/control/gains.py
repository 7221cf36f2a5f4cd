"""State feedback gains, one per interval of a switched plant."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # loads scipy.signal, which costs a second, at its first use
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arguments import items
from invtrack.arrays import Array, ComplexArray, Indices, increasing_times, real_numbers, real_weight, stable_poles
from invtrack.errors import ControlError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched

POLE_TOLERANCE = 1e-3
"""Placed poles must be met to this share of the largest: a mode that nothing moves is seen as a miss, not as rounding."""


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

    Q (n, n) positive semidefinite, R (m, m) positive definite; numbers stand for multiples of the identity.

    Raises ControlError for weights of the wrong shape or sign, and for a plant that cannot be stabilized.
    """
    plant = as_switched(model)
    n, m = plant.n_states, plant.n_inputs
    state_weight = real_weight("Q", Q, n, meaning=f"states {list(plant.states.names)}", error=ControlError)
    input_weight = real_weight("R", R, m, meaning=f"inputs {list(plant.inputs.names)}", definite=True, error=ControlError)

    def gain(system: StateSpace) -> Array:
        try:
            X = scipy.linalg.solve_continuous_are(system.A, system.B, state_weight, input_weight)
        except (np.linalg.LinAlgError, ValueError) as error:
            raise ControlError(
                f"no LQR gain: {error}; a mode that the inputs {list(system.inputs.names)} cannot move, or that Q does not "
                "weigh, lies on or right of the imaginary axis"
            ) from error
        return np.asarray(np.linalg.solve(input_weight, system.B.T @ X))

    return _per_interval(plant, gain)


def place(model: Any, poles: Sequence[complex]) -> GainSchedule:
    """Gains that give every interval the same closed-loop poles: eig(A_k - B_k K_k) = poles.

    poles: n of them, complex ones in conjugate pairs, none repeated more often than there are inputs. Source: Devasia, Paden,
    Rossi 1996, section 2.

    Raises ControlError for a wrong number of poles, poles right of the axis, or a plant whose modes cannot all be moved.
    """
    plant = as_switched(model)
    wanted = stable_poles("poles", poles, plant.n_states, error=ControlError)

    def gain(system: StateSpace) -> Array:
        advice = f"the inputs {list(system.inputs.names)} must be able to move every mode"
        return placed_gain(system.A, system.B, wanted, name="poles", advice=advice)

    return _per_interval(plant, gain)


def placed_gain(A: Array, B: Array, poles: ComplexArray, *, name: str, advice: str) -> Array:
    """K (p, n) for which the eigenvalues of A - B K are the `poles`.

    Args:
        A: (n, n).
        B: (n, p).
        poles: (n,), complex ones in conjugate pairs, none repeated more often than B has columns.
        name: what messages call them.
        advice: what must be so that they can be placed.

    Raises ControlError where they cannot be placed, or are missed: a mode that B does not reach stays where it is.
    """
    from scipy.signal import place_poles  # here, because it takes longer to import than all the rest of the package

    remedy = f"{advice}, and none may repeat too often or lie too far from those of the plant"
    try:
        K = np.asarray(place_poles(A, B, poles).gain_matrix, dtype=float)
    except ValueError as error:
        raise ControlError(f"{name} cannot be placed: {error}; {remedy}") from error
    distance = np.abs(np.linalg.eigvals(A - B @ K)[:, None] - poles)
    miss = max(distance.min(axis=0).max(), distance.min(axis=1).max())
    if not miss <= POLE_TOLERANCE * np.max(np.abs(poles)):
        raise ControlError(f"{name} cannot be placed: they are missed by {miss:.1e}; {remedy}")
    return K


def _per_interval(plant: SwitchedSystem, design: Callable[[StateSpace], Array]) -> GainSchedule:
    def stabilizing(system: StateSpace) -> Array:
        K = design(system)
        poles = np.linalg.eigvals(system.A - system.B @ K)
        if np.any(poles.real >= 0):
            raise ControlError(f"the gain does not stabilize the plant: closed-loop poles {np.round(poles, 6).tolist()}")
        return K

    return GainSchedule(plant.map(stabilizing), plant.switch_times)
