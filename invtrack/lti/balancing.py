"""Scales of states that bring a matrix's rows and columns to the same size, without rounding."""

from __future__ import annotations

import numpy as np
import scipy.linalg.lapack
import scipy.sparse.csgraph
from numpy.typing import NDArray

Array = NDArray[np.float64]

LARGEST_SCALE = 2.0**60
"""Bound on a scale and its inverse: where parts of a matrix do not act on each other, nothing else limits what is between them."""


def balancing_scale(M: Array, *, within_parts: bool = False) -> Array:
    """Scales d (q,), powers of two, such that M d_j / d_i (q, q) has rows and columns of about equal size.

    M (q, q). Units of the states that differ by powers of two are undone exactly. within_parts: only states that act on each other
    both ways are scaled against each other. A triangular matrix can otherwise be brought as close to its diagonal as one likes, to
    coordinates in which its small entries drown in the rounding of the large ones.
    """
    if not M.size:
        return np.ones(0)
    if within_parts:
        _, part = scipy.sparse.csgraph.connected_components(M, directed=True, connection="strong")
        M = np.where(part[:, None] == part, M, 0.0)
    _, _, _, scale, _ = scipy.linalg.lapack.dgebal(M, scale=1, permute=0)
    exponent = np.log2(scale)
    return np.asarray(np.clip(np.exp2(np.rint(exponent - np.median(exponent))), 1 / LARGEST_SCALE, LARGEST_SCALE))
