"""A stable system taken apart into parts whose modes are of unlike pace, in twice the working precision."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.redesign.double_double import DoubleDouble
from invtrack.redesign.schur_form import SchurForm, modes_of

APART = 16.0
"""Modes of two parts differ in size by this factor at least."""

MOST_COUPLED = 100.0
"""Coordinates that lean on each other by more than this would lose more in precision than is gained by taking them apart."""

SETTLED = 1e-10
"""A correction of the coordinates below this leaves nothing in twice the working precision: it is squared."""

MOST_CORRECTIONS = 3


@dataclass(frozen=True, eq=False)
class Coordinates:
    """x = V z and s = U q with U'V = 1: x' = A_c x becomes z' = A z, and s' = -A_c's becomes q' = -A'q.

    V, U (n, n); A (n, n) is block diagonal, the slowest modes first. `whole` where it is A_c itself, in one block.
    """

    V: DoubleDouble
    U: DoubleDouble
    A: Array
    whole: bool

    @classmethod
    def plain(cls, A_c: DoubleDouble) -> Coordinates:
        """Those in which A_c is stated."""
        identity = DoubleDouble.of(np.eye(len(A_c.high)))
        return cls(identity, identity, A_c.rounded, whole=True)

    def of_states(self, M: DoubleDouble) -> DoubleDouble:
        """M x as a matrix times z."""
        return M if self.whole else M @ self.V

    def of_drives(self, M: DoubleDouble) -> DoubleDouble:
        """M s as a matrix times q."""
        return M if self.whole else M @ self.U


def by_pace(A_c: DoubleDouble, schur: SchurForm) -> Coordinates:
    """Coordinates in which modes whose sizes are farther apart than APART are in blocks of their own; schur: the form of A_c.

    Where inputs are cheap the loop has modes that are faster than the plant's by many orders. In one matrix with them the slow ones
    are known no better than to rounding of the fast ones, and everything is carried at the pace of the fast ones. Apart, neither is
    so: no entry of A, V and U holds more of a fast mode than there is.

    Source: C. Bavely, G. Stewart, "An algorithm for computing reducing subspaces by block diagonalization", SIAM J. Numerical
    Analysis 16(2), 1979.
    """
    T, V, blocks = _ordered(schur)
    for block in blocks[:-1]:  # what there is in T beside this block, and the coordinates that take it away
        rest = slice(block.stop, len(T))
        Y = _sylvester(T[block, block], T[rest, rest], T[block, rest])
        if not np.linalg.norm(Y, 2) <= MOST_COUPLED:
            return Coordinates.plain(A_c)
        V = np.hstack([V[:, : block.stop], V[:, rest] + V[:, block] @ Y])
    if len(blocks) < 2:
        return Coordinates.plain(A_c)
    inverse = np.asarray(np.linalg.solve(V, np.eye(len(V))))
    right = DoubleDouble.of(V)
    left_over = (DoubleDouble.of(np.eye(len(V))) - DoubleDouble.of(inverse) @ right).rounded
    left = DoubleDouble.of(inverse) + DoubleDouble.of(left_over @ inverse)
    for _ in range(MOST_CORRECTIONS):  # as far as doubles go; each correction in twice the precision squares what is missing
        A = (left @ (A_c @ right)).rounded
        Y = np.zeros_like(A)
        for i, j in itertools.permutations(blocks, 2):
            Y[i, j] = _sylvester(T[i, i], T[j, j], A[i, j])
            A[i, j] = 0.0
        away = np.asarray(np.linalg.solve(np.eye(len(Y)) + Y, Y))  # what the inverse of 1 + Y takes away from 1
        right, left = right + DoubleDouble.of(right.high @ Y), left - DoubleDouble.of(away @ left.high)
        if np.linalg.norm(Y) <= SETTLED:
            return Coordinates(right, left.transposed, A, whole=False)
    return Coordinates.plain(A_c)


def _ordered(schur: SchurForm) -> tuple[Array, Array, list[slice]]:
    """The form's T and Z with the slowest modes first, and the blocks of modes of like pace."""
    T, Z = schur.T, schur.Z
    paces = np.sort(np.abs(modes_of(T)))
    gaps = np.flatnonzero(paces[1:] > APART * paces[:-1]) + 1
    for gap in gaps[::-1]:
        limit = np.sqrt(paces[gap - 1]) * np.sqrt(paces[gap])
        T, Z, *_, refused = scipy.linalg.lapack.dtrsen(np.abs(modes_of(T)) < limit, T, Z, job="N")
        if refused:  # modes that cannot change places to within rounding
            return schur.T, schur.Z, [slice(0, len(T))]
    edges = [0, *gaps.tolist(), len(T)]
    return T, Z, [slice(first, end) for first, end in itertools.pairwise(edges)]


def _sylvester(T_i: Array, T_j: Array, E: Array) -> Array:
    """Y with T_i Y - Y T_j = -E, T_i and T_j in real Schur form."""
    Y, scale, _ = scipy.linalg.lapack.dtrsyl(T_i, T_j, -E, isgn=-1)
    return np.asarray(Y / scale)
