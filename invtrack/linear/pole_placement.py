"""Placing all poles of a pair (A, B): robustly where eigenvectors can be chosen, one after another where poles repeat too often."""

from __future__ import annotations

import warnings

import numpy as np
import scipy  # loads scipy.optimize and scipy.signal, which cost a second, at their first use

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.linear.schur_placement import schur_gain

PLACED_TOLERANCE = 1e-4
"""Placed poles must be met to this share of the largest; of a repeated one, which rounding splits, the mean."""

PLACED_ROUNDING = 1e-11
"""Rounding, of which the k-th root is what a pole of multiplicity k may be split by, as a share of the largest."""

LARGEST_SPLIT = 1e-2
"""However large the feedback is, of repeated poles no more than this share of the largest is put down to it."""

EQUAL_TOLERANCE = 1e-6
"""Poles closer than this share of the largest are one repeated pole."""


def repeated(poles: ComplexArray) -> list[Indices]:
    """Which poles are equal to within rounding: the indices of each distinct one."""
    near, left, found = EQUAL_TOLERANCE * float(np.max(np.abs(poles), initial=0.0)), np.arange(len(poles)), []
    while len(left):
        equal = np.abs(poles[left] - poles[left[0]]) <= near
        found.append(left[equal])
        left = left[~equal]
    return found


def placing_gain(A: Array, B: Array, poles: ComplexArray) -> Array | None:
    """F (p, n) such that A + B F has `poles` (n,), complex ones in conjugate pairs; None where they cannot be placed.

    The most robust gain that is found (Tits, Yang 1996); poles repeated more often than eigenvectors can be found for (more often
    than there are inputs, or than independent ways lead to them) are placed one after another instead (Varga 1981).

    A (n, n), B (n, p), in units in which the states and the inputs count alike.
    """
    try:
        with warnings.catch_warnings():
            # Iterations that end before the gain is at its most robust leave the poles in place, and these are checked below.
            warnings.filterwarnings("ignore", message="Convergence was not reached", category=UserWarning)
            robust = -np.asarray(scipy.signal.place_poles(A, B, poles).gain_matrix, dtype=float)
    except (ValueError, np.linalg.LinAlgError):  # poles repeated more often than eigenvectors can be found for
        robust = None
    if robust is not None and has_poles(A + B @ robust, poles):
        return robust
    gain = schur_gain(A, B, poles)
    return gain if gain is not None and has_poles(A + B @ gain, poles) else None


def has_poles(A: Array, poles: ComplexArray) -> bool:
    """Whether A (n, n) has these eigenvalues: each as exactly as its multiplicity lets it, repeated ones also in their mean."""
    if not np.all(np.isfinite(A)):
        return False
    found, size = np.linalg.eigvals(A), float(np.max(np.abs(poles), initial=0.0))
    which, order = scipy.optimize.linear_sum_assignment(np.abs(found[:, None] - poles))
    miss = np.empty(len(poles), dtype=complex)
    miss[order] = found[which] - poles[order]
    for equal in repeated(poles):
        if abs(np.mean(miss[equal])) > PLACED_TOLERANCE * size:
            return False
        split = PLACED_ROUNDING ** (1 / len(equal))
        # Rounding e |A| across a Jordan chain with steps of up to |A| splits it by (e |A| |A|^(k-1))^(1/k).
        allowed = max(PLACED_TOLERANCE, split, min(split * float(np.linalg.norm(A)) / size, LARGEST_SPLIT))
        if np.max(np.abs(miss[equal])) > allowed * size:
            return False
    return True
