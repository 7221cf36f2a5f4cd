"""The linear two-point problem of one Newton step: block-bidiagonal, solved by a banded LU in time linear in its elements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices


@dataclass(frozen=True, eq=False)
class TwoPointProblem:
    """x_(k+1) = M_k x_k + b_k, L x_0 = l and R x_N = r, for one M, L and R and any b, l and r.

    Rows stand in the order start, elements, end, so that elimination with row exchanges follows what decays forward and backward
    in the direction in which it does (C. de Boor, R. Weiss, "SOLVEBLOK", ACM TOMS 6, 1980); no product of the M_k is formed.

    Args:
        factors: the band's LU factors.
        exchanges: rows exchanged in it.
        widths: of the band below and above the diagonal.
        scale: sizes of the states (n,), in which rows and columns are measured.
        count: of the rows of L.
    """

    factors: Array
    exchanges: Indices
    widths: tuple[int, int]
    scale: Array
    count: int

    @classmethod
    def of(cls, M: Array, L: Array, R: Array, scale: Array) -> TwoPointProblem:
        """The problem for M (N, n, n), L (n_0, n) and R (n - n_0, n). Raises LinAlgError where it is singular, or not finite."""
        N, n = M.shape[:2]
        first = len(L)
        lower, upper = first + n - 1, max(2 * n - 1 - first, n - 1)
        band = np.zeros((2 * lower + upper + 1, n * (N + 1)))  # with room for the rows that exchanges bring

        def put(rows: Indices, columns: Indices, values: Array) -> None:
            band[lower + upper + rows - columns, columns] = values

        states = np.arange(n)
        put(np.arange(first)[:, None], states[None], L * scale)
        row = first + n * np.arange(N)[:, None, None] + states[:, None]
        column = n * np.arange(N)[:, None, None] + states[None, None]
        row, column = np.broadcast_arrays(row, column)
        put(row, column, -M * scale / scale[:, None])
        put(row[:, states, states], column[:, states, states] + n, np.ones((N, n)))
        put(first + n * N + np.arange(n - first)[:, None], n * N + states[None], R * scale)
        if not np.all(np.isfinite(band)):
            raise np.linalg.LinAlgError("the two-point problem holds numbers that are not finite")
        factors, exchanges, info = scipy.linalg.lapack.dgbtrf(band, lower, upper, overwrite_ab=True)
        if info > 0:
            raise np.linalg.LinAlgError("the two-point problem is singular")
        return cls(factors, exchanges, (lower, upper), scale, first)

    def solve(self, b: Array, left: Array, right: Array) -> Array:
        """x_0 ... x_N (N + 1, n) for b (N, n), l (n_0,) and r (n - n_0,)."""
        solution = self._substituted(np.concatenate([left, (b / self.scale).ravel(), right]), transposed=False)
        return np.asarray(solution.reshape(-1, len(self.scale)) * self.scale)

    def influence(self, start: Array, end: Array) -> Array:
        """How each b_k acts on what rows see of the two ends, start (a, n) of x_0, then end (c, n) of x_N: (a + c, N, n).

        One transposed solution per row, whatever the number of b that will be asked for.
        """
        n, unknowns = len(self.scale), self.factors.shape[1]
        rows = np.zeros((unknowns, len(start) + len(end)))
        rows[:n, : len(start)] = (start * self.scale).T
        rows[unknowns - n :, len(start) :] = (end * self.scale).T
        adjoint = self._substituted(rows, transposed=True)[self.count : unknowns - (n - self.count)]
        return np.asarray(adjoint.T.reshape(rows.shape[1], -1, n) / self.scale)

    def _substituted(self, rhs: Array, *, transposed: bool) -> Array:
        lower, upper = self.widths
        solution, _ = scipy.linalg.lapack.dgbtrs(self.factors, lower, upper, rhs, self.exchanges, trans=int(transposed))
        if not np.all(np.isfinite(solution)):
            raise np.linalg.LinAlgError("the two-point problem has no solution in finite numbers")
        return np.asarray(solution)
