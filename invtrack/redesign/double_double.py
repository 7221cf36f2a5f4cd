"""Matrices in about twice the working precision, for residuals that cancel: each is the sum of two matrices of doubles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices

DIGITS = 105
"""Binary digits to which factors are cut, below the largest entry of a row or column: a sum of two doubles has one more."""

MANTISSA = 53
"""Binary digits of a double."""


@dataclass(frozen=True, eq=False)
class DoubleDouble:
    """high + low, both (m, n), low within half a unit in the last place of high.

    Products are summed without rounding: the factors are cut into slices of so few digits that the products of two slices are exact
    in doubles, and so are the sums of all that are of one order, whatever the order in which they are added up: one product of
    matrices with the slices side by side. The sums, each far smaller than the last, are then added in twice the precision.
    Errors are about 2^-100 of the largest entry of a row of the first factor times that of a column of the second.

    Sources: T. Dekker, "A floating-point technique for extending the available precision", Numerische Mathematik 18, 1971;
    K. Ozaki, T. Ogita, S. Oishi, S. Rump, "Error-free transformations of matrix multiplication", Numerical Algorithms 59, 2012.
    """

    high: Array
    low: Array

    @classmethod
    def of(cls, matrix: Array) -> DoubleDouble:
        """A matrix of doubles as it is."""
        return cls(matrix, np.zeros_like(matrix))

    @property
    def transposed(self) -> DoubleDouble:
        """The transpose."""
        return DoubleDouble(self.high.T, self.low.T)

    @property
    def rounded(self) -> Array:
        """The nearest matrix of doubles."""
        return self.high + self.low

    @property
    def symmetric(self) -> DoubleDouble:
        """The mean of the matrix and its transpose."""
        both = self + self.transposed
        return DoubleDouble(both.high / 2, both.low / 2)

    def __neg__(self) -> DoubleDouble:
        return DoubleDouble(-self.high, -self.low)

    def __add__(self, other: DoubleDouble) -> DoubleDouble:
        high, error = _two_sum(self.high, other.high)
        low, low_error = _two_sum(self.low, other.low)
        high, error = _two_sum(high, error + low)
        return DoubleDouble(*_two_sum(high, error + low_error))

    def __sub__(self, other: DoubleDouble) -> DoubleDouble:
        return self + -other

    def __matmul__(self, other: DoubleDouble) -> DoubleDouble:
        terms = self.high.shape[1]
        bits = (MANTISSA - 1 - math.ceil(math.log2(max(terms, 2)))) // 2
        left, rows = _slices(self.high, self.low, bits)
        right, columns = _slices(other.high.T, other.low.T, bits)
        left_side, right_side = np.hstack(left), np.hstack(right[::-1]).T
        orders = []
        for order in range(min(-(-DIGITS // bits), len(left) + len(right) - 1)):
            # Slice i of the one times slice order - i of the other, from the first i to the last.
            first, last = max(0, order - len(right) + 1), min(order, len(left) - 1)
            start = len(right) - 1 - order + first
            orders.append(
                left_side[:, first * terms : (last + 1) * terms] @ right_side[start * terms : (start + last + 1 - first) * terms]
            )
        return _descending_sum(orders, rows, columns)


def _slices(high: Array, low: Array, bits: int) -> tuple[list[Array], Indices]:
    """Slices (m, n) of `bits` digits each, which add up to the matrix 2^-exponent (high + low), and the exponents (m,).

    These make the largest entry of each row about one. There is at least one, and as many as hold DIGITS digits, or all there are.
    """
    _, exponent = np.frexp(np.max(np.abs(high), axis=1, initial=0.0))
    high, low = np.ldexp(high, -exponent[:, None]), np.ldexp(low, -exponent[:, None])
    found: list[Array] = []
    while not found or (len(found) * bits < DIGITS and high.any()):
        unit = math.ldexp(1.0, -bits * (len(found) + 1))
        piece = high / unit
        np.rint(piece, out=piece)
        piece *= unit
        found.append(piece)
        high -= piece
        high, low = _two_sum(high, low)
    return found, exponent


def _descending_sum(terms: list[Array], rows: Indices, columns: Indices) -> DoubleDouble:
    """The sum of exact terms (m, n), each far smaller than the one before, times 2^rows_i 2^columns_j."""
    high, low = np.zeros((len(rows), len(columns))), np.zeros((len(rows), len(columns)))
    for term in reversed(terms):
        high, error = _two_sum(term, high)
        low += error
    exponent = rows[:, None] + columns
    return DoubleDouble(*(np.ldexp(part, exponent) for part in _two_sum(high, low)))


def _two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b rounded, and the rounding error, without error."""
    total = a + b
    part = total - a
    error = total - part
    np.subtract(a, error, out=error)
    np.subtract(b, part, out=part)
    error += part
    return total, error
