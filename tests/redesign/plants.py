"""Plants, references and brute force for the tests of redesign."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal, stack
from tests.cited_plants import TWO_DISC_A, TWO_DISC_B, TWO_DISC_C
from tests.linear.random_plants import block, plant_with

Array = NDArray[np.float64]


def companion(denominator: list[float], numerator: list[float]) -> StateSpace:
    """numerator / denominator, both ascending, the denominator monic with its leading one left out; strictly proper."""
    n = len(denominator)
    A = np.diag(np.ones(n - 1), k=1)
    A[-1] = -np.array(denominator)
    C = np.zeros((1, n))
    C[0, : len(numerator)] = numerator
    return StateSpace(A, np.eye(n)[:, -1:], C)


# Poles -1.2, -0.5 +- 2j; a zero at 2 (nonminimum-phase), or at -2.
NONMINIMUM = companion([5.1, 5.45, 2.2], [2.0, -1.0])
MINIMUM = companion([5.1, 5.45, 2.2], [2.0, 1.0])
# The same with the flexible mode at -0.3 +- 1.5j: what a payload does.
HEAVIER = companion([2.808, 3.06, 1.8], [2.0, -1.0])
# Poles 0.4 and -1 +- 1j.
UNSTABLE = companion([-0.8, 1.2, 1.6], [1.5, -1.0])
WEIGHTS: dict[str, Any] = {"R": 0.2, "Q_x": np.diag([0.3, 0.0, 0.1]), "Q_y": 4.0}
DIRECT = StateSpace(NONMINIMUM.A, NONMINIMUM.B, NONMINIMUM.C, [[0.3]])
# The input's gain jumps, so the best input does too.
STRONGER = SwitchedSystem([NONMINIMUM, StateSpace(HEAVIER.A, 1.5 * HEAVIER.B, HEAVIER.C)], [1.25])

# Two inputs and outputs of relative degrees 1 and 2, with full weights.
FULL = plant_with(np.random.default_rng(4), (1, 2), block(0.8, -1.0 + 2j))
FULL_WEIGHTS: dict[str, Any] = {
    "R": np.array([[0.5, 0.1], [0.1, 0.2]]),
    "Q_x": np.diag([0.0, 0.2, 0.0, 0.1, 0.3, 0.0]),
    "Q_y": np.array([[5.0, -2.0], [-2.0, 3.0]]),
}

# Two-disc torsional rig, state (th1, th1', th2, th2'), output th2: S. Devasia, "Optimal output-trajectory redesign for invertible
# systems", AIAA J. of Guidance, Control, and Dynamics 19(5), 1996; weights: on input, on the twist th1 - th2, on the output.
TWO_DISC = StateSpace(TWO_DISC_A, TWO_DISC_B, TWO_DISC_C)
TWIST = np.array([[1.0, 0.0, -1.0, 0.0]])
TWO_DISC_WEIGHTS: dict[str, Any] = {"R": 1.0, "Q_x": 5000.0 * TWIST.T @ TWIST, "Q_y": 1.0}


def there_and_back(*, size: float = 1.0, start_time: float = 0.0, duration: float = 2.0) -> PiecewiseSignal:
    """A quintic to `size` and, after a pause of half a duration, back to zero."""
    there = rest_to_rest(0.0, size, duration, start_time=start_time)
    return there + rest_to_rest(0.0, -size, duration, start_time=start_time + 1.5 * duration)


def two_channels() -> PiecewiseSignal:
    return stack([there_and_back(), there_and_back(size=-0.6, start_time=0.7, duration=1.5)])


def simulated(model: Any, u: Callable[[Array], Array], times: Array) -> Array:
    """States (m, n) at evenly spaced times from rest, by classical Runge-Kutta steps; switch times must lie on the times."""
    plant: SwitchedSystem = as_switched(model)
    h = times[1] - times[0]
    # One side at each end of a step: inputs may jump at switch times.
    first, middle, last = u(times[:-1] + 1e-9 * h), u(times[:-1] + h / 2), u(times[1:] - 1e-9 * h)
    interval = plant.interval(times[:-1] + h / 2)
    x, matrices, added = np.zeros((len(times), plant.n_states)), [], np.empty((len(times) - 1, plant.n_states))
    for k, system in enumerate(plant.systems):
        ours, none = interval == k, np.zeros((plant.n_states,) * 2)
        matrices.append(_step(system.A, np.eye(plant.n_states), none, none, none, h))
        forces = [part[ours] @ system.B.T for part in (first, middle, last)]
        added[ours] = _step(system.A, np.zeros_like(forces[0]), *forces, h)
    for j, k in enumerate(interval):
        x[j + 1] = x[j] @ matrices[k] + added[j]
    return x


def _step(A: Array, x: Array, first: Array, middle: Array, last: Array, h: float) -> Array:
    """States a step later (m, n), of states x and forces at its start, in its middle and at its end (m, n)."""
    k_1 = x @ A.T + first
    k_2 = (x + h / 2 * k_1) @ A.T + middle
    k_3 = (x + h / 2 * k_2) @ A.T + middle
    k_4 = (x + h * k_3) @ A.T + last
    return np.asarray(x + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4))
