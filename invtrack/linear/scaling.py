"""Scales of states that bring a matrix's rows and columns to the same size, without rounding."""

from __future__ import annotations

import numpy as np
import scipy.linalg.lapack
import scipy.sparse
import scipy.sparse.csgraph
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.linear.switched import SwitchedSystem

LARGEST_SCALE = 2.0**60
"""Bound on a scale and its inverse: where parts of a matrix do not act on each other, nothing else limits what is between them."""

RESOLVED = 1e-3
"""A state that stays below this share of those comparable to it may consist of their rounding alone."""


def balancing_scale(M: Array, *, within_parts: bool = False) -> Array:
    """Scales d (q,), powers of two, such that M d_j / d_i (q, q) has rows and columns of about equal size.

    M (q, q). Units of the states that differ by powers of two are undone exactly. within_parts: only states that act on each other
    both ways are scaled against each other. A triangular matrix can otherwise be brought as close to its diagonal as one likes, to
    coordinates in which its small entries drown in the rounding of the large ones.
    """
    if not M.size:
        return np.ones(0)
    if within_parts:
        part = _parts(M)
        M = np.where(part[:, None] == part, M, 0.0)
    _, _, _, scale, _ = scipy.linalg.lapack.dgebal(M, scale=1, permute=0)
    exponent = np.log2(scale)
    return np.asarray(np.clip(np.exp2(np.rint(exponent - np.median(exponent))), 1 / LARGEST_SCALE, LARGEST_SCALE))


def _parts(M: Array) -> Indices:
    """The part that each index is in (q,): indices of a part act on each other both ways, however weakly."""
    # The pattern as a sparse matrix: of a dense one, scipy takes entries below 1e-8 for none.
    return np.asarray(scipy.sparse.csgraph.connected_components(scipy.sparse.csr_array(M != 0), connection="strong")[1])


def pace_of(M: Array) -> float:
    """How fast exp(M t) changes [rad/s], free of the units of its states."""
    scale = balancing_scale(M, within_parts=True)
    return float(np.linalg.norm(M * scale / scale[:, None], 2))


def loop_units(A: Array, B: Array, C: Array) -> tuple[Array, Array]:
    """Units (n,) of the states and (p,) of the inputs in which they, and the outputs, act on each other with similar strength."""
    scale, n = balancing_scale(_loop(np.abs(A), np.abs(B), np.abs(C))), len(A)
    return scale[:n], scale[n : n + B.shape[1]]


def _loop(A: Array, B: Array, C: Array) -> Array:
    """The couplings (n + 2 p, n + 2 p) of states, inputs and outputs where every output is fed back to every input."""
    n, p = B.shape
    return np.block([[A, B, np.zeros((n, p))], [np.zeros((p, n + p)), np.ones((p, p))], [C, np.zeros((p, 2 * p))]])


def unit_ratios(plant: SwitchedSystem) -> Array:
    """Size (n, n) that state i has where state j is 1, from how strongly they act on each other; 0 for those that do not.

    They act through the plant, and through an inverse, which makes the input from the outputs: the position of a base that can
    stand anywhere acts on nothing else in the plant, but an inverse finds it from where the tip is to be.
    """
    A, B, C = (np.max([np.abs(getattr(system, name)) for system in plant.distinct], axis=0) for name in "ABC")
    loop, n = _loop(A, B, C), len(A)
    scale, part = balancing_scale(loop, within_parts=True)[:n], _parts(loop)[:n]
    return np.asarray(np.where(part[:, None] == part, scale[:, None] / scale, 0.0))


def comparable_size(size: Array, ratios: Array) -> Array:
    """Sizes (..., n) of states, each at least the share RESOLVED of what comparable ones (`unit_ratios`) make of it."""
    return np.asarray(np.maximum(size, RESOLVED * np.max(ratios * size[..., None, :], axis=-1, initial=0.0)))


def idle_states(plant: SwitchedSystem) -> NDArray[np.bool_]:
    """Which states no input moves, not even through other states (n,): in a plan that starts at rest they stay zero."""
    A, B = (np.max([np.abs(getattr(system, name)) for system in plant.distinct], axis=0) > 0 for name in "AB")
    moved = np.any(B, axis=1)
    for _ in range(plant.n_states):
        moved = moved | np.any(A[:, moved], axis=1)
    return np.asarray(~moved, dtype=bool)


def with_idle_sizes(size: Array, rate: Array, plant: SwitchedSystem) -> Array:
    """Sizes (n,) of states, those of idle ones by what shows in the states and outputs that they act on (the share RESOLVED of it).

    What an idle state holds is rounding, and has no size of its own. One that acts on nothing is as large as one likes. size (n,):
    of the states; rate (n,): of the terms that make up their derivatives.
    """
    idle = idle_states(plant)
    if not np.any(idle):
        return size
    A, C = (np.max([np.abs(getattr(system, name)) for system in plant.distinct], axis=0) for name in "AC")
    effects = np.vstack([A - np.diag(np.diag(A)), C])
    settled = np.concatenate([~idle, np.ones(len(C), dtype=bool)])
    size, ratios = np.where(idle, 0.0, size), unit_ratios(plant)
    while True:
        terms = np.concatenate([np.where(idle, A @ size, rate), C @ size])[:, None]
        acts = (effects > 0) & settled[:, None]
        reach = np.min(np.where(acts, terms / np.where(acts, effects, 1.0), np.inf), axis=0)
        found = idle & ~settled[: len(A)] & np.isfinite(reach)
        if not np.any(found):
            return np.where(settled[: len(A)], size, np.inf)
        size = np.where(found, RESOLVED * reach, size)
        alike = np.max(ratios * size, axis=1)  # those that act on each other both ways are of comparable size
        size = np.where(idle & (size == 0), alike, size)
        settled[: len(A)] |= idle & (size > 0)
