"""What an input leads to within a hold: one that is held, and one that moves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array

COUNT = 6
"""Points of a hold at which an input that moves is read: it is taken for the polynomial through its values there."""

NODES, WEIGHTS = (np.polynomial.legendre.leggauss(COUNT) + np.array([[1.0], [0.0]])) / 2
"""These points, Gauss's, as shares of the hold, and their weights in the input's mean."""


@dataclass(frozen=True, eq=False)
class HoldResponse:
    """x = start x_0 + held u after a share of a hold, for the state x_0 at its start and a constant input u.

    For an input that moves, with the values u_g at the nodes, x = start x_0 + sum of moving_g u_g, and the input itself is by then
    sum of reading_g u_g.

    Args:
        start, held: (n, n) and (n, m).
        moving, reading: (6, n, m) and (6,).
    """

    start: Array
    held: Array
    moving: Array
    reading: Array

    @classmethod
    def of(cls, A: Array, B: Array, length: float, share: float) -> HoldResponse:
        """For x' = A x + B u, A (n, n), B (n, m), after a share of a hold of that length [s].

        With u = sum of c_i (s / length)^i / i! plant and input are one autonomous system of [x; c].
        """
        n, m = B.shape
        both = np.zeros((n + COUNT * m, n + COUNT * m))
        both[:n, :n], both[:n, n : n + m] = A * length, B * length
        both[n:-m, n + m :] = np.eye((COUNT - 1) * m)
        step = scipy.linalg.expm(both * share)[:n]
        along, order = step[:, n:].reshape(n, COUNT, m), np.arange(1, COUNT)
        values = np.cumprod(np.column_stack([np.ones(COUNT), NODES[:, None] / order]), axis=1)
        from_values = np.linalg.solve(values, np.eye(COUNT))
        reading = np.cumprod(np.append(1.0, share / order)) @ from_values
        return cls(step[:, :n], along[:, 0], np.einsum("ig,rim->grm", from_values, along), reading)

    def change(self, C: Array, D: Array, departure: Array) -> Array:
        """By how much departures (6, k, m) of k inputs from others, at the nodes, change C x + D u (k, r): C (r, n), D (r, m)."""
        through = C @ self.moving + self.reading[:, None, None] * D
        return np.asarray(np.einsum("grm,gkm->kr", through, departure))
