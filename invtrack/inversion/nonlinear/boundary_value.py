"""The linear two-point problem of one Newton step: block-bidiagonal, solved by a banded LU in time linear in its elements."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices


def solve_bidiagonal(M: Array, b: Array, start: tuple[Array, Array], end: tuple[Array, Array], scale: Array) -> Array:
    """x_0 ... x_N (N + 1, n) with x_(k+1) = M_k x_k + b_k, L x_0 = l and R x_N = r.

    Rows stand in the order start, elements, end, so that elimination with row exchanges follows what decays forward and backward
    in the direction in which it does (C. de Boor, R. Weiss, "SOLVEBLOK", ACM TOMS 6, 1980); no product of the M_k is formed.

    Args:
        M: (N, n, n).
        b: (N, n).
        start: L (n_0, n) and l (n_0,).
        end: R (n - n_0, n) and r (n - n_0,).
        scale: sizes of the states (n,), in which rows and columns are measured.

    Raises LinAlgError where the problem is singular.
    """
    N, n = b.shape
    (L, left), (R, right) = start, end
    first = len(left)
    lower, upper = first + n - 1, max(2 * n - 1 - first, n - 1)
    band = np.zeros((lower + upper + 1, n * (N + 1)))

    def put(rows: Indices, columns: Indices, values: Array) -> None:
        band[upper + rows - columns, columns] = values

    states = np.arange(n)
    put(np.arange(first)[:, None], states[None], L * scale)
    row = first + n * np.arange(N)[:, None, None] + states[:, None]
    column = n * np.arange(N)[:, None, None] + states[None, None]
    row, column = np.broadcast_arrays(row, column)
    put(row, column, -M * scale / scale[:, None])
    put(row[:, states, states], column[:, states, states] + n, np.ones((N, n)))
    put(first + n * N + np.arange(n - first)[:, None], n * N + states[None], R * scale)
    rhs = np.concatenate([left, (b / scale).ravel(), right])
    solution = scipy.linalg.solve_banded((lower, upper), band, rhs, overwrite_ab=True, overwrite_b=True, check_finite=True)
    return np.asarray(solution.reshape(N + 1, n) * scale)
