"""Plants that are at rest elsewhere after a jump, and their motion in absolute coordinates."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.linear.state_space import OperatingPoint, StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from tests import linear_motion
from tests.cited_plants import cantilever_paper

Array = NDArray[np.float64]
Equilibrium = tuple[ArrayLike, ArrayLike, ArrayLike]


def at_rest_in(system: StateSpace, equilibrium: Equilibrium) -> StateSpace:
    """The model about (x0, u0, y0)."""
    return replace(
        system, operating_point=OperatingPoint(*(np.asarray(value, dtype=float) for value in equilibrium)), measurement=None
    )


# The cantilever of the parameter-jump paper, output x[1]: a heavier tip, and with it an equilibrium in which base and tip stand
# elsewhere and the tip is turned (and, as a test, the base and the rotation are on the move).
TIP_MASSES = (0.0, 100.0, 10.0)
EQUILIBRIA: tuple[Equilibrium, ...] = (
    ([0.1, 0.5, 0.0, 0.0, 0.0, 0.0], [3.0], [0.5]),
    ([0.4, 0.3, -0.2, 0.1, 0.0, -0.3], [8.0], [0.3]),
    ([-0.2, 0.6, 0.1, 0.0, 0.0, 0.2], [-1.0], [0.6]),
)
JUMPS = (np.pi / 2, 3 * np.pi / 2)
CANTILEVERS = [
    at_rest_in(StateSpace(*cantilever_paper(mass)), equilibrium) for mass, equilibrium in zip(TIP_MASSES, EQUILIBRIA, strict=True)
]


def cantilever() -> SwitchedSystem:
    return SwitchedSystem(CANTILEVERS, JUMPS)


def absolute_motion(
    models: list[tuple[StateSpace, Equilibrium]], jumps: ArrayLike, plan: Plan, X: Array, times: Array
) -> tuple[Array, Array]:
    """Absolute states X (m, n) and outputs (m, p) at the times: X' = A_k (X - x0_k) + B_k (u - u0_k), X continuous.

    Args:
        models: of each interval, with its equilibrium.
        jumps: times at which they change.
        plan: whose input drives them.
        X: state at the first of the times.
        times: increasing.
    """
    inner = [t for t in plan.breakpoints if times[0] < t < times[-1]]
    states, outputs = [], []
    for a, b in itertools.pairwise([times[0], *inner, times[-1]]):
        middle = [(a + b) / 2]
        system, (x0, u0, y0) = models[int(np.searchsorted(jumps, middle[0]))]

        def forces(t: Array, system: StateSpace = system, u0: ArrayLike = u0, middle: float = middle[0]) -> Array:
            return np.asarray((plan.inputs(t, inside=np.full(len(t), middle)) - u0) @ system.B.T)

        at = times[(times >= a) & ((times < b) | (b == times[-1]))]
        visited = np.unique([a, *at, b])
        found = x0 + linear_motion.states(system.A, X - x0, forces, visited, longest=0.05)
        X, x = found[-1], found[np.searchsorted(visited, at)]
        states.append(x)
        outputs.append(y0 + (x - x0) @ system.C.T + (plan.inputs(at, inside=middle) - u0) @ system.D.T)
    return np.vstack(states), np.vstack(outputs)
