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

LARGEST_EXPONENT = 1000.0
"""Bound on log2 of a feedback gain, close to what numbers hold."""

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
    A, B, C = np.abs(system.A), np.abs(system.B), np.abs(system.C)
    root = float(np.max(np.abs(np.linalg.eigvals(A))))
    paces = np.log2(root if root > 0 else 1.0) + np.arange(-20.0, 41.0, 2.0)
    paths = _path_sizes(A, B, C)
    steps = np.arange(len(paths))[:, None, None]
    scales = []
    for pace in paces:
        strongest = np.max(paths - steps * pace, axis=0)
        gains = np.exp2(
            np.clip(pace - strongest, None, LARGEST_EXPONENT), where=np.isfinite(strongest), out=np.zeros_like(strongest)
        )
        scales.append(balancing_scale(A + B @ gains.T @ C))
    return max(scales, key=lambda scale: _clarity(system, scale))


def _path_sizes(A: Array, B: Array, C: Array) -> Array:
    """log2 of C A^k B for k < n, entry by entry: (n, p, p), A, B, C without negative entries."""
    exponent, sizes = np.zeros(B.shape[1]), np.full((len(A), len(C), B.shape[1]), -np.inf)
    for k in range(len(A)):
        unit = np.exp2(np.ceil(np.log2(np.max(B, axis=0), where=np.any(B, axis=0), out=np.zeros(B.shape[1]))))
        B, exponent = B / unit, exponent + np.log2(unit)
        reached = C @ B
        sizes[k] = np.log2(reached, where=reached > 0, out=sizes[k]) + exponent
        B = A @ B
    return sizes


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
