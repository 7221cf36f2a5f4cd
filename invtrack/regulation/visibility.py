"""What makes the entries of a map comparable: units for the states of exosystem and plant, from how they act on each other."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import Exosystem

Array = NDArray[np.float64]


def visibility(exosystem: Exosystem, plant: SwitchedSystem) -> Array:
    """How strongly each state shows in y_d, as powers of two w (q,): exact to divide by; zero for a state that never shows.

    w = |C_e| (I + |A_e| / s + ... + (|A_e| / s)^(q - 1)), with the largest entries of all intervals and outputs, and s the rate of
    the faster of exosystem and plant. Columns of the map from w x_e are of similar size whatever units the states of the exosystem
    came in. The pattern of the matrices alone decides what never shows: x_e need not be observable where w > 0.
    """
    M = np.max(np.abs(exosystem.A), axis=0)
    shown: Array = np.max(np.abs(exosystem.C), axis=(0, 1))
    matrices = [M, *{id(system): system.A for system in plant.systems}.values()]
    rate = max(float(np.max(np.abs(np.linalg.eigvals(matrix)))) for matrix in matrices)
    term = shown
    for _ in range(exosystem.n_states - 1):
        term = term @ M / (rate if rate > 0 else 1.0)  # integrators alone have no rate of their own
        shown = shown + term
    seen = shown > 0
    return np.where(seen, np.exp2(np.rint(np.log2(np.where(seen, shown, 1.0)))), 0.0)


def column_weights(weights: Array) -> Array:
    """Weights to divide by (q,): 1 for a state that never shows, whose columns are zero."""
    return np.where(weights > 0, weights, 1.0)


def unweighted(states: Array, weights: Array) -> Array:
    """The states x_e in the columns of `states` (q, d) = w x_e, to unit length."""
    found = states / column_weights(weights)[:, None]
    return np.asarray(found / np.linalg.norm(found, axis=0))
