"""Solutions of linear systems over time: at many times at once, over many pieces, and over holds."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.linear.scaling import balancing_scale

NODE_ANGLE = 1 / 16
"""Distance of the nodes from which Taylor series start, times the norm of M."""

TAYLOR_TERMS = 9
"""Terms of the series: over half a node distance the first one left out is below 1e-18 of the first."""

DIRECT_DIGITS = 4
"""exp(M h 2^b) is worked out anew for this many b; from a norm of 1/2 on, squaring loses less than expm's Pade approximants."""

LONG_STRETCH = 64
"""Fewer times than this in a stretch are not worth a look at their spacing."""

CHUNK = 8192
"""Times that are worked on together, so that their arrays stay in the processor's cache."""

VAN_LOAN_NORM = 0.5
"""Norm up to which a Gramian is read off one exponential; beyond, that of a shorter time is doubled, which cancels nothing."""


class Propagator:
    """exp(M tau) for one matrix M (q, q) and many tau >= 0 [s].

    Each tau is split into a whole number of node distances h and a remainder |r| <= h / 2. The nodes' states are found by the
    binary digits exp(M h 2^b), the way on from there by Taylor series, whose coefficients are the same for all times around a
    node. The error does not grow with the number of times, the cost is linear in it, and exponentials that decay never overflow,
    whatever tau.
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

    def outputs(self, X: Array, v: Array, owner: Indices, tau: Array, *, resolution: float = 0.0) -> Array:
        """X exp(M tau_i) v[owner_i] at many times: (m, k).

        Times in order, or in ordered stretches, share most of the work; long stretches of evenly spaced ones nearly all of it.

        Args:
            X: (k, q).
            v: states to start from (g, q).
            owner: which of these each time belongs to (m,).
            tau: times since the start (m,), not negative [s].
            resolution: how far off the times may be (from rounding of the absolute times behind tau) and still count as evenly
                spaced [s].
        """
        result = np.empty((len(tau), len(X)))
        if math.isinf(self._step):
            np.matmul(v[owner], X.T, out=result)
            return result
        X, v = X * self._scale, v / self._scale
        series = self._series(X)
        edges = np.concatenate([[0], np.flatnonzero(np.diff(owner)) + 1, [len(tau)]]) if len(tau) else np.zeros(1, dtype=int)
        if len(tau) < LONG_STRETCH * (len(edges) - 1):
            self._scattered(series, v, owner, tau, result)
            return result
        for first, last in itertools.pairwise(edges.tolist()):
            part = slice(first, last)
            spacing = _even_spacing(tau[part], resolution) if last - first >= LONG_STRETCH else None
            if spacing is None:
                self._scattered(series, v, owner[part], tau[part], result[part])
            elif spacing > 0:
                self._even(X, series, v[owner[first]], tau[first], spacing, result[part])
            else:
                self._even(X, series, v[owner[first]], tau[last - 1], -spacing, result[part][::-1])
        return result

    def _even(self, X: Array, series: Array, v: Array, start: float, spacing: float, result: Array) -> None:
        """result[j] = X exp(M (start + j spacing)) v: the states at every B-th time, times X exp(M i spacing) for i < B."""
        width = min(math.isqrt(len(result)) + 1, max(1, CHUNK // len(X)))
        within = X[np.newaxis]
        while len(within) < width:
            # Each power of two is worked out from the nodes, so that errors do not add up over the many factors of small steps.
            ahead = self._advanced(np.eye(len(v)), np.full(len(v), len(within) * spacing, dtype=float))
            within = np.concatenate([within, within @ ahead.T])
        within = within[:width]
        blocks = -(-len(result) // width)
        starts = self._advanced(np.tile(v, (blocks, 1)), np.asarray(start + spacing * width * np.arange(blocks), dtype=float))
        values = starts @ within.reshape(-1, len(v)).T
        result[:] = values.reshape(blocks * width, -1)[: len(result)]

    def _advanced(self, v: Array, tau: Array) -> Array:
        """exp(M tau_i) v_i in scaled coordinates."""
        result = np.empty_like(v)
        self._scattered(self._series(np.eye(len(self._M))), v, np.arange(len(v)), tau, result)
        return result

    def _scattered(self, series: Array, v: Array, owner: Indices, tau: Array, result: Array) -> None:
        for first in range(0, len(tau), CHUNK):
            part = slice(first, first + CHUNK)
            self._chunk(series, v, owner[part], tau[part], result[part])

    def _series(self, X: Array) -> Array:
        """X M^j h^j / j!, highest order first, side by side: (q, terms k). In units of h the remainder is within 1/2."""
        term, terms = X, [X]
        for j in range(1, TAYLOR_TERMS):
            term = term @ self._M * (self._step / j)
            terms.append(term)
        return np.hstack([term.T for term in reversed(terms)])

    def _chunk(self, series: Array, v: Array, owner: Indices, tau: Array, result: Array) -> None:
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


def _even_spacing(tau: Array, resolution: float) -> float | None:
    """The spacing of times that are even to within the resolution, or None."""
    spacing = float((tau[-1] - tau[0]) / (len(tau) - 1))
    if abs(spacing) <= resolution:
        return None
    even = np.max(np.abs(tau - (tau[0] + spacing * np.arange(len(tau))))) <= resolution
    return spacing if even else None


def flow(M: Array, v: Array, tau: Array) -> Array:
    """exp(M tau_i) v_i for all i at once: M (q, q), v (m, q), tau (m,) [s], not negative. See `Propagator`."""
    return Propagator(M).states(v, tau)


def forced_states(propagator: Propagator, added: Array, lengths: Array) -> Array:
    """z_0 = 0, z_(j+1) = exp(A L_j) z_j + g_j for pieces j = 0 ... m - 1 of one system z' = A z + ...: all z_j, (m + 1, n).

    propagator: of A; added: what is added over each piece, g (m, n); lengths: L (m,) [s]. The pieces are worked on in about sqrt(m)
    blocks side by side, each from zero; then the blocks' starts follow one from the other, and what each start adds within its
    block is put on top. The cost is linear in m.
    """
    m, n = added.shape
    result = np.zeros((m + 1, n))
    if m == 0 or n == 0:
        return result
    width = math.isqrt(m - 1) + 1
    blocks = -(-m // width)
    g = np.zeros((blocks * width, n))
    L = np.zeros(blocks * width)
    g[:m], L[:m] = added, lengths
    g, L = g.reshape(blocks, width, n), L.reshape(blocks, width)
    inner = np.zeros((blocks, width + 1, n))
    for j in range(width):
        inner[:, j + 1] = propagator.states(inner[:, j], L[:, j]) + g[:, j]
    elapsed = np.concatenate([np.zeros((blocks, 1)), np.cumsum(L, axis=1)], axis=1)
    start = np.zeros((blocks, n))
    for k in range(1, blocks):
        start[k] = propagator.states(start[k - 1 : k], elapsed[k - 1, -1:])[0] + inner[k - 1, -1]
    owner = np.repeat(np.arange(blocks), width + 1)
    inner += propagator.outputs(np.eye(n), start, owner, elapsed.ravel()).reshape(inner.shape)
    result[:m] = inner[:, :width].reshape(-1, n)[:m]
    last = m - (blocks - 1) * width
    result[m] = inner[-1, last]
    return result


def zero_order_hold(A: Array, B: Array, hold: float) -> tuple[Array, Array]:
    """A_d (n, n), B_d (n, p) with x(t + hold) = A_d x(t) + B_d u for x' = A x + B u, u constant over `hold` [s].

    [A_d B_d; 0 1] = exp([A B; 0 0] hold). A (n, n), B (n, p); p may be 0.
    """
    n, p = B.shape
    step = scipy.linalg.expm(np.block([[A, B], [np.zeros((p, n + p))]]) * hold)[:n]
    return step[:, :n], step[:, n:]


def held_through(stretches: Iterable[tuple[Array, Array, float]]) -> tuple[Array, Array]:
    """A_d, B_d of one hold in which the system changes: stretches (A, B, duration [s]), at least one, in their order."""
    steps = [zero_order_hold(*stretch) for stretch in stretches]
    A_d, B_d = steps[0]
    for A_next, B_next in steps[1:]:
        A_d, B_d = A_next @ A_d, A_next @ B_d + B_next
    return A_d, B_d


def sampled_noise(A: Array, G: Array, hold: float) -> tuple[Array, Array]:
    """A_d (n, n) and the covariance Q_d (n, n) that white noise adds to the state over `hold` [s], for x' = A x + G w.

    Q_d = integral of exp(A s) G G' exp(A's) over 0 < s < hold; G (n, k), w of unit intensity.
    """
    transition, covariance = transition_and_gramian(A.T, G @ G.T, hold)
    return transition.T, covariance


def transition_and_gramian(M: Array, Q: Array, duration: float) -> tuple[Array, Array]:
    """exp(M duration), and the integral of exp(M's) Q exp(M s) over 0 < s < duration [s]: M, Q (q, q), Q symmetric.

    Source: C. Van Loan, "Computing integrals involving the matrix exponential", IEEE Trans. Automatic Control 23(3), 1978; for
    longer times from doublings of short ones.
    """
    scale = balancing_scale(M, within_parts=True)
    M, Q = duration * M * scale / scale[:, None], duration * scale[:, None] * Q * scale
    q, norm = len(M), float(np.linalg.norm(M, 1))
    doublings = max(0, int(np.ceil(np.log2(norm / VAN_LOAN_NORM)))) if norm > 0 else 0
    both = scipy.linalg.expm(np.block([[-M.T, Q], [np.zeros_like(M), M]]) / 2**doublings)
    transition = both[q:, q:]
    gramian = transition.T @ both[:q, q:]
    for _ in range(doublings):
        gramian = gramian + transition.T @ gramian @ transition
        transition = transition @ transition
    gramian = gramian / scale[:, None] / scale
    return scale[:, None] * transition / scale, (gramian + gramian.T) / 2
