"""Solutions of v' = M v at many times at once, without accumulating error over steps."""

from __future__ import annotations

import math

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.lti.balancing import balancing_scale

Array = NDArray[np.float64]

NODE_ANGLE = 1 / 16
"""Distance of the nodes from which Taylor series start, times the norm of M."""

TAYLOR_TERMS = 9
"""Terms of the series: over half a node distance the first one left out is below 1e-18 of the first."""

DIRECT_DIGITS = 4
"""exp(M h 2^b) is worked out anew for this many b; from a norm of 1/2 on, squaring loses less than expm's Pade approximants."""

CHUNK = 8192
"""Times that are worked on together, so that their arrays stay in the processor's cache."""


class Propagator:
    """exp(M tau) for one matrix M (q, q) and many tau >= 0 [s].

    Each tau is split into a whole number of node distances h and a remainder |r| <= h / 2. The nodes' states are found by the
    binary digits exp(M h 2^b), the way on by Taylor series, whose coefficients times in the same cell share. The error does not
    grow with the number of times, the cost is linear in it, and exponentials that decay never overflow, whatever tau.
    """

    def __init__(self, M: Array) -> None:
        # Scales that are powers of two: balancing brings down the norm, and the number of nodes, without rounding.
        self._scale = balancing_scale(M, within_parts=True)
        self._M = M * self._scale / self._scale[:, None]
        norm = float(np.linalg.norm(self._M, 1)) if M.size else 0.0
        self._step = NODE_ANGLE / norm if norm > 0 else math.inf
        self._digits = [scipy.linalg.expm(self._M * self._step * 2**bit) for bit in range(DIRECT_DIGITS)] if norm > 0 else []

    @property
    def size(self) -> int:
        """Number of states q."""
        return len(self._M)

    def states(self, v: Array, tau: Array) -> Array:
        """exp(M tau_i) v_i for states v (m, q) and times tau (m,) [s]: (m, q)."""
        return self.outputs(np.eye(len(self._M)), v, np.arange(len(tau)), tau)

    def outputs(self, X: Array, v: Array, owner: NDArray[np.intp], tau: Array) -> Array:
        """X exp(M tau_i) v[owner_i] for X (k, q), states v (g, q), owner (m,) and tau (m,) [s]: (m, k).

        Times that stand in order, or in ordered stretches, share most of the work.
        """
        result = np.empty((len(tau), len(X)))
        if math.isinf(self._step):
            np.matmul(v[owner], X.T, out=result)
            return result
        series = self._series(X * self._scale)
        start = v / self._scale
        for first in range(0, len(tau), CHUNK):
            part = slice(first, first + CHUNK)
            self._chunk(series, start, owner[part], tau[part], result[part])
        return result

    def _series(self, X: Array) -> Array:
        """X M^j h^j / j!, highest order first, side by side: (q, terms k). In units of h the remainder is within 1/2."""
        term, terms = X, [X]
        for j in range(1, TAYLOR_TERMS):
            term = term @ self._M * (self._step / j)
            terms.append(term)
        return np.hstack([term.T for term in reversed(terms)])

    def _chunk(self, series: Array, v: Array, owner: NDArray[np.intp], tau: Array, result: Array) -> None:
        count = np.rint(tau / self._step)
        remainder = (tau / self._step - count)[:, None]
        new_cell = np.ones(len(tau), dtype=bool)
        new_cell[1:] = (count[1:] != count[:-1]) | (owner[1:] != owner[:-1])
        cell = np.cumsum(new_cell) - 1
        nodes = self._nodes(v[owner[new_cell]], count[new_cell].astype(np.int64))
        coefficients = (nodes @ series).reshape(len(nodes), TAYLOR_TERMS, -1)
        result[:] = coefficients[cell, 0]
        for j in range(1, TAYLOR_TERMS):
            result *= remainder
            result += coefficients[cell, j]

    def _nodes(self, v: Array, count: NDArray[np.int64]) -> Array:
        """exp(M h count_i) v_i."""
        for bit in range(int(count.max(initial=0)).bit_length()):
            if bit == len(self._digits):
                self._digits.append(self._digits[-1] @ self._digits[-1])
            chosen = (count >> bit) & 1 == 1
            v[chosen] = v[chosen] @ self._digits[bit].T
        return v


def flow(M: Array, v: Array, tau: Array) -> Array:
    """exp(M tau_i) v_i for all i at once: M (q, q), v (m, q), tau (m,) [s], not negative. See `Propagator`."""
    return Propagator(M).states(v, tau)
