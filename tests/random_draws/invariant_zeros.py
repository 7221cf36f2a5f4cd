"""Whether a plant has a bounded inverse, judged by its own means: none of invtrack's zeros, ranks or tolerances.

The zeros come from the reduction of the system matrix by orthogonal transformations (A. Emami-Naeini and P. Van Dooren, Automatica
18, 1982) and QZ, in the units in which the plant was drawn, each with its condition number.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from tests.random_draws.plants import Matrices

EPS = float(np.finfo(float).eps)
MARGIN = 1e3
"""A distance or a rank counts where it is this often what rounding of the entries can make of it; on the axis lies what is within
ten times that; between the two is the band, where either answer is right."""

Verdict = Literal["solvable", "band", "on the axis", "degenerate"]


@dataclass(frozen=True, eq=False)
class Judgement:
    """What an independent look at a plant says.

    Args:
        verdict: whether a bounded inverse exists, or why not, or that rounding decides.
        zeros: finite invariant zeros, hidden modes among them (k,).
        resolved: how far rounding of the plant's entries can move each of them (k,).
        highest: how many derivatives of the outputs the inverse needs.
    """

    verdict: Verdict
    zeros: ComplexArray
    resolved: Array
    highest: int

    @property
    def pace(self) -> float:
        """Size of the largest zero [rad/s]."""
        return float(np.max(np.abs(self.zeros), initial=0.0))


def judged(plant: Matrices) -> Judgement:
    """The judgement of a square plant."""
    size = float(np.linalg.norm(np.block([[plant.A, plant.B], [plant.C, plant.D]]), 2))
    reduced, highest, gap = without_infinite_zeros(plant, size)
    none = np.zeros(0)
    if reduced is None:
        return Judgement("degenerate" if gap else "band", none.astype(complex), none, highest)
    zeros, resolved = _finite_zeros(reduced, size)
    distance = np.abs(zeros.real)
    if not gap:
        verdict: Verdict = "band"
    elif np.any(distance <= 10 * resolved):
        verdict = "on the axis"
    else:
        verdict = "solvable" if np.all(distance >= MARGIN * resolved) else "band"
    return Judgement(verdict, zeros, resolved, highest)


def without_infinite_zeros(plant: Matrices, size: float) -> tuple[Matrices | None, int, bool]:
    """The plant with its finite zeros alone and feedthrough of full row rank, or None where no input makes every output move.

    Each step holds what the outputs without feedthrough show at zero, and makes outputs of its derivatives. Also how many steps,
    and whether every rank on the way was clear.
    """
    A, B, C, D = plant.A, plant.B, plant.C, plant.D
    p, steps, clear = plant.p, 0, True
    while True:
        U, rank, certain = compressed(D, size)
        clear &= certain
        if rank == len(D):
            return (Matrices(A, B, C, D), steps, clear) if rank == p else (None, steps, clear)
        C, D = U.T @ C, (U.T @ D)[:rank]
        V, seen, certain = compressed(C[rank:].T, size)
        clear &= certain
        if seen < len(C) - rank:  # an output, or a combination of outputs and derivatives, that is always zero
            return None, steps, clear
        steps += 1
        hidden, shown = V[:, seen:], V[:, :seen]
        B, C, D = hidden.T @ B, np.vstack([C[:rank] @ hidden, shown.T @ A @ hidden]), np.vstack([D, shown.T @ B])
        A = hidden.T @ A @ hidden


def compressed(M: Array, size: float) -> tuple[Array, int, bool]:
    """U orthogonal, and the rank r of M, with U'M zero below its first r rows; whether the rank is clear by the margin."""
    if not M.size:
        return np.eye(len(M)), 0, True
    U, values, _ = np.linalg.svd(M)
    rounding = EPS * max(len(M), 10) * size
    rank = int(np.sum(values > MARGIN * rounding))
    kept, dropped = values[rank - 1] if rank else np.inf, values[rank] if rank < len(values) else 0.0
    return U, rank, bool(kept > MARGIN**2 * rounding and dropped < 100 * rounding)


def _finite_zeros(plant: Matrices, size: float) -> tuple[ComplexArray, Array]:
    """Zeros of a plant with invertible feedthrough, and what an error of eps of `size` in its pencil makes of each."""
    n, p = plant.B.shape
    if n == 0:
        return np.zeros(0, dtype=complex), np.zeros(0)
    Q = np.linalg.qr(np.hstack([plant.C, plant.D]).T, mode="complete")[0][:, p:]  # [C D] Q = 0
    M, E = np.hstack([plant.A, plant.B]) @ Q, Q[:n]
    zeros, left, right = scipy.linalg.eig(M, E, left=True, right=True)
    coupling = np.abs(np.einsum("ik,ij,jk->k", left.conj(), E, right))
    lengths = np.linalg.norm(left, axis=0) * np.linalg.norm(right, axis=0)
    error = EPS * (size + np.abs(zeros)) * lengths / np.maximum(coupling, np.finfo(float).tiny)
    return np.asarray(zeros, dtype=complex), np.asarray(error)


def conditioned_modes(A: Array, size: float) -> tuple[ComplexArray, Array]:
    """Eigenvalues of A (k, k), and what an error of eps of `size` in it makes of each."""
    if not A.size:
        return np.zeros(0, dtype=complex), np.zeros(0)
    values, left, right = scipy.linalg.eig(A, left=True, right=True)
    coupling = np.abs(np.einsum("ik,ik->k", left.conj(), right))
    return np.asarray(values, dtype=complex), EPS * size / np.maximum(coupling, np.finfo(float).tiny)
