"""Modes of a free plant."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

OSCILLATION_TOLERANCE = 1e-6
"""An eigenvalue counts as an oscillation where its imaginary part exceeds this share of the fastest eigenvalue: a rigid-body mode's
double eigenvalue at zero is split by rounding to about sqrt(eps) of it."""


def slowest_flexible_period(A: NDArray[np.float64]) -> float:
    """Period 2 pi / |Im s| [s] of the slowest oscillatory eigenvalue s of A (n, n); NaN where nothing oscillates."""
    eigenvalues = np.linalg.eigvals(A)
    frequencies = np.abs(eigenvalues.imag)
    flexible = frequencies[frequencies > OSCILLATION_TOLERANCE * np.max(np.abs(eigenvalues), initial=0.0)]
    return float(2 * np.pi / flexible.min()) if flexible.size else float("nan")
