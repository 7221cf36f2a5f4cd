"""Transitions of one matrix over many times: by powers between nodes, by Taylor series around them."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.linear.recurring_transitions import OFTEN, RecurringTransitions
from invtrack.linear.transition_powers import NODE_ANGLE, TransitionPowers, doublings

SPARSE = 16
"""Where fewer times than this share a node, every so many nodes are used: longer series cost less than more nodes."""

TERMS = {1: 9, SPARSE: 16}
"""Terms of the series around every node and around every 16th: the first one left out is below 1e-18 of the first.

All of them always, however close the times: of a chain of integrators in unlike units the last ones may be the largest.
"""

EVEN_ANGLE = 1e-9
"""Times that miss an even spacing by more than this over the pace are not taken for even, however coarsely they are rounded."""

LONG_STRETCH = 64
"""Fewer times than this in a stretch, or fewer than there are states, are not worth a look at their spacing."""

CHUNK = 8192
"""Times that are worked on together, at most."""

CHUNK_ENTRIES = 2**17
"""Entries of the states and values of a chunk, at most, so that its arrays stay in the processor's cache."""

ENTRYWISE = 4
"""How much longer an entry takes in a sum of arrays than in a product of matrices."""

ONE_BY_ONE = 16
"""Up to so many nodes are taken one by one, the times around each by a product of matrices."""


class TransitionSeries:
    """X exp(M tau) v for one matrix M (q, q), whose powers are known, and many tau >= 0 [s].

    Each tau is split into a whole number of node distances h, all of them or every 16th, and a remainder |r| of at most half of
    that. The nodes' states are found by the binary digits exp(M h 2^b), the way on from there by Taylor series, whose terms are
    the same for all times around a node; times that recur to within rounding share one transition instead. The error does not grow
    with the number of times, the cost is linear in it, and exponentials that decay never overflow, whatever tau.
    """

    def __init__(self, powers: TransitionPowers) -> None:
        self.powers, self._recurring = powers, RecurringTransitions(powers)
        self._M = powers.matrix * powers.step if math.isfinite(powers.step) else powers.matrix

    def matrices(self, tau: Array) -> Array:
        """exp(M tau_i) (m, q, q) for times tau (m,) [s], not negative: a few each by itself, many as states that start from 1."""
        scale, m, q = self.powers.scale, len(tau), len(self.powers.matrix)
        if math.isinf(self.powers.step):
            return np.tile(np.eye(q), (m, 1, 1))
        if m < OFTEN:
            found = [self._recurring.matrix(distance) for distance in (tau / self.powers.step).tolist()]
            return scale[:, None] * np.array(found).reshape(m, q, q) / scale
        columns = self.outputs(np.eye(q), np.eye(q), np.tile(np.arange(q), m), np.repeat(tau, q))
        return columns.reshape(m, q, q).swapaxes(1, 2)

    def outputs(self, X: Array, v: Array, owner: Indices, tau: Array, *, resolution: float = 0.0) -> Array:
        """X exp(M tau_i) v[owner_i] at many times: (m, k).

        Times in order, or in ordered stretches, share most of the work; long stretches of evenly spaced ones nearly all of it.

        Args:
            X: (k, q).
            v: states to start from (g, q).
            owner: which of these each time belongs to (m,).
            tau: times since the start (m,), not negative [s].
            resolution: how far off the times may be (from rounding of the absolute times behind tau) and still count as evenly
                spaced [s]; less where the states would change noticeably within it.
        """
        result = np.empty((len(tau), len(X)))
        if math.isinf(self.powers.step):
            np.matmul(v.take(owner, axis=0), X.T, out=result)
            return result
        rows, done = _Rows(X * self.powers.scale, self._M), 0
        for first, last in _long_stretches(owner, max(LONG_STRETCH, len(self._M))):
            spacing = _even_spacing(tau[first:last], min(resolution, EVEN_ANGLE / max(self.powers.pace, np.finfo(float).tiny)))
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
        halvings = max(0, math.ceil(math.log2(2 * NODE_ANGLE * spacing / self.powers.step)))
        transitions = doublings(self.powers.matrix, spacing, halvings)
        within = X[np.newaxis]
        while 4 * len(within) ** 2 * k <= m and 2 * len(within) * k <= CHUNK:  # as many entries as there are states, about
            within = np.concatenate([within, within @ next(transitions)])
        blocks = -(-m // len(within))
        states = np.empty((blocks, q))
        states[:1] = self._carried(v[np.newaxis] / self.powers.scale, np.zeros(1, dtype=np.intp), np.array([start]))
        filled = 1
        while filled < blocks:
            more = min(filled, blocks - filled)
            states[filled : filled + more] = states[:more] @ next(transitions).T
            filled += more
        result[:] = (states @ within.reshape(-1, q).T).reshape(-1, k)[:m]

    def _carried(self, v: Array, owner: Indices, tau: Array) -> Array:
        """exp(M tau_i) v[owner_i] in scaled coordinates."""
        cells = _Cells.of(tau / self.powers.step, owner)
        return self._summed(self._nodes(v.take(cells.owner, axis=0), cells.count), cells)

    def _scattered(self, rows: _Rows, v: Array, owner: Indices, tau: Array, result: Array) -> None:
        k, q = rows.X.shape
        length = min(CHUNK, max(LONG_STRETCH, CHUNK_ENTRIES // (k + q)))
        for first in range(0, len(tau), length):
            part = slice(first, first + length)
            distances, owners = tau[part] / self.powers.step, owner[part]
            recurring = self._recurring.recurring(distances)
            if recurring is not None and np.all(recurring.near):
                result[part] = self._recurring.values(rows.X, v, owners, recurring)
            elif recurring is not None:
                near = recurring.near
                result[part][near] = self._recurring.values(rows.X, v, owners[near], recurring.chosen)
                result[part][~near] = self._around_nodes(rows, v, owners[~near], distances[~near])
            else:
                result[part] = self._around_nodes(rows, v, owners, distances)

    def _around_nodes(self, rows: _Rows, v: Array, owner: Indices, distances: Array) -> Array:
        """X exp(M h distance_i) v[owner_i] (m, k), from the states at the nodes."""
        cells = _Cells.of(distances, owner)
        nodes = self._nodes(v.take(cells.owner, axis=0) / self.powers.scale, cells.count)
        (k, q), m, c, terms = rows.X.shape, len(cells.cell), len(nodes), cells.terms
        summed_first = terms * (c * q * q + ENTRYWISE * m * q) + m * k * q
        mapped_first = terms * ((c + q) * k * q + ENTRYWISE * m * k)
        if summed_first <= mapped_first:
            return np.asarray(self._summed(nodes, cells) @ rows.X.T)
        return rows.values(nodes, cells)

    def _summed(self, nodes: Array, cells: _Cells) -> Array:
        """The Taylor series from the cells' nodes to the times, (m, q)."""
        terms = [nodes]
        for j in range(1, cells.terms):
            terms.append(terms[-1] @ self._M.T / j)
        return cells.sums(np.array(terms))

    def _nodes(self, v: Array, count: NDArray[np.int64]) -> Array:
        """exp(M h count_i) v_i."""
        used = int(np.bitwise_or.reduce(count))
        for bit in range(used.bit_length()):
            if used >> bit & 1:
                chosen = np.flatnonzero(count >> bit & 1)
                v[chosen] = v.take(chosen, axis=0) @ self.powers.digit(bit).T
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

    def sums(self, coefficients: Array) -> Array:
        """sum_j coefficients[j, cell_i] remainder_i^j of power series around the nodes (terms, c, r): (m, r)."""
        c, m = len(self.count), len(self.cell)
        result = np.zeros((m, coefficients.shape[2]))
        if c <= ONE_BY_ONE:
            shares = np.vander(self.remainder, self.terms, increasing=True)
            edges = np.searchsorted(self.cell, np.arange(c + 1)).tolist()
            for number, (first, last) in enumerate(itertools.pairwise(edges)):
                np.matmul(shares[first:last], coefficients[:, number], out=result[first:last])
            return result
        share = self.remainder[:, None]
        for coefficient in coefficients[::-1]:
            result *= share
            result += coefficient.take(self.cell, axis=0)
        return result

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
        return cells.sums(nodes @ np.array(self._series[: cells.terms]).swapaxes(1, 2))


def _long_stretches(owner: Indices, long: int) -> list[tuple[int, int]]:
    """Where stretches of at least `long` times of one owner begin and end."""
    if len(owner) < long or not (owner[long - 1 :] == owner[: len(owner) - long + 1]).any():
        return []
    edges = np.concatenate([[0], np.flatnonzero(np.diff(owner)) + 1, [len(owner)]]).tolist()
    return [(first, last) for first, last in itertools.pairwise(edges) if last - first >= long]


def _even_spacing(tau: Array, resolution: float) -> float | None:
    """The spacing of times that are even to within the resolution from the earliest on, or None; negative for falling times."""
    spacing = float((tau[-1] - tau[0]) / (len(tau) - 1))
    if abs(spacing) <= resolution:
        return None
    rising = tau if spacing > 0 else tau[::-1]
    even = np.max(np.abs(rising - (rising[0] + abs(spacing) * np.arange(len(tau))))) <= resolution
    return spacing if even else None
