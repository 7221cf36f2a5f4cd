"""The plant as it is to small departures from a plan, all along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array


@dataclass(frozen=True, eq=False)
class Linearizations:
    """d' = A_k d + B_k v on stretch k of a plan, d and v departures of the state and of the input from those planned.

    A departure of the state is measured as controllers measure it: x minus x_ref, rotations in the tangent space at x_ref.

    Args:
        edges: of N stretches, increasing (N + 1,) [s].
        A, B: derivatives in their middles, (N, n, n) and (N, n, m).
    """

    edges: Array
    A: Array
    B: Array

    def __len__(self) -> int:
        """Number of stretches N."""
        return len(self.A)

    @property
    def lengths(self) -> Array:
        """Of the stretches (N,) [s]."""
        return np.diff(self.edges)

    @property
    def middles(self) -> Array:
        """Of the stretches (N,) [s]."""
        return np.asarray((self.edges[:-1] + self.edges[1:]) / 2)
