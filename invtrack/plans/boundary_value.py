"""The linear boundary value problem behind every bounded inverse, solved by ordered orthogonal elimination."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices

RANK_TOLERANCE = 1e-9
"""A pivot below this share of the largest one of its block counts as zero (rows and unknowns come scaled to unit size)."""

BLOCK = 64
"""Columns that LAPACK works on together, at most: what its workspace is made for."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Linear conditions left v_k + right v_(k+1) = rhs between two neighbouring intervals (or, without `right`, at one end)."""

    left: Array
    right: Array
    rhs: Array


@dataclass(frozen=True, eq=False)
class BoundaryValueSolution:
    """Values v_k of each interval, and what the conditions leave open.

    Args:
        values: v_k (n_k,) of each interval, those of least norm where something is left open.
        directions: what may be added to them (n_k, f), the same combination of columns in every interval.
        inconsistency: per junction, then at the end, how far the conditions that are left without unknowns are from holding.
        conditioning: smallest ratio of a pivot to the largest of its block that was accepted (1 is best).
    """

    values: list[Array]
    directions: list[Array]
    inconsistency: Array
    conditioning: float

    @property
    def freedom(self) -> int:
        """How many of the unknowns the conditions leave open, f."""
        return int(self.directions[0].shape[1])

    def along(self, weights: Array) -> BoundaryValueSolution:
        """The solution with this combination (f,) of the open directions added."""
        moved = [v + d @ weights for v, d in zip(self.values, self.directions, strict=True)]
        return replace(self, values=moved)


@dataclass(frozen=True, eq=False)
class _Step:
    """v_k = fixed - coupling v_(k+1) + free beta_k after elimination of block k."""

    fixed: Array
    coupling: Array
    free: Array


def solve(first: Conditions, junctions: Sequence[Conditions], last: Conditions) -> BoundaryValueSolution:
    """Unknowns v_0 ... v_N from conditions at the first end, at each junction, and at the last end.

    Each block is eliminated by a pivoted QR factorization of the conditions that hold it, those left over are carried on to the
    next block: the cost is linear in the number of junctions, no product of transition matrices over several intervals is formed,
    and the ordering keeps decaying directions (known at the start) and growing ones (known at the end) apart. `first.right` and
    `last.right` are not used.
    """
    rows, rhs = first.left, first.rhs
    steps: list[_Step] = []
    inconsistency: list[float] = []
    conditioning = 1.0
    for junction in junctions:
        left = np.vstack([rows, junction.left])
        right = np.vstack([np.zeros((len(rows), junction.right.shape[1])), junction.right])
        step, rows, rhs, quality = _eliminate(left, right, np.concatenate([rhs, junction.rhs]))
        steps.append(step)
        rows, rhs, left_over = _compress(rows, rhs)
        inconsistency.append(left_over)
        conditioning = min(conditioning, quality)
    left = np.vstack([rows, last.left])
    step, _, rhs, quality = _eliminate(left, np.zeros((len(left), 0)), np.concatenate([rhs, last.rhs]))
    inconsistency.append(float(np.max(np.abs(rhs), initial=0.0)))
    values, directions = _substitute_back([*steps, step])
    return BoundaryValueSolution(values, directions, np.array(inconsistency), min(conditioning, quality))


def _eliminate(left: Array, right: Array, rhs: Array) -> tuple[_Step, Array, Array, float]:
    """Solve for the left unknowns as far as the conditions determine them; what remains are conditions on the right ones."""
    n = left.shape[1]
    R, order, pivots, turned = _triangle(left, np.column_stack([rhs, right]))
    rank = len(pivots)
    solved = np.zeros((n, turned.shape[1]))
    free = np.zeros((n, n - rank))
    if rank:
        solution, _ = scipy.linalg.lapack.dtrtrs(R[:, :rank], np.hstack([turned[:rank], -R[:, rank:]]))
        solved[order[:rank]], free[order[:rank]] = np.hsplit(solution, [turned.shape[1]])
        free[order[rank:]] = np.eye(n - rank)
    else:
        free[:] = np.eye(n)
    quality = float(pivots[-1] / pivots[0]) if rank else 1.0
    return _Step(solved[:, 0], solved[:, 1:], free), turned[rank:, 1:], turned[rank:, 0], quality


def _compress(rows: Array, rhs: Array) -> tuple[Array, Array, float]:
    """Independent conditions with the same content, and the size of what the dependent ones fail by."""
    if rows.size == 0:
        return rows, rhs, float(np.max(np.abs(rhs), initial=0.0)) if rows.shape[1] == 0 else 0.0
    R, order, pivots, turned = _triangle(rows, rhs[:, np.newaxis])
    rank = len(pivots)
    compressed = np.empty_like(R)
    compressed[:, order] = np.triu(R)
    return compressed, turned[:rank, 0], float(np.max(np.abs(turned[rank:]), initial=0.0))


def _triangle(M: Array, others: Array) -> tuple[Array, Indices, Array, Array]:
    """R (rank, n) with Q'M = [R; 0] but for the columns' order (n,), the sizes of its pivots (rank,), and Q'others.

    What lies below the diagonal of R is to be left alone. LAPACK itself, without Q: for many small blocks the checks and copies
    around it would cost more.
    """
    if M.size == 0:
        return np.zeros((0, M.shape[1])), np.arange(M.shape[1]), np.zeros(0), others
    n, width = M.shape[1], others.shape[1]
    packed, order, tau, _, _ = scipy.linalg.lapack.dgeqp3(M, lwork=2 * n + (n + 1) * BLOCK)
    turned, _, _ = scipy.linalg.lapack.dormqr("L", "T", packed[:, : len(tau)], tau, others, lwork=(width + BLOCK + 1) * BLOCK * 2)
    pivots = np.abs(packed.diagonal())
    rank = int(np.count_nonzero(pivots > RANK_TOLERANCE * max(pivots[0], RANK_TOLERANCE)))
    return packed[:rank], order - 1, pivots[:rank], turned


def _substitute_back(steps: list[_Step]) -> tuple[list[Array], list[Array]]:
    """Values from the last block to the first, those of least norm, and the directions that are open, orthonormal over all blocks.

    At each block the columns are made orthonormal over all blocks so far, and the particular solution orthogonal to them:
    directions that grow from block to block would otherwise swamp what is to be found.
    """
    columns = np.zeros((0, 1))  # v_(k+1): its particular value, then one column per open direction found so far
    blocks: list[Array] = []
    changes: list[tuple[Array, Array]] = []
    for step in reversed(steps):
        value = -step.coupling @ columns if len(columns) else np.zeros((len(step.fixed), columns.shape[1]))
        value[:, 0] += step.fixed
        if step.free.size:
            value = np.hstack([value, step.free])
        known, total = columns.shape[1] - 1, value.shape[1] - 1
        shift, basis, columns = np.zeros(0), np.zeros((0, 0)), value
        if total:
            # Over the earlier blocks the columns are orthonormal, the new ones zero, the particular solution orthogonal to both.
            Q, R = np.linalg.qr(np.vstack([np.eye(known, total), value[:, 1:]]))
            shift = -scipy.linalg.solve_triangular(R, Q[known:].T @ value[:, 0])
            basis = scipy.linalg.solve_triangular(R, np.eye(total))
            columns = np.column_stack([value[:, 0] + value[:, 1:] @ shift, value[:, 1:] @ basis])
        blocks.append(columns)
        changes.append((shift[:known], basis[:known]))
    open_count = columns.shape[1] - 1
    weights = np.eye(open_count, open_count + 1, k=1)  # in the first column nothing of the directions, in the others one of each
    found: list[Array] = []
    for block, (shift, basis) in zip(reversed(blocks), reversed(changes), strict=True):
        at = block[:, 1:] @ weights
        at[:, 0] += block[:, 0]
        found.append(at)
        weights = basis @ weights
        weights[:, 0] += shift
    return [at[:, 0] for at in found], [at[:, 1:] for at in found]
