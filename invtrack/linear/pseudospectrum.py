"""Pseudospectra: which points a small perturbation of a matrix can make eigenvalues of it."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.linalg.blas
import scipy.linalg.lapack
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray

SETTLED = 1e-3
"""Inverse iteration has found a singular value where a step changes it by less than this share."""

ITERATIONS = 50
"""Steps of inverse iteration at most; two or three do, unless several singular values are about equally small."""


class Pseudospectrum:
    """For a matrix A (n, n) and any epsilon: the z where the smallest singular value of A - z I is at most epsilon.

    Where the eigenvectors are independent enough, |(A - z I)^-1| <= sum_i k_i / |s_i - z| over the eigenvalues s_i with their
    condition numbers k_i rules out most points, all of them together in O(n) each. What is left is decided by inverse iteration
    on one Schur form, O(n^2) a point. Source: L. N. Trefethen, "Computation of pseudospectra", Acta Numerica 8, 1999.
    """

    def __init__(self, A: Array) -> None:
        self._A = A

    def contains(self, z: ComplexArray, epsilon: float) -> NDArray[np.bool_]:
        """Whether each of the points z (m,) is an eigenvalue of A + E for an E with |E| <= epsilon, (m,)."""
        if not self._A.size:
            return np.zeros(len(z), dtype=bool)
        inside = self._lower_bounds(z) <= epsilon
        inside[inside] = [self._reached(complex(point), epsilon) for point in z[inside]]
        return inside

    def joins_axis(self, z: ComplexArray, epsilon: float) -> NDArray[np.bool_]:
        """Whether eigenvalues z (m,) of A cannot be told from ones at j Im z: all the way there lies in the pseudospectrum, (m,).

        So a double eigenvalue, which rounding splits by sqrt(eps), is still seen. Looking only at j Im z would name every real
        eigenvalue beside one at the origin.
        """
        return self._joins(z, np.asarray(1j * z.imag, dtype=np.complex128), epsilon)

    def joins_real(self, z: ComplexArray, epsilon: float) -> NDArray[np.bool_]:
        """Whether eigenvalues z (m,) of A cannot be told from real ones: all the way to Re z lies in the pseudospectrum, (m,)."""
        return self._joins(z, np.asarray(z.real, dtype=np.complex128), epsilon)

    def _joins(self, z: ComplexArray, target: ComplexArray, epsilon: float) -> NDArray[np.bool_]:
        """Whether all the way from each of z (m,) to its target (m,) lies in the pseudospectrum, (m,)."""
        reached = np.ones(len(z), dtype=bool)
        for share in (0.0, 0.25, 0.5, 0.75):
            way = (target + share * (z - target))[reached].astype(complex)
            reached[reached] = self.contains(way, epsilon)
        return reached

    def _lower_bounds(self, z: ComplexArray) -> Array:
        """Values that the smallest singular values of A - z I are not below, (m,)."""
        eigenvalues, conditions, rounding = self._modes
        if not np.isfinite(rounding):
            return np.zeros(len(z))
        with np.errstate(divide="ignore"):
            resolvent = (1 / np.abs(eigenvalues - z[:, None])) @ conditions
        return np.asarray(1 / resolvent - rounding)

    @cached_property
    def _modes(self) -> tuple[ComplexArray, Array, float]:
        """Eigenvalues, their condition numbers, and how far V diag(s) V^-1 is from A; infinitely far without independent V."""
        eigenvalues, vectors = np.linalg.eig(self._A)
        V = vectors.astype(complex)
        factors, pivots, singular = scipy.linalg.lapack.zgetrf(V)
        if singular:
            return eigenvalues, np.full(len(V), np.inf), np.inf
        W, _ = scipy.linalg.lapack.zgetri(factors, pivots)
        with np.errstate(over="ignore", invalid="ignore"):
            conditions = np.linalg.norm(V, axis=0) * np.linalg.norm(W, axis=1)
            return eigenvalues, conditions, float(np.linalg.norm(self._A @ V - V * eigenvalues) * np.linalg.norm(W))

    @cached_property
    def _triangle(self) -> ComplexArray:
        """The complex Schur form of A, which has the same singular values at every z."""
        triangle, _ = scipy.linalg.schur(self._A.astype(complex), output="complex")
        return np.asarray(triangle)

    def _reached(self, z: complex, epsilon: float) -> bool:
        """Whether inverse iteration gets the smallest singular value of A - z I down to epsilon; its values only ever fall."""
        n = len(self._A)
        shifted = np.asfortranarray(self._triangle - z * np.eye(n))
        if not np.all(np.diag(shifted)):
            return True
        v = np.random.default_rng(0).normal(size=n) + 0j
        v, smallest = v / np.linalg.norm(v), np.inf
        for _ in range(ITERATIONS):
            v = scipy.linalg.blas.ztrsv(shifted, v)
            with np.errstate(over="ignore", invalid="ignore"):
                value = 1 / float(np.linalg.norm(v))
            if not value > epsilon:  # so too where v is too large for numbers
                return True
            if value >= (1 - SETTLED) * smallest:
                return False
            smallest = value
            v = scipy.linalg.blas.ztrsv(shifted, v * value, trans=2)
            v /= np.linalg.norm(v)
        return False
