"""The real Schur form of a matrix, and the Lyapunov equations that are solved with it."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray


class SchurForm:
    """M = Z T Z' (n, n), Z orthogonal, T block triangular with blocks of one mode or a conjugate pair."""

    def __init__(self, M: Array) -> None:
        self.T, self.Z = scipy.linalg.schur(M)

    @property
    def is_stable(self) -> bool:
        """Whether all modes decay."""
        return bool(np.all(np.diag(self.T) < 0))  # LAPACK's blocks have the pair's real part twice on their diagonal

    def observability(self, F: Array) -> Array:
        """X with M'X + X M = -F, F symmetric."""
        return self._solve(F, "T", "N")

    def reachability(self, F: Array) -> Array:
        """X with M X + X M' = F, F symmetric."""
        return self._solve(-F, "N", "T")

    def _solve(self, F: Array, left: str, right: str) -> Array:
        solution, scale, _ = scipy.linalg.lapack.dtrsyl(self.T, self.T, -self.Z.T @ F @ self.Z, trana=left, tranb=right)
        X: Array = self.Z @ (solution / scale) @ self.Z.T
        return (X + X.T) / 2


def modes_of(T: Array) -> ComplexArray:
    """The eigenvalues (n,) of a block triangular T in the order of its blocks."""
    modes = np.diag(T).astype(complex)
    upper, lower = np.diag(T, 1), np.diag(T, -1)
    pairs = np.flatnonzero(lower)
    turning = 1j * np.sqrt(np.abs(upper[pairs])) * np.sqrt(np.abs(lower[pairs]))
    modes[pairs] += turning
    modes[pairs + 1] -= turning
    return modes
