"""Which zeros of a plant are hidden modes: modes that no input moves, or that no output shows."""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy  # loads scipy.optimize at its first use
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

ZeroKind = Literal["transmission zero", "uncontrollable mode", "unobservable mode", "uncontrollable and unobservable mode"]
"""Transmission zeros act on the transfer function; the others are decoupling zeros: input, output, input-output (Rosenbrock)."""

COUPLING_TOLERANCE = 1e-10
"""A coupling counts as none below this share of the norm of A in balanced states, or of an input's column or an output's row."""

ERROR_GROWTH = 10.0
"""How much larger than the errors of the model's entries the couplings may be that they cause: each step passes errors on."""

SHARED_TOLERANCE = 1e-7
"""An uncontrollable and an unobservable subspace share modes where the cosine between them is above this."""


def zero_kinds(system: StateSpace, zeros: ComplexArray) -> tuple[ZeroKind, ...]:
    """The kind of each of `zeros`, the invariant zeros of a square `system` with vector relative degree.

    A zero s is an uncontrollable mode where rank [A - s I, B] < n and an unobservable one where rank [A - s I; C] < n; each such
    mode is a zero. Of several equal zeros as many are called hidden as there are hidden modes, a number that the rank alone does
    not tell: the modes come from staircase forms (P. Van Dooren, IEEE Trans. Automatic Control 26, 1981), and they are paired
    with zeros such that the distances add up to the least.
    """
    modes = hidden_modes(system)
    kinds: list[ZeroKind] = ["transmission zero"] * len(zeros)
    values = np.array([value for value, _ in modes], dtype=complex)
    for zero, mode in zip(*scipy.optimize.linear_sum_assignment(np.abs(zeros[:, None] - values[None, :])), strict=True):
        kinds[zero] = modes[mode][1]
    return tuple(kinds)


def hidden_modes(system: StateSpace) -> list[tuple[complex, ZeroKind]]:
    """The eigenvalues of A that belong to modes which no input moves or no output shows, each as often as it is hidden."""
    scale = plant_units(system)
    A = system.A * scale / scale[:, None]
    unreached, unseen = _hidden_subspaces(system, scale)
    # w' x with w in `unreached` obeys a system of its own, and so do states within `unseen`; where both meet, modes are shared.
    U, cosines, Vh = np.linalg.svd(unreached.T @ unseen)
    shared = int(np.sum(cosines > SHARED_TOLERANCE))
    left, both, right = unreached @ U[:, shared:], unseen @ Vh[:shared].T, unseen @ Vh[shared:].T
    blocks: list[tuple[Array, ZeroKind]] = [
        (left, "uncontrollable mode"),
        (both, "uncontrollable and unobservable mode"),
        (right, "unobservable mode"),
    ]
    return [(complex(value), kind) for basis, kind in blocks for value in np.linalg.eigvals(basis.T @ A @ basis)]


def _hidden_subspaces(system: StateSpace, scale: Array) -> tuple[Array, Array]:
    """Orthonormal bases, in balanced states x / d, of what lies out of the inputs' reach, and out of the outputs' sight."""
    A, B, C = system.A * scale / scale[:, None], system.B / scale[:, None], system.C * scale
    B_size, C_size = (np.where(size > 0, size, 1.0) for size in (np.linalg.norm(B, axis=0), np.linalg.norm(C, axis=1)))
    A_error = ERROR_GROWTH * float(np.linalg.norm(system.errors("A") * scale / scale[:, None]))
    B_error = ERROR_GROWTH * float(np.linalg.norm(system.errors("B") / scale[:, None] / B_size))
    C_error = ERROR_GROWTH * float(np.linalg.norm(system.errors("C") * scale / C_size[:, None]))
    A_tolerance = max(COUPLING_TOLERANCE * float(np.linalg.norm(A)), A_error)
    B_tolerance, C_tolerance = max(COUPLING_TOLERANCE, B_error), max(COUPLING_TOLERANCE, C_error)
    unreached = _unreached(A, B / B_size, A_tolerance, B_tolerance)
    unseen = _unreached(A.T, (C / C_size[:, None]).T, A_tolerance, C_tolerance)
    return unreached, unseen


def _unreached(A: Array, B: Array, A_tolerance: float, B_tolerance: float) -> Array:
    """Orthonormal basis of the complement of the controllable subspace of (A, B), by the staircase form.

    Each step adds the directions that A leads to from those added before; singular values within the tolerance lead nowhere.
    """
    n = len(A)
    Q, reached, steps, tolerance = np.eye(n), 0, B, B_tolerance
    while reached < n:
        U, sizes, _ = scipy.linalg.svd(steps)
        added = int(np.sum(sizes > tolerance))
        if added == 0:
            break
        Q[:, reached:] = Q[:, reached:] @ U
        steps = Q[:, reached + added :].T @ A @ Q[:, reached : reached + added]
        reached, tolerance = reached + added, A_tolerance
    return Q[:, reached:]
