"""Pole placement one pole or pair after another along a real Schur form: poles may repeat as often as one likes."""

from __future__ import annotations

import numpy as np
import scipy.linalg
import scipy.linalg.lapack

from invtrack.arrays import Array, ComplexArray

NO_EFFECT = 1e-14
"""What the inputs move by less than this share of the largest that they move is rounding."""


def schur_gain(A: Array, B: Array, poles: ComplexArray) -> Array | None:
    """F (p, n) such that A + B F has `poles` (n,), complex ones in conjugate pairs; None where an input moves too little.

    The last block of a real Schur form of A belongs to a left invariant subspace, so feedback of its coordinates alone moves its
    eigenvalues and no others: the least feedback that takes them to the nearest of the poles wanted is added, the block is moved to
    the top, and the next one is last. Each equal pole joins the Jordan chain that this makes; no eigenvectors are needed, so that
    (unlike with robust placement) a pole may be repeated more often than there are inputs, or than independent ways lead to it.

    A (n, n), B (n, p), in units in which the states and the inputs count alike.

    Source: A. Varga, "A Schur method for pole assignment", IEEE Trans. Automatic Control 26(2), 1981.
    """
    n, p = B.shape
    T, Q = scipy.linalg.schur(A, output="real")
    F = np.zeros((p, n))
    wanted, placed = _Wanted(poles), 0
    while placed < n:
        last = n - 1
        first = last if last == placed or T[last, last - 1] == 0.0 else last - 1
        if first == last and not len(wanted.real):
            T, Q = _real_block_brought(T, Q, placed, last - 1)
            first = last - 1
        block = slice(first, n)
        to = wanted.taken(T[block, block])
        feedback = _least_feedback(T[block, block], (Q.T @ B)[block], to, NO_EFFECT * float(np.linalg.norm(B)))
        if feedback is None:
            return None
        T[:, block] += Q.T @ B @ feedback
        F += feedback @ Q[:, block].T
        T, Q = _standard(T, Q, block)
        while placed < n and first < n:  # two real ones are two blocks
            width = 2 if first + 1 < n and T[first + 1, first] != 0.0 else 1
            T, Q, failed = scipy.linalg.lapack.dtrexc(T, Q, first + 1, placed + 1)
            if failed:
                return None
            placed, first = placed + width, first + width
    return F


class _Wanted:
    """Poles not yet placed: real ones, and the upper ones of pairs."""

    def __init__(self, poles: ComplexArray) -> None:
        self.real = np.sort(poles[poles.imag == 0].real)
        self.upper = poles[poles.imag > 0]

    def taken(self, block: Array) -> ComplexArray:
        """The nearest to a block's eigenvalues: one real pole for one state; for two states a pair, or two real ones."""
        if len(block) == 1:
            return np.array([self._real(float(block[0, 0]))], dtype=complex)
        center, radius = float(np.trace(block)) / 2, float(np.sqrt(abs(np.linalg.det(block))))
        if len(self.upper):
            k = int(np.argmin(np.abs(self.upper - complex(center, np.sqrt(max(radius**2 - center**2, 0.0))))))
            pole = self.upper[k]
            self.upper = np.delete(self.upper, k)
            return np.array([pole, pole.conj()])
        return np.array([self._real(center), self._real(center)], dtype=complex)

    def _real(self, near: float) -> float:
        k = int(np.argmin(np.abs(self.real - near)))
        pole = float(self.real[k])
        self.real = np.delete(self.real, k)
        return pole


def _real_block_brought(T: Array, Q: Array, placed: int, position: int) -> tuple[Array, Array]:
    """Another real eigenvalue brought next to the last one: there is one, since what is wanted are pairs."""
    single = [
        i for i in range(placed, position + 1) if T[i + 1, i] == 0.0 and (i == placed or T[i, i - 1] == 0.0)
    ]  # T[i, i - 1] at the border of the placed part is zero anyway
    T, Q, _ = scipy.linalg.lapack.dtrexc(T, Q, single[-1] + 1, position + 1)
    return T, Q


def _standard(T: Array, Q: Array, block: slice) -> tuple[Array, Array]:
    """The Schur form with the block's own in it."""
    own, Z = scipy.linalg.schur(T[block, block], output="real")
    T, Q = T.copy(), Q.copy()
    T[:, block] = T[:, block] @ Z
    Q[:, block] = Q[:, block] @ Z
    T[block, block] = own
    return T, Q


def _least_feedback(A: Array, B: Array, poles: ComplexArray, none: float) -> Array | None:
    """Small feedback (p, k) that gives A (k, k), k <= 2, these eigenvalues; None where B (k, p) moves no more than `none`."""
    U, sizes, Vh = np.linalg.svd(B)
    reached = int(np.sum(sizes > none))
    if not reached:
        return None
    A = U.T @ A @ U
    choices = []
    if reached == len(A):
        choices += [(wish - A) / sizes[:reached, None] for wish in _with_eigenvalues(A, poles)]
    if len(A) == 2 and abs(A[1, 0]) > NO_EFFECT * np.linalg.norm(A):
        # Through the stronger direction alone: the trace gives the first entry, the determinant the second.
        upper = float(np.sum(poles).real) - A[1, 1]
        right = (upper * A[1, 1] - float(np.prod(poles).real)) / A[1, 0]
        choices.append(np.array([[upper - A[0, 0], right - A[0, 1]]]) / sizes[0])
    if not choices:
        return None
    least = min(choices, key=lambda choice: float(np.linalg.norm(choice)))
    return np.asarray(Vh[: len(least)].T @ least @ U.T)


def _with_eigenvalues(A: Array, poles: ComplexArray) -> list[Array]:
    """Matrices near A with these eigenvalues: a diagonal or a rotation, and with the eigenvectors of A."""
    if len(A) == 1:
        return [np.array([[poles[0].real]])]
    if poles[0].imag == 0:
        return [np.diag(order.real) for order in (poles, poles[::-1])]
    a, b = float(poles[0].real), float(poles[0].imag)
    turned = [np.array([[a, c], [-c, a]]) for c in (b, -b)]
    values, vectors = np.linalg.eig(A)
    if values[0].imag != 0:
        W = np.column_stack([vectors[:, 0].real, vectors[:, 0].imag])
        turned.append(W @ np.array([[a, b], [-b, a]] if values[0].imag > 0 else [[a, -b], [b, a]]) @ np.linalg.inv(W))
    return turned
