"""What holding an output still for ever may cost: nothing."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

FREE_HOLDING = 1e-12
"""Holding an output counts as free where it costs less per second than this share of what not moving there at all would cost."""

ROUNDING = 1e-12
"""A cost per second below this share of the terms that it is the sum of is what is left where they cancel."""

AT_REST = 1e-12
"""A held value this close to the operating point's output, as a share of the reference's size, is off it by rounding only."""


def without_rounding(held: Array, reference: PiecewiseSignal, y_0: Array) -> Array:
    """Held deviations (..., p) from the operating point's output y_0 (p,), zero where only rounding sets them apart from it.

    A reference that goes there and back, channel by channel, rarely ends exactly where it began.
    """
    return np.where(np.abs(held) <= AT_REST * np.maximum(reference.size(0), np.abs(y_0)), 0.0, held)
