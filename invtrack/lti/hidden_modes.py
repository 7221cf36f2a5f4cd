"""Which zeros of a plant are hidden modes: modes that no input moves, or that no output shows."""

from __future__ import annotations

from typing import Literal

import numpy as np
import scipy.linalg
import scipy.optimize
from numpy.typing import NDArray

from invtrack.lti.balancing import balancing_scale
from invtrack.lti.normal_form import NormalForm, _couplings
from invtrack.lti.state_space import StateSpace

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

ZeroKind = Literal["transmission zero", "uncontrollable mode", "unobservable mode", "uncontrollable and unobservable mode"]
"""Transmission zeros act on the transfer function; the others are decoupling zeros: input, output, input-output (Rosenbrock)."""

COUPLING_TOLERANCE = 1e-10
"""A coupling counts as none below this share of the norm of A in balanced states, or of an input's column or an output's row."""

SHARED_TOLERANCE = 1e-7
"""An uncontrollable and an unobservable subspace share modes where the cosine between them is above this."""


def zero_kinds(system: StateSpace, form: NormalForm, A_eta: Array, zeros: ComplexArray) -> tuple[ZeroKind, ...]:
    """The kind of each of `zeros`, the eigenvalues of the internal dynamics A_eta (n_z, n_z) in the coordinates of `form`.

    A zero s is an uncontrollable mode where rank [A - s I, B] < n and an unobservable one where rank [A - s I; C] < n. Among equal
    zeros that many are named so as there are hidden modes, which the rank alone does not tell: the internal dynamics are cut into
    blocks by the invariant subspaces that staircase forms give (P. Van Dooren, IEEE Trans. Automatic Control 26, 1981), and each
    zero is paired with an eigenvalue of a block.
    """
    blocks = _blocks(system, form, A_eta)
    values = np.concatenate([np.linalg.eigvals(block).astype(complex) for _, block in blocks])
    kinds = [kind for kind, block in blocks for _ in range(len(block))]
    _, partner = scipy.optimize.linear_sum_assignment(np.abs(zeros[:, None] - values[None, :]))
    return tuple(kinds[i] for i in partner)


def state_scale(systems: list[StateSpace], forms: list[NormalForm]) -> Array:
    """Scales d (n,) that balance the states of several models at once: x / d is free of units, up to a common factor."""
    return balancing_scale(np.sum([_couplings(s, f.A_x, f.B_y) for s, f in zip(systems, forms, strict=True)], axis=0))


def _blocks(system: StateSpace, form: NormalForm, A_eta: Array) -> list[tuple[ZeroKind, Array]]:
    """A_eta cut into the four parts of Kalman's decomposition."""
    unreached, unseen = _hidden_subspaces(system, form)
    scale = state_scale([system], [form])
    basis, rows = form.V / scale[:, None], form.N * scale
    # Both lie within the internal dynamics: unseen states keep the output at zero, and no input moves `left` x.
    left, unseen = np.linalg.qr((unreached.T @ basis).T)[0].T, rows @ unseen
    n_o = unseen.shape[1]
    Q = np.linalg.qr(unseen, mode="complete")[0] if n_o else np.eye(len(A_eta))
    seen, unseen = Q[:, n_o:], Q[:, :n_o]
    U, cosines, Vh = np.linalg.svd(left @ unseen)
    shared = int(np.sum(cosines > SHARED_TOLERANCE))
    inside = unseen.T @ A_eta @ unseen
    only = U[:, shared:].T @ left @ seen  # rows of `left` that vanish on the unseen states
    W = np.linalg.qr(only.T, mode="complete")[0] if len(only) else np.eye(seen.shape[1])
    rest = W.T @ seen.T @ A_eta @ seen @ W
    n_c = len(only)
    return [
        ("transmission zero", rest[n_c:, n_c:]),
        ("uncontrollable mode", rest[:n_c, :n_c]),
        ("unobservable mode", Vh[shared:] @ inside @ Vh[shared:].T),
        ("uncontrollable and unobservable mode", Vh[:shared] @ inside @ Vh[:shared].T),
    ]


def _hidden_subspaces(system: StateSpace, form: NormalForm) -> tuple[Array, Array]:
    """Orthonormal bases, in balanced states x / d, of what lies out of the inputs' reach, and out of the outputs' sight."""
    scale = state_scale([system], [form])
    A, B, C = system.A * scale / scale[:, None], system.B / scale[:, None], system.C * scale
    error = {name: system.error_estimates.get(name, 0.0) for name in "ABC"}
    A_error = error["A"] * np.linalg.norm(1 / scale) * np.linalg.norm(scale)
    A_tolerance = max(COUPLING_TOLERANCE * float(np.linalg.norm(A)), float(A_error))
    B_size, C_size = np.linalg.norm(B, axis=0), np.linalg.norm(C, axis=1)
    B_error = np.max(error["B"] * np.linalg.norm(1 / scale) / np.where(B_size > 0, B_size, 1.0))
    C_error = np.max(error["C"] * np.linalg.norm(scale) / np.where(C_size > 0, C_size, 1.0))
    B, C = B / np.where(B_size > 0, B_size, 1.0), C / np.where(C_size > 0, C_size, 1.0)[:, None]
    unreached = _unreached(A, B, A_tolerance, max(COUPLING_TOLERANCE, float(B_error)))
    unseen = _unreached(A.T, C.T, A_tolerance, max(COUPLING_TOLERANCE, float(C_error)))
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
