"""Sparse matrices as sums of small blocks that repeat."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse import csr_array

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

Entries = tuple[Array, Indices, Indices]


def entries_of(block: Array, rows: Indices, columns: Indices) -> Entries:
    """The same block (r, c) at rows (k, r) and columns (k, c), k times."""
    shape = (len(rows), *block.shape)
    return (
        np.broadcast_to(block, shape).ravel(),
        np.broadcast_to(rows[:, :, None], shape).ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )


def sparse_sum(entries: Sequence[Entries], shape: tuple[int, int]) -> csr_array:
    """The sum of all entries."""
    data, rows, columns = (np.concatenate([entry[k] for entry in entries]) for k in range(3))
    return scipy.sparse.csr_array(scipy.sparse.coo_array((data, (rows, columns)), shape=shape))
