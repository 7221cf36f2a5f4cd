"""Scales of states that bring a matrix's rows and columns to the same size, without rounding."""

from __future__ import annotations

import numpy as np
import scipy.linalg.lapack  # and not scipy.sparse: scipy loads it at its first use

from invtrack.arrays import Array, Indices

LARGEST_SCALE = 2.0**200
"""Bound on a scale and its inverse: where parts of a matrix do not act on each other, nothing else limits what is between them."""

NEWTON_STEPS, SMALL_STEP = 50, 0.1
"""Newton steps at most, and the step after which there are none: scales are rounded to powers of two."""

SINGULAR = 1e-10
"""Added to a Hessian of unit diagonal that is singular."""

SMALL = 64
"""Of so few states parts are found by products of matrices, several times as fast as by scipy's search of a sparse graph."""

LARGEST_LOGARITHM = 600.0
"""Bound on what is exponentiated on the way to balance."""


def balancing_scale(M: Array, *, within_parts: bool = False) -> Array:
    """Scales d (q,), powers of two, such that M d_j / d_i (q, q) has rows and columns of about equal size.

    M (q, q). Units of the states that differ by powers of two are undone exactly. within_parts: only states that act on each other
    both ways are scaled against each other. A triangular matrix can otherwise be brought as close to its diagonal as one likes, to
    coordinates in which its small entries drown in the rounding of the large ones.
    """
    if len(M) < 2:
        return np.ones(len(M))
    part = parts(M)
    inner = np.where(part[:, None] == part, M, 0.0)
    _, _, _, scale, _ = scipy.linalg.lapack.dgebal(inner if within_parts else M, scale=1, permute=0)
    exponent = np.log2(scale) + _smoothed(inner * scale / scale[:, None])
    ordered = np.sort(exponent)
    median = (ordered[(len(M) - 1) // 2] + ordered[len(M) // 2]) / 2
    return np.asarray(np.minimum(np.maximum(np.exp2(np.rint(exponent - median)), 1 / LARGEST_SCALE), LARGEST_SCALE))


def _smoothed(M: Array) -> Array:
    """Exponents of two x (q,) with which the sum of |M 2^(x_j - x_i)|^2 is least: a convex function, minimized by Newton's method.

    LAPACK's balancing goes from row to row and stops where no single one gains; along a chain of many masses in unlike units it
    leaves scales that drift by factors of thousands. M: in balanced units, none of its parts acts on another.
    """
    size = np.abs(M)
    np.fill_diagonal(size, 0.0)
    largest = size.max()
    if largest == 0:
        return np.zeros(len(M))
    with np.errstate(divide="ignore"):
        logarithm = 2 * np.log(size / largest)
    x, unit_diagonal = np.zeros(len(M)), (1 + SINGULAR) * np.eye(len(M))
    for _ in range(NEWTON_STEPS):
        squares = np.exp(np.minimum(logarithm + 2 * (x - x[:, None]), LARGEST_LOGARITHM))
        both = squares + squares.T
        diagonal: Array = np.sqrt(both.sum(axis=0))
        root = np.where(diagonal > 0, diagonal, 1.0)
        hessian = unit_diagonal - both / root / root[:, None]  # singular: scales of whole parts
        step = -0.5 * np.linalg.solve(hessian, (squares.sum(axis=0) - squares.sum(axis=1)) / root) / root
        x += np.minimum(np.maximum(step, -1.0), 1.0)
        if np.abs(step).max() < SMALL_STEP:
            break
    return np.asarray(x / np.log(2))


def parts(M: Array, *, one_way: bool = False) -> Indices:
    """The part that each index is in (q,): indices of a part act on each other, however weakly, both ways or one way."""
    pattern = M != 0
    if pattern.all():
        return np.zeros(len(M), dtype=np.intp)
    if len(M) > SMALL:
        graph = scipy.sparse.csr_array(pattern)  # of a dense matrix, scipy takes entries below 1e-8 for none
        return np.asarray(scipy.sparse.csgraph.connected_components(graph, connection="weak" if one_way else "strong")[1])
    reached = pattern | np.eye(len(M), dtype=bool)
    if one_way:
        reached |= reached.T
    for _ in range((len(M) - 1).bit_length()):  # paths of twice as many steps each time
        count = reached.astype(np.float32)
        reached = count @ count > 0
    return np.asarray(np.argmax(reached & reached.T, axis=1))


def pace_of(M: Array) -> float:
    """How fast exp(M t) changes [rad/s], free of the units of its states."""
    scale = balancing_scale(M, within_parts=True)
    return float(np.linalg.norm(M * scale / scale[:, None], 2))
