"""Laws that are affine in the state: data enough for a loop to evaluate by itself."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from invtrack.control.gains import GainSchedule

Array = NDArray[np.float64]


class AffineLaw:
    """u = offset_i - K_i x at instant i, everything that does not depend on the measurement worked out before the run.

    offset (m, p). gains: the distinct K (p, n); which (m,): the gain of each instant. A loop that keeps its states in rows
    [x, offset] gets u by one product with `row_gain`: each operation on a small array costs as much as the next, and this one is
    taken in every physics step.
    """

    estimate = None

    def __init__(self, offset: Array, gains: Sequence[Array], which: NDArray[np.intp]) -> None:
        self.offset = offset
        self._gains = gains
        self._row_gains = [np.hstack([-gain, np.eye(len(gain))]) for gain in gains]
        self._which = which

    @classmethod
    def around(cls, feedforward: Array, x_ref: Array, gains: GainSchedule, inside: Array) -> AffineLaw:
        """u = feedforward_i - K_i (x - x_ref_i): feedforward (m, p), x_ref (m, n); inside (m,) [s] says which gain is in force."""
        which = gains.interval(inside)
        offset = feedforward.copy()
        for k, gain in enumerate(gains.gains):
            offset[which == k] += x_ref[which == k] @ gain.T
        return cls(offset, gains.gains, which)

    def row_gain(self, index: int) -> Array:
        """[-K I] (p, n + p) of one instant."""
        gain: Array = self._row_gains[int(self._which[index])]
        return gain

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) at instant number `index`."""
        result: Array = self.offset[index] - self._gains[int(self._which[index])] @ measurement
        return result
