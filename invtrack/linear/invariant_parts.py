"""A matrix taken apart into two that do not act on each other, by an ordered real Schur form and a Sylvester equation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array


@dataclass(frozen=True, eq=False)
class InvariantParts:
    """z = W_1 z_1 + W_2 z_2 with A W_1 = W_1 A_1 and A W_2 = W_2 A_2; z_1 = L_1 z, z_2 = L_2 z.

    A_1 (n_1, n_1), A_2 (n_2, n_2), W_1 (n, n_1), W_2 (n, n_2), L_1 (n_1, n), L_2 (n_2, n).
    """

    A_1: Array
    A_2: Array
    W_1: Array
    W_2: Array
    L_1: Array
    L_2: Array


def invariant_parts(A: Array, first: Callable[[complex], bool]) -> InvariantParts:
    """A (n, n) in a part with the eigenvalues for which `first` holds and one with the rest; the two sets must not meet."""
    n = len(A)
    schur, Q, n_1 = np.zeros((0, 0)), np.eye(0), 0
    if n:
        schur, Q, n_1 = scipy.linalg.schur(A, output="real", sort=lambda re, im: first(complex(re, im)))
    return separated(schur, Q, n_1)


def separated(schur: Array, Q: Array, n_1: int) -> InvariantParts:
    """Parts of Q schur Q' (n, n), in real Schur form with the eigenvalues of the first part first (n_1)."""
    n = len(schur)
    A_1, A_2 = schur[:n_1, :n_1], schur[n_1:, n_1:]
    coupling = np.zeros((n_1, n - n_1))
    if 0 < n_1 < n:
        coupling = scipy.linalg.solve_sylvester(A_1, -A_2, -schur[:n_1, n_1:])
    return InvariantParts(
        A_1=A_1,
        A_2=A_2,
        W_1=Q[:, :n_1],
        W_2=Q[:, :n_1] @ coupling + Q[:, n_1:],
        L_1=Q[:, :n_1].T - coupling @ Q[:, n_1:].T,
        L_2=Q[:, n_1:].T,
    )
