"""The staircase form: which part of a state space inputs reach, by orthogonal transformations alone."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg

from invtrack.arrays import Array

ROUNDING = 10.0
"""Rounding of a coupling, in units of n eps times the norm of its matrix."""


def unreached(A: Sequence[Array], B: Array) -> Array:
    """Orthonormal basis (n, h) of the complement of what inputs reach through x' = A_k x + B u, with any of the A_k.

    It is the complement of the smallest subspace that holds the columns of B (n, m) and that each A_k (n, n) maps into itself. Each
    step adds the directions that the A_k lead to from those added before; couplings of size 1 and below lead nowhere, so A_k and B
    come divided by what counts as none. A direction to which only a weak coupling s leads is known to the rounding of its matrix
    over s, and where it leads from there no better; of a single A_k, what is left is then refined. Only what is not reached yet is
    transformed further, so that the whole takes O(n^3) operations. Source: P. Van Dooren, IEEE Trans. Automatic Control 26, 1981.
    """
    n, reached, steps, weak = len(B), 0, B, False
    size = max(float(np.linalg.norm(M)) for M in A)
    rounding = ROUNDING * n * np.finfo(float).eps * max(size, float(np.linalg.norm(B)))
    rest = [np.asfortranarray(M) for M in A]  # among the directions not reached yet
    turns: list[_Turn] = []
    while reached < n:
        turn, sizes = _range_first(steps)
        if len(sizes) == 0:
            break
        added = len(sizes)
        turns.append(turn)
        turned = [turn.applied_right(turn.applied_left(M, transpose=True)) for M in rest]
        unknown = np.maximum(1.0, size * rounding / sizes)
        weak |= bool(np.any(unknown > 1.0))
        steps = np.hstack([M[added:, :added] / unknown for M in turned])
        rest = [np.asfortranarray(M[added:, added:]) for M in turned]
        reached += added
    basis = np.eye(n - reached)
    for turn in reversed(turns):
        basis = turn.applied_left(np.vstack([np.zeros((turn.size - len(basis), n - reached)), basis]))
    return _refined(A[0], B, basis) if weak and len(A) == 1 and 0 < n - reached < n else basis


def _refined(A: Array, B: Array, basis: Array) -> Array:
    """The orthonormal basis U (n, h) after a Newton step towards U'B = 0, U'A = H U': the least squares solution for both at once.

    It is as well determined as the modes are that inputs do reach, by all couplings together, where the staircase takes one after
    the other. With S a basis of the complement, U + S X is sought for which (S'A'S) X - X (U'A'U) = -S'A'U and B'S X = -B'U.
    """
    n, h = basis.shape
    S = np.linalg.qr(basis, mode="complete")[0][:, h:]
    T, Z = scipy.linalg.schur(basis.T @ A.T @ basis, output="complex")
    own, seen = S.T @ A.T @ S, B.T @ S
    wanted = -np.vstack([S.T @ A.T @ basis, B.T @ basis]) @ Z
    Y = np.zeros((n - h, h), dtype=complex)
    for j in range(h):
        wanted[: n - h, j] += Y[:, :j] @ T[:j, j]
        Y[:, j] = np.linalg.lstsq(np.vstack([own - T[j, j] * np.eye(n - h), seen]), wanted[:, j], rcond=None)[0]
    return np.asarray(np.linalg.qr(basis + S @ (Y @ Z.conj().T).real)[0])


class _Turn:
    """An orthogonal matrix: k Householder reflectors of LAPACK's dgeqrf, then a rotation (k, k) of the first k columns."""

    def __init__(self, reflectors: Array, factors: Array, rotation: Array) -> None:
        self._reflectors, self._factors, self._rotation = reflectors, factors, rotation

    @property
    def size(self) -> int:
        """Number of its rows."""
        return len(self._reflectors)

    def applied_left(self, M: Array, *, transpose: bool = False) -> Array:
        """Q M, or Q' M."""
        result = np.array(M, order="F")
        k = len(self._rotation)
        if transpose:
            result = self._reflected(result, "L", "T")
            result[:k] = self._rotation.T @ result[:k]
            return result
        result[:k] = self._rotation @ result[:k]
        return self._reflected(result, "L", "N")

    def applied_right(self, M: Array) -> Array:
        """M Q, in place of M."""
        result = self._reflected(M, "R", "N")
        k = len(self._rotation)
        result[:, :k] = result[:, :k] @ self._rotation
        return result

    def _reflected(self, M: Array, side: str, trans: str) -> Array:
        if M.size == 0:
            return M
        room = 64 * max(M.shape)  # for LAPACK's largest blocks
        result, _, _ = scipy.linalg.lapack.dormqr(side, trans, self._reflectors, self._factors, M, room, overwrite_c=1)
        return np.asarray(result)


def _range_first(M: Array) -> tuple[_Turn, Array]:
    """An orthogonal matrix whose first columns span what M (m, q) leads to: as many as singular values above 1, which come too."""
    (reflectors, factors), triangle = scipy.linalg.qr(M, mode="raw")
    k = len(factors)
    rotation, sizes, _ = scipy.linalg.svd(triangle[:k])
    return _Turn(reflectors[:, :k], factors, rotation), sizes[sizes > 1.0]
