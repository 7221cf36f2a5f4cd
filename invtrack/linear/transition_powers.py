"""The powers exp(M h 2^b) from which a propagator's transitions are put together, shared by matrices that contain each other."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from functools import cached_property
from typing import Protocol

import numpy as np

from invtrack.arrays import Array, ComplexArray
from invtrack.linear.scaling import balancing_scale

NODE_ANGLE = 1 / 16
"""Distance h of the nodes from which Taylor series start, times the norm of M."""

DEGREE = 16
"""Terms of exp(M t) - 1 for a norm of M t of at most 1/2: the first one left out is below 1e-18 of the first."""

DIRECT_DIGITS = 4
"""exp(M h 2^b) up to this b comes from its difference from 1, which loses no digits when it is doubled."""


class TransitionPowers(Protocol):
    """exp(M h 2^b) of a matrix M (q, q), in scaled coordinates.

    scale: of the coordinates, powers of two d (q,); matrix: M d_j / d_i (q, q); step: h [s], infinite where nothing moves.
    """

    scale: Array
    matrix: Array
    step: float

    @property
    def pace(self) -> float:
        """How fast exp(M t) changes [rad/s]; 0 without states."""
        ...

    @property
    def eigenvalues(self) -> ComplexArray:
        """Those of M (q,) [rad/s]."""
        ...

    def digit(self, bit: int) -> Array:
        """exp(M h 2^bit) (q, q), in scaled coordinates; of a negative bit too."""
        ...


class OwnPowers:
    """Those of a matrix by itself."""

    def __init__(self, M: Array) -> None:
        # Scales that are powers of two: balancing brings down the norm, and the number of nodes, without rounding.
        self.scale = balancing_scale(M, within_parts=True)
        self.matrix = M * self.scale / self.scale[:, None]
        norm = _norm_bound(self.matrix)
        self.step = NODE_ANGLE / norm if norm > 0 else math.inf
        self._digits: list[Array] = []
        self._finer: dict[int, Array] = {}

    @cached_property
    def pace(self) -> float:
        """How fast exp(M t) changes [rad/s]."""
        return float(np.linalg.norm(self.matrix, 2)) if self.matrix.size else 0.0

    @cached_property
    def eigenvalues(self) -> ComplexArray:
        """Those of M (q,) [rad/s]."""
        return np.linalg.eigvals(self.matrix).astype(complex)

    def digit(self, bit: int) -> Array:
        """exp(M h 2^bit)."""
        if bit < 0:
            if bit not in self._finer:
                self._finer[bit] = np.eye(len(self.matrix)) + exponential_less_one(self.matrix * math.ldexp(self.step, bit))
            return self._finer[bit]
        if not self._digits:
            self._digits = list(itertools.islice(doublings(self.matrix, self.step, 0), DIRECT_DIGITS + 1))
        while len(self._digits) <= bit:
            self._digits.append(self._digits[-1] @ self._digits[-1])
        return self._digits[bit]


class TransposedPowers:
    """Those of the transpose of a matrix."""

    def __init__(self, powers: TransitionPowers) -> None:
        self._powers, self.scale, self.matrix, self.step = powers, 1 / powers.scale, powers.matrix.T, powers.step

    @property
    def pace(self) -> float:
        """How fast exp(M't) changes [rad/s]."""
        return self._powers.pace

    @property
    def eigenvalues(self) -> ComplexArray:
        """Those of M' (q,) [rad/s]."""
        return self._powers.eigenvalues

    def digit(self, bit: int) -> Array:
        """exp(M'h 2^bit)."""
        return self._powers.digit(bit).T


class DrivenPowers:
    """Those of [A D; 0 S], from those of A (n, n): D (n, q), S (q, q) add only products as wide as q.

    exp([A D; 0 S] t) = [exp(A t), F(t); 0, exp(S t)], F(2 t) = exp(A t) F(t) + F(t) exp(S t). Nothing is added to F but what is of
    its own size, so D may be of any: the pace is that of A or S, whichever is faster.
    """

    def __init__(self, powers: TransitionPowers, D: Array, S: Array) -> None:
        self._A, self._S = powers, OwnPowers(S)
        self._finer = max(0, math.ceil(math.log2(powers.step / self._S.step))) if powers.step > self._S.step else 0
        self.step = math.ldexp(powers.step, -self._finer)
        self.scale = np.concatenate([powers.scale, self._S.scale])
        D = D * self._S.scale / powers.scale[:, None]
        self.matrix = np.block([[powers.matrix, D], [np.zeros((len(S), len(powers.matrix))), self._S.matrix]])
        self._digits: list[Array] = []

    @property
    def pace(self) -> float:
        """How fast A or S moves, whichever is faster [rad/s]."""
        return max(self._A.pace, self._S.pace)

    @property
    def eigenvalues(self) -> ComplexArray:
        """Those of A and S (n + q,) [rad/s]."""
        return np.concatenate([self._A.eigenvalues, self._S.eigenvalues])

    def digit(self, bit: int) -> Array:
        """exp([A D; 0 S] h 2^bit)."""
        n = len(self._A.matrix)
        if not self._digits:
            less_one = doublings(self._S.matrix, self.step, 0)
            self._small = list(itertools.islice(less_one, DIRECT_DIGITS + 1))
            self._digits = [self._block(0, self._forced(), self._small[0])]
        while len(self._digits) <= bit:
            last = self._digits[-1]
            number, F, E_S = len(self._digits), last[:n, n:], last[n:, n:]
            small = self._small[number] if number < len(self._small) else E_S @ E_S
            self._digits.append(self._block(number, last[:n, :n] @ F + F @ E_S, small))
        return self._digits[bit]

    def _block(self, bit: int, F: Array, E_S: Array) -> Array:
        """exp([A D; 0 S] h 2^bit) from its parts."""
        n = len(F)
        result = np.zeros_like(self.matrix)
        result[:n, :n], result[:n, n:], result[n:, n:] = self._A.digit(bit - self._finer), F, E_S
        return result

    def _forced(self) -> Array:
        """F(h), by its Taylor series."""
        n = len(self._A.matrix)
        A, S = self._A.matrix * self.step, self._S.matrix * self.step
        term = driven = self.matrix[:n, n:] * self.step
        result = term.copy()
        for k in range(2, DEGREE + 1):  # term: (the corner of [A D; 0 S]^k) / k!, driven: D S^(k - 1) / (k - 1)!
            driven = driven @ S / (k - 1)
            term = (A @ term + driven) / k
            result += term
        return result


def doublings(M: Array, spacing: float, halvings: int) -> Iterator[Array]:
    """exp(M 2^j spacing) for j = 0, 1, ...: what they differ from 1 by is doubled, which keeps the digits of small ones.

    M (q, q); halvings: of the spacing, until its product with the norm of M is at most 1/2.
    """
    less_one = exponential_less_one(M * math.ldexp(spacing, -halvings))
    for _ in range(halvings):
        less_one = 2 * less_one + less_one @ less_one
    while True:
        yield np.eye(len(M)) + less_one
        less_one = 2 * less_one + less_one @ less_one


def exponential_less_one(M: Array) -> Array:
    """exp(M) - 1 of a matrix (q, q) with a norm of at most 1/2, to the precision of its own entries.

    Source: M. Paterson, L. Stockmeyer, "On the number of nonscalar multiplications necessary to evaluate polynomials", SIAM J.
    Computing 2, 1973.
    """
    powers = [M]
    while len(powers) ** 2 < DEGREE:
        powers.append(powers[-1] @ M)
    result = np.zeros_like(M)
    for first in reversed(range(0, DEGREE, len(powers))):
        result = powers[-1] @ result if first + len(powers) < DEGREE else result
        for j, power in enumerate(powers[: DEGREE - first], start=first + 1):
            result += power / math.factorial(j)
    return result


def _norm_bound(M: Array) -> float:
    """A bound on a norm of M (q, q), the smaller one of two: the largest column sum, or the 2-norm by that of M'M."""
    if not M.size:
        return 0.0
    norm = float(np.linalg.norm(M, 1))
    if norm == 0:
        return 0.0
    M = M / norm
    return norm * min(1.0, math.sqrt(float(np.linalg.norm(M.T @ M, 1))))
