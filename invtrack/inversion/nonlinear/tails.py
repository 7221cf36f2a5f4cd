"""Tails of a motion: how its linear model leaves rest before the first node, and comes back to it after the last one."""

from __future__ import annotations

from typing import Literal

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.axis_zeros import split_through_axis
from invtrack.inversion.inverse_system import inverse_systems
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import as_switched
from invtrack.plans.tail import Tail

CUT = 1e-10
"""Singular values of a tail's directions below this share of the largest are none."""


def linear_tail(model: StateSpace, away: Array, size: Array, side: Literal["before", "after"]) -> Tail:
    """[x; u; y] outside the window, as deviations from rest, with the output held.

    What of the distance from rest lies in the antistable (before) or stable (after) internal dynamics dies out along them; what
    does not, such as where a vehicle that may stand anywhere comes to rest, is held.

    Args:
        model: the linear model at that end.
        away: the state's distance from rest at the edge of the window (n,).
        size: peaks of the states, in which distances count (n,).
        side: of the motion.
    """
    plant = as_switched(model)
    (inverse,) = inverse_systems(plant, split_through_axis(plant))
    n = model.n_states
    if side == "before":
        part, A = inverse.system.backward, -inverse.system.backward.A
        X = part.X
    else:
        decaying = inverse.system.decaying
        part = inverse.system.forward
        A, X = part.A[:decaying, :decaying], part.X[:, :decaying]
    v = np.zeros(0)
    if X.shape[1]:
        v = np.asarray(np.linalg.lstsq(X[:n] / size[:, None], away / size, rcond=CUT)[0], dtype=float)
    held = np.zeros(len(part.X))
    held[:n] = away - X[:n] @ v
    return Tail(
        direction=-1 if side == "before" else 1,
        departure=Propagator(A),
        X=X,
        v=v,
        S=np.zeros((1, 1)),
        X_w=held[:, np.newaxis],
        w=np.ones(1),
    )
