"""Plants of the baselines' tests: a cart that carries two masses on springs, and laws on them integrated independently."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from invtrack import StateSpace

Array = NDArray[np.float64]

NAMES = ["cart", "load 1", "load 2", "cart speed", "load 1 speed", "load 2 speed"]


def carrier(stiffness: tuple[float, float] = (40.0, 90.0), mass: float = 0.4, damping: float = 0.05) -> StateSpace:
    """A cart of 2 kg that is pushed carries a load, which carries the second one: the output is the first load's place."""
    M = np.diag([2.0, 0.5, mass])
    links = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
    S = links.T @ np.diag(stiffness) @ links
    D = damping * links.T @ links + np.diag([0.3, 0.0, 0.0])
    A = np.block([[np.zeros((3, 3)), np.eye(3)], [-np.linalg.solve(M, S), -np.linalg.solve(M, D)]])
    return StateSpace(A, np.eye(6)[:, 3:4] / 2.0, np.eye(6)[1:2], states=NAMES, inputs=["push"], outputs=["load"])


def integrated(A: Array, force: Callable[[float], Array], x_0: Array, edges: list[float], t: Array) -> Array:
    """x (len(t), n) of x' = A x + force(t) from x_0 at edges[0], by an independent integrator that stops at each edge."""
    x, found = np.asarray(x_0, dtype=float), np.empty((len(t), len(x_0)))
    for a, b in itertools.pairwise(edges):
        chosen = (t >= a) & (t <= b)
        run = solve_ivp(lambda s, x: A @ x + force(s), (a, b), x, "DOP853", dense_output=True, rtol=1e-11, atol=1e-12)
        found[chosen], x = run.sol(t[chosen]).T, run.y[:, -1]
    return found
