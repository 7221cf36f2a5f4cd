"""Zeros, poles and hidden modes in exact rational arithmetic: right values that share no step, and no rounding, with the package.

Every printed decimal is taken as the fraction that it is. The polynomials come from determinants of integer matrices at integer
points (E. H. Bareiss, Mathematics of Computation 22, 1968); only their roots are rounded, each to a few units in its last place.
"""

from __future__ import annotations

from fractions import Fraction
from functools import cached_property
from itertools import count
from math import lcm

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tests.published.polynomials import Complex, interpolated, roots

Rational = NDArray[np.object_]


class ExactPlant:
    """x' = A x + B u, y = C x + D u with entries as printed: (n, n), (n, m), (q, n), (q, m)."""

    def __init__(self, A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike) -> None:
        self.A, self.B, self.C, self.D = (_as_printed(M) for M in (A, B, C, D))
        self.n, self.m = self.B.shape
        self._zeros: dict[tuple[tuple[int, ...], tuple[int, ...]], Complex | None] = {}

    @cached_property
    def _bordered(self) -> tuple[list[int], list[int], list[Rational]]:
        """At n + 1 integer points: s, det(A - s I) and the (q, m) minors that border it, up to a factor for each row."""
        scales = _row_scales(np.block([[self.A, self.B], [self.C, self.D]]))
        points: list[int] = []
        determinants: list[int] = []
        borders: list[Rational] = []
        for step in count():
            s = (step + 1) // 2 * (-1) ** step
            M = np.vstack([np.hstack([self.A - s * np.eye(self.n, dtype=int), self.B]), np.hstack([self.C, self.D])])
            determinant, border = _eliminated(_integers(M * scales[:, None]), self.n)
            if determinant:
                points.append(s)
                determinants.append(determinant)
                borders.append(border)
            if len(points) == self.n + 1:
                return points, determinants, borders
        raise AssertionError

    def zeros(self, outputs: tuple[int, ...], inputs: tuple[int, ...]) -> Complex | None:
        """The invariant zeros of the square plant with these outputs and inputs; None where its transfer matrix is singular."""
        if (outputs, inputs) not in self._zeros:
            points, determinants, borders = self._bordered
            values = [
                Fraction(_determinant(border[np.ix_(outputs, inputs)]), determinant ** (len(outputs) - 1))  # Sylvester's identity
                for determinant, border in zip(determinants, borders, strict=True)
            ]
            polynomial = interpolated(points, values)
            self._zeros[outputs, inputs] = roots(polynomial) if polynomial else None
        return self._zeros[outputs, inputs]

    @cached_property
    def poles(self) -> Complex:
        """The eigenvalues of A."""
        points, determinants, _ = self._bordered
        return roots(interpolated(points, [Fraction(value) for value in determinants]))

    def relative_degree(self, outputs: tuple[int, ...], inputs: tuple[int, ...]) -> tuple[int, ...] | None:
        """(r_1, ..., r_p) of the square plant with these outputs and inputs; None without a vector relative degree."""
        columns = list(inputs)
        degrees, gains = [], []
        for i in outputs:
            row, gain, degree = self.C[i], self.D[i, columns], 0
            while not np.any(gain != 0) and degree < self.n:
                row, gain, degree = row @ self.A, (row @ self.B)[columns], degree + 1
            degrees.append(degree)
            gains.append(gain)
        B_y = np.array(gains, dtype=object).reshape(len(columns), len(columns))
        return tuple(degrees) if _determinant(_integers(B_y * _row_scales(B_y)[:, None])) else None

    def uncontrollable_modes(self, inputs: tuple[int, ...]) -> Complex:
        """The eigenvalues of A, with multiplicity, that belong to no state which these inputs reach."""
        return _quotient_modes(self.A, self.B[:, list(inputs)])

    def unobservable_modes(self, outputs: tuple[int, ...]) -> Complex:
        """The eigenvalues of A, with multiplicity, that these outputs do not show."""
        return _quotient_modes(self.A.T, self.C[list(outputs)].T)


def _as_printed(M: ArrayLike) -> Rational:
    values = np.asarray(M)
    fractions = [value if isinstance(value, Fraction) else Fraction(repr(float(value))) for value in values.ravel()]
    return np.array(fractions, dtype=object).reshape(values.shape)


def _row_scales(M: Rational) -> Rational:
    return np.array([lcm(*(Fraction(value).denominator for value in row)) for row in M], dtype=object)


def _integers(M: Rational) -> Rational:
    return np.array([[int(value) for value in row] for row in M], dtype=object).reshape(M.shape)


def _eliminated(M: Rational, steps: int) -> tuple[int, Rational]:
    """Fraction-free elimination of the first columns, with pivots in the first rows: their determinant, and the bordered minors."""
    M, previous, sign = M.copy(), 1, 1
    for k in range(steps):
        pivot = next((i for i in range(k, steps) if M[i, k]), None)
        if pivot is None:
            return 0, M[steps:, steps:]
        if pivot != k:
            M[[k, pivot]], sign = M[[pivot, k]], -sign
        M[k + 1 :, k + 1 :] = (M[k + 1 :, k + 1 :] * M[k, k] - np.outer(M[k + 1 :, k], M[k, k + 1 :])) // previous
        previous = M[k, k]
    return sign * previous, sign * M[steps:, steps:]


def _determinant(M: Rational) -> int:
    return _eliminated(M, len(M))[0] if len(M) else 1


def _quotient_modes(A: Rational, B: Rational) -> Complex:
    """The spectrum of A on what is left of the state space when the directions that B reaches are divided out."""
    n = len(A)
    reached: dict[int, Rational] = {}  # by the place of its leading 1: rows of a reduced echelon form
    waiting = list(B.T)
    while waiting:
        vector = waiting.pop().copy()
        for place, row in reached.items():
            if vector[place] != 0:
                vector = vector - vector[place] * row
        place = next((i for i in range(n) if vector[i] != 0), None)
        if place is None:
            continue
        vector = vector / vector[place]
        for other in reached:
            reached[other] = reached[other] - reached[other][place] * vector
        reached[place] = vector
        waiting.append(A @ vector)
    pivots, others = list(reached), [i for i in range(n) if i not in reached]
    if not others:
        return np.zeros(0, dtype=complex)
    left = A[np.ix_(others, others)]
    if pivots:
        left = left - np.array([reached[i][others] for i in pivots], dtype=object).T @ A[np.ix_(pivots, others)]
    n = len(others)
    return ExactPlant(left, np.zeros((n, 0)), np.zeros((0, n)), np.zeros((0, 0))).poles
