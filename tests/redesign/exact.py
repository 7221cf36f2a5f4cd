"""Matrices in exact rational arithmetic."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from invtrack.redesign.double_double import DoubleDouble

Exact = NDArray[np.object_]


def exact(matrix: DoubleDouble | NDArray[np.float64]) -> Exact:
    """The matrix as it is, without rounding."""
    if isinstance(matrix, DoubleDouble):
        return np.asarray(exact(matrix.high) + exact(matrix.low))
    return np.array([[Fraction(float(entry)) for entry in row] for row in matrix], dtype=object)


def largest(matrix: Exact) -> float:
    """The largest entry's size."""
    return max(abs(float(entry)) for entry in matrix.ravel())
