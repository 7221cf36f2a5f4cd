"""The linear equations that join the intervals of a switched plant: state and costate are continuous at every jump."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
from numpy.typing import NDArray

from invtrack.redesign.optimal.interval import Interval

Array = NDArray[np.float64]


def join(intervals: Sequence[Interval], xi_first: Array, s_last: Array) -> list[tuple[Array, Array]]:
    """(xi at its start, s at its end) of each interval, both (n,).

    xi_first: the bounded xi before the manoeuvre; s_last: the bounded s after it. At a jump M_f xi + M_b s is the same from both
    sides, M_f and M_b being the `continuous_f` and `continuous_b` of each. The transition matrices in these equations only decay,
    so that nothing overflows however long the intervals are (multiple shooting), and the matrix is banded.
    """
    n = len(xi_first)
    if len(intervals) == 1:
        return [(xi_first, s_last)]
    identity = np.eye(n)
    blocks: list[list[Array | None]] = [[None] * (2 * len(intervals)) for _ in range(len(intervals) + 1)]
    rhs = [xi_first]
    blocks[0][0] = identity
    for k, (left, right) in enumerate(itertools.pairwise(intervals)):
        a, b = left.optimum, right.optimum
        row = blocks[k + 1]
        row[2 * k], row[2 * k + 1] = a.continuous_f @ left.E_f, a.continuous_b
        row[2 * k + 2], row[2 * k + 3] = -b.continuous_f, -b.continuous_b @ right.E_b
        rhs.append(b.continuous_b @ right.p_b - a.continuous_f @ left.p_f)
    blocks[-1][-1] = identity
    rhs.append(s_last)
    equations = scipy.sparse.block_array(blocks, format="csr")
    # States and costates have different units: rows of equal size make the pivoting independent of them.
    scale = 1 / np.maximum(abs(equations).max(axis=1).toarray().ravel(), np.finfo(float).tiny)
    matrix = scipy.sparse.csc_array(scipy.sparse.diags_array(scale) @ equations)
    values = scipy.sparse.linalg.spsolve(matrix, scale * np.concatenate(rhs)).reshape(len(intervals), 2, n)
    return [(value[0], value[1]) for value in values]
