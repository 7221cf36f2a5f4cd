"""The oscillations of a linear model, told from what rounding makes of modes that do not oscillate."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np

from invtrack.arrays import Array, ComplexArray
from invtrack.linear.pseudospectrum import Pseudospectrum
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace, as_state_space

ROUNDING = 1e-14
"""Share of an entry's row and column, their geometric mean, by which rounding may have changed it where it is not zero."""


def slowest_flexible_period(system: Any) -> float:
    """Period 2 pi / |Im s| [s] of the slowest oscillatory eigenvalue s of A; NaN where nothing oscillates.

    See `oscillatory_eigenvalues`. system: StateSpace, or anything with A, B, C, D. Raises ModelError for anything else.
    """
    return _slowest_period(as_state_space(system))


@lru_cache(maxsize=64)
def _slowest_period(system: StateSpace) -> float:
    """The same, remembered: a sweep asks for it again in every run."""
    found = oscillatory_eigenvalues(system).imag
    return float(2 * np.pi / found.min()) if found.size else float("nan")


def oscillatory_eigenvalues(system: Any) -> ComplexArray:
    """The eigenvalues of A (k,) [rad/s] that oscillate, one of each pair, with a positive imaginary part.

    A pair of eigenvalues oscillates where no change of A as small as its errors (its `error_estimates`, and rounding) joins the two
    on the real axis: a rigid body's double eigenvalue at zero is split by them to the root of their size, and of a body on which
    nothing acts all of them are such.

    system: StateSpace, or anything with A, B, C, D. Raises ModelError for anything else.
    """
    system = as_state_space(system)
    errors = _errors(system)
    scale = balancing_scale(errors)  # units in which the errors' norm says about as much as each of them
    A, errors = (matrix * scale / scale[:, None] for matrix in (system.A, errors))
    eigenvalues = np.linalg.eigvals(A)
    pairs = eigenvalues[eigenvalues.imag > 0]
    return np.asarray(pairs[~Pseudospectrum(A).joins_real(pairs, float(np.linalg.norm(errors)))], dtype=complex)


def _errors(system: StateSpace) -> Array:
    """By how much each entry of A may be off (n, n)."""
    estimated = system.errors("A")
    size = np.where(np.abs(system.A) > estimated, np.abs(system.A), 0.0)
    scale = balancing_scale(size)
    balanced = size * scale / scale[:, None]
    around = np.sqrt(np.outer(np.max(balanced, axis=1), np.max(balanced, axis=0))) * scale[:, None] / scale
    return np.asarray(estimated + np.where(size > 0, ROUNDING * around, 0.0))
