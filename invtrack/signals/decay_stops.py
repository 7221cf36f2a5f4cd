"""Where a reference with decaying modes has to be cut so that it can be followed backward in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.signals.piecewise import PiecewiseSignal

Array = NDArray[np.float64]

LARGEST_DECAY = 3.0
"""Time constants that a mode of the reference may decay over within one piece: backward, its rounding errors grow by e^3."""


def decay_stops(reference: PiecewiseSignal) -> Array:
    """Further breakpoints [s], none for references without decaying modes.

    The antistable internal dynamics are integrated backward over each piece together with the reference's generator w' = S w, whose
    stable modes grow in that direction: from a w that has all but decayed nothing of them could be recovered.
    """
    rates = np.array([max(0.0, -float(np.min(np.linalg.eigvals(g.S).real, initial=0.0))) for g in reference.generators])
    edges = reference.breakpoints
    decay = rates[reference.kind[1:-1]] * np.diff(edges)
    long = np.flatnonzero(decay > LARGEST_DECAY)
    stops = [np.linspace(edges[j], edges[j + 1], int(np.ceil(decay[j] / LARGEST_DECAY)) + 1)[1:-1] for j in long]
    return np.concatenate([np.zeros(0), *stops])
