"""Which zeros of a plant are hidden modes: modes that no input moves, or that no output shows."""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy  # loads scipy.optimize at its first use
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace

ZeroKind = Literal["transmission zero", "uncontrollable mode", "unobservable mode", "uncontrollable and unobservable mode"]
"""Transmission zeros act on the transfer function; the others are decoupling zeros: input, output, input-output (Rosenbrock)."""

COUPLING_TOLERANCE = 1e-10
"""A coupling counts as none below this share of the norm of A in balanced states, or of an input's column or an output's row."""

ERROR_GROWTH = 10.0
"""How much larger than the errors of the model's entries the couplings may be that they cause: each step passes errors on."""

OUTGROWN = 1e100
"""At a pace at which the paths from inputs to outputs grow larger than this, feedback is next to nothing."""

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
    scale = _plant_scale(system)
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


def _plant_scale(system: StateSpace) -> Array:
    """Scales d (n,) that balance A together with B and C, whatever the units of states, inputs, outputs and time.

    A alone may fall apart into parts without a common scale: each output is fed back to each input with the gain with which the
    strongest loop through both is as fast as a pace. Which one is no property of the plant: a hovering vehicle's drag is far slower
    than what its outputs ask of it. Taken is the one in whose units the couplings stand out most clearly.
    """
    A = np.abs(system.A)
    root = float(np.max(np.abs(np.linalg.eigvals(A))))
    paces = (root if root > 0 else 1.0) * np.exp2(np.arange(-20.0, 41.0, 2.0))
    return max((_scale_at(system, float(pace)) for pace in paces), key=lambda scale: _clarity(system, scale))


def _scale_at(system: StateSpace, pace: float) -> Array:
    A, way, C = np.abs(system.A), np.abs(system.B), np.abs(system.C)
    strongest = C @ way  # |C| (|A| / pace)^k |B|, the largest over k
    for _ in range(system.n_states - 1):
        way = A @ way / pace
        if np.max(way, initial=0.0) > OUTGROWN:  # far too slow a pace: the gains are next to nothing already
            break
        strongest = np.maximum(strongest, C @ way)
    gains = np.where(strongest > 0, pace / np.where(strongest > 0, strongest, 1.0), 0.0)
    return balancing_scale(A + np.abs(system.B) @ gains.T @ C)


def _clarity(system: StateSpace, scale: Array) -> float:
    """How far the couplings stand out in these units: mean logarithm of their shares, of A's norm, of a column of B, a row of C."""
    A, B, C = (np.abs(M) for M in (system.A * scale / scale[:, None], system.B / scale[:, None], system.C * scale))
    np.fill_diagonal(A, 0.0)  # what acts on itself couples nothing
    shares = np.concatenate([(M / np.where(size > 0, size, 1.0))[M > 0] for M, size in ((A, np.linalg.norm(A)), *_sizes(B, C))])
    return float(np.mean(np.log(np.maximum(shares, COUPLING_TOLERANCE)))) if shares.size else 0.0


def _sizes(B: Array, C: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """B and C with the norms of the columns and of the rows."""
    return (B, np.linalg.norm(B, axis=0, keepdims=True)), (C, np.linalg.norm(C, axis=1, keepdims=True))


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
