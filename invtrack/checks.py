"""Numbers that a user hands over, as arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import TrajectoryError

Array = NDArray[np.float64]


def real_numbers(name: str, value: ArrayLike) -> Array:
    """A copy as real numbers; TrajectoryError with the name of what is none."""
    try:
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise TrajectoryError(f"{name} must be real numbers, got {value!r}: {error}") from error


def real_matrix(name: str, value: ArrayLike) -> Array:
    """A copy as a matrix of finite real numbers, a row as one of one row; TrajectoryError for anything else."""
    matrix = np.atleast_2d(real_numbers(name, value))
    if matrix.ndim != 2 or not np.all(np.isfinite(matrix)):
        raise TrajectoryError(f"{name} must be a matrix of finite real numbers, got shape {matrix.shape}")
    return matrix
