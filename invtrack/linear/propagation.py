"""Solutions of linear systems over time: at many times at once, over many pieces, and over holds."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.transition_powers import (
    NODE_ANGLE,
    DrivenPowers,
    OwnPowers,
    TransitionPowers,
    TransposedPowers,
    doublings,
    exponential_less_one,
)

SPARSE = 16
"""Where fewer times than this share a node, every so many nodes are used: longer series cost less than more nodes."""

TERMS = {1: 9, SPARSE: 16}
"""Terms of the series around every node and around every 16th: the first one left out is below 1e-18 of the first.

All of them always, however close the times: of a chain of integrators in unlike units the last ones may be the largest.
"""

LONG_STRETCH = 64
"""Fewer times than this in a stretch, or fewer than there are states, are not worth a look at their spacing."""

CHUNK = 8192
"""Times that are worked on together, at most."""

CHUNK_ENTRIES = 2**17
"""Entries of the states and values of a chunk, at most, so that its arrays stay in the processor's cache."""

ENTRYWISE = 4
"""How much longer an entry takes in a sum of arrays than in a product of matrices."""

VAN_LOAN_NORM = 0.5
"""Norm up to which a Gramian is read off one exponential; beyond, that of a shorter time is doubled, which cancels nothing."""


class Propagator:
    """exp(M tau) for one matrix M (q, q) and many tau >= 0 [s].

    Each tau is split into a whole number of node distances h, all of them or every 16th, and a remainder |r| of at most half of
    that. The nodes' states are found by the binary digits exp(M h 2^b), the way on from there by Taylor series, whose terms are
    the same for all times around a node. The error does not grow with the number of times, the cost is linear in it, and
    exponentials that decay never overflow, whatever tau.
    """

    def __init__(self, M: Array, powers: TransitionPowers | None = None) -> None:
        """M (q, q); powers: of M, where they are known from another matrix's."""
        self.M, self._powers = M, powers or OwnPowers(M)

    @property
    def size(self) -> int:
        """Number of states q."""
        return len(self.M)

    @cached_property
    def pace(self) -> float:
        """How fast exp(M t) changes [rad/s], free of the units of its states; 0 without states."""
        return float(np.linalg.norm(self._powers.matrix, 2)) if self.M.size else 0.0

    @cached_property
    def eigenvalues(self) -> ComplexArray:
        """Those of M (q,) [rad/s]."""
        return np.linalg.eigvals(self.M).astype(complex)

    @cached_property
    def growth(self) -> float:
        """The largest real part of M's eigenvalues [1/s]; minus infinity without states."""
        return float(np.max(self.eigenvalues.real, initial=-math.inf))

    @cached_property
    def transposed(self) -> Propagator:
        """That of M', which shares what is worked out for M."""
        return Propagator(self.M.T, TransposedPowers(self._powers))

    def driven(self, D: Array, S: Array) -> Propagator:
        """That of [M D; 0 S], which shares what is worked out for M: D (q, r), S (r, r)."""
        M = np.block([[self.M, D], [np.zeros((len(S), self.size)), S]])
        return Propagator(M, None if math.isinf(self._powers.step) else DrivenPowers(self._powers, D, S))

    def matrix(self, tau: float) -> Array:
        """exp(M tau) (q, q) for one time tau [s], not negative."""
        q = self.size
        if math.isinf(self._powers.step):
            return np.eye(q)
        count = round(tau / self._powers.step)
        share = tau / self._powers.step - count
        result = np.eye(q) + exponential_less_one(self._powers.matrix * (self._powers.step * share))
        for bit in range(count.bit_length()):
            if count >> bit & 1:
                result = self._powers.digit(bit) @ result
        return self._powers.scale[:, None] * result / self._powers.scale

    def states(self, v: Array, tau: Array) -> Array:
        """exp(M tau_i) v_i for states v (m, q) and times tau (m,) [s]: (m, q)."""
        return self.outputs(np.eye(self.size), v, np.arange(len(tau)), tau)

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
        if math.isinf(self._powers.step):
            np.matmul(v[owner], X.T, out=result)
            return result
        rows, v = _Rows(X * self._powers.scale, self._powers.matrix * self._powers.step), v / self._powers.scale
        long = max(LONG_STRETCH, self.size)
        edges = np.concatenate([[0], np.flatnonzero(np.diff(owner)) + 1, [len(tau)]]) if len(tau) else np.zeros(1, dtype=int)
        done = 0
        for stretch in np.flatnonzero(np.diff(edges) >= long):
            first, last = edges[stretch : stretch + 2].tolist()
            spacing = _even_spacing(tau[first:last], resolution)
            if spacing is None:
                continue
            before, part = slice(done, first), slice(first, last)
            self._scattered(rows, v, owner[before], tau[before], result[before])
            if spacing > 0:
                self._even(rows.X, v[owner[first]], tau[first], spacing, result[part])
            else:
                self._even(rows.X, v[owner[first]], tau[last - 1], -spacing, result[part][::-1])
            done = last
        self._scattered(rows, v, owner[done:], tau[done:], result[done:])
        return result

    def _even(self, X: Array, v: Array, start: float, spacing: float, result: Array) -> None:
        """result[j] = X exp(M (start + j spacing)) v: the states at every B-th time, times X exp(M i spacing) for i < B."""
        m, (k, q) = len(result), X.shape
        halvings = max(0, math.ceil(math.log2(2 * NODE_ANGLE * spacing / self._powers.step)))
        transitions = doublings(self._powers.matrix, spacing, halvings)
        within = X[np.newaxis]
        while 4 * len(within) ** 2 * k <= m and 2 * len(within) * k <= CHUNK:  # as many entries as there are states, about
            within = np.concatenate([within, within @ next(transitions)])
        blocks = -(-m // len(within))
        states = np.empty((blocks, q))
        states[:1] = self._carried(v[np.newaxis], np.zeros(1, dtype=np.intp), np.array([start]))
        filled = 1
        while filled < blocks:
            more = min(filled, blocks - filled)
            states[filled : filled + more] = states[:more] @ next(transitions).T
            filled += more
        result[:] = (states @ within.reshape(-1, q).T).reshape(-1, k)[:m]

    def _carried(self, v: Array, owner: Indices, tau: Array) -> Array:
        """exp(M tau_i) v[owner_i] in scaled coordinates."""
        cells = _Cells.of(tau / self._powers.step, owner)
        return self._summed(self._nodes(v[cells.owner], cells.count), cells)

    def _scattered(self, rows: _Rows, v: Array, owner: Indices, tau: Array, result: Array) -> None:
        k, q = rows.X.shape
        length = min(CHUNK, max(LONG_STRETCH, CHUNK_ENTRIES // (k + q)))
        for first in range(0, len(tau), length):
            part = slice(first, first + length)
            cells = _Cells.of(tau[part] / self._powers.step, owner[part])
            nodes = self._nodes(v[cells.owner], cells.count)
            m, c, terms = len(cells.cell), len(nodes), cells.terms
            summed_first = terms * (c * q * q + ENTRYWISE * m * q) + m * k * q
            mapped_first = terms * ((c + q) * k * q + ENTRYWISE * m * k)
            if summed_first <= mapped_first:
                np.matmul(self._summed(nodes, cells), rows.X.T, out=result[part])
            else:
                result[part] = rows.values(nodes, cells)

    def _summed(self, nodes: Array, cells: _Cells) -> Array:
        """The Taylor series from the cells' nodes to the times, (m, q)."""
        M, share = self._powers.matrix.T * self._powers.step, cells.remainder
        term, result = nodes, nodes[cells.cell]
        for j in range(1, cells.terms):
            term = term @ M / j
            result += share[:, None] ** j * term[cells.cell]
        return result

    def _nodes(self, v: Array, count: NDArray[np.int64]) -> Array:
        """exp(M h count_i) v_i."""
        for bit in range(int(count.max(initial=0)).bit_length()):
            chosen = (count >> bit) & 1 == 1
            if np.any(chosen):
                v[chosen] = v[chosen] @ self._powers.digit(bit).T
        return v


@dataclass(frozen=True, eq=False)
class _Cells:
    """Times in node distances, by the cells around nodes in which neighbouring ones lie together.

    Args:
        cell: of each time (m,).
        remainder: of each time from its cell's node (m,), within half the cells' width, 1/2 or SPARSE / 2.
        owner, count: of each cell, whose it is and how many node distances its node lies from the start (c,).
        terms: how many the Taylor series need.
    """

    cell: Indices
    remainder: Array
    owner: Indices
    count: NDArray[np.int64]
    terms: int

    @classmethod
    def of(cls, distance: Array, owner: Indices) -> _Cells:
        wide = cls._of_width(SPARSE, distance, owner)
        return wide if len(distance) < SPARSE * len(wide.count) else cls._of_width(1, distance, owner)

    @classmethod
    def _of_width(cls, width: int, distance: Array, owner: Indices) -> _Cells:
        count = width * np.rint(distance / width)
        new = np.ones(len(distance), dtype=bool)
        new[1:] = (count[1:] != count[:-1]) | (owner[1:] != owner[:-1])
        return cls(np.cumsum(new) - 1, distance - count, owner[new], count[new].astype(np.int64), TERMS[width])


class _Rows:
    """X (k, q), and X M^j / j! from which values around a node follow without its states; M (q, q) in node distances."""

    def __init__(self, X: Array, M: Array) -> None:
        self.X, self._M, self._series = X, M, [X]

    def values(self, nodes: Array, cells: _Cells) -> Array:
        """X exp(M remainder_i) nodes[cell_i], (m, k)."""
        while len(self._series) < cells.terms:
            self._series.append(self._series[-1] @ self._M / len(self._series))
        share = cells.remainder[:, None]
        result = np.zeros((len(cells.cell), len(self.X)))
        for term in reversed(self._series[: cells.terms]):
            result *= share
            result += (nodes @ term.T)[cells.cell]
        return result


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
