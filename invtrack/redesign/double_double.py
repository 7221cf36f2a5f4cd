"""Matrices in about twice the working precision, for residuals that cancel: each is the sum of two matrices of doubles."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array

DIGITS = 106
"""Binary digits of a sum of two doubles."""

MANTISSA = 53
"""Binary digits of a double."""


@dataclass(frozen=True, eq=False)
class DoubleDouble:
    """high + low, both (m, n), low within half a unit in the last place of high.

    Products are summed without rounding: the factors are cut into slices of so few digits that the products of two slices are exact
    in doubles, whatever the order in which they are added up, and the slices' products are then added in twice the precision.
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
        bits = (MANTISSA - math.ceil(math.log2(max(terms, 2)))) // 2
        count = -(-DIGITS // bits)
        left, right = self._slices(1, bits, count), other._slices(0, bits, count)
        total = DoubleDouble.of(np.zeros((len(self.high), other.high.shape[1])))
        for order in range(count - 1, -1, -1):  # from the small products to the large ones
            for i in range(max(0, order - len(right) + 1), min(order + 1, len(left))):
                total = total + DoubleDouble.of(left[i] @ right[order - i])
        return total

    def _slices(self, axis: int, bits: int, count: int) -> list[Array]:
        """Matrices of `bits` digits each, below the largest entry along `axis`, that add up to this one, without trailing zeros."""
        high, low = self.high, self.low
        _, exponent = np.frexp(np.max(np.abs(high), axis=axis, keepdims=True, initial=0.0))
        found = []
        for number in range(1, count + 1):
            if not np.any(high):
                break
            unit = np.ldexp(1.0, exponent - bits * number)
            piece = np.rint(high / unit) * unit
            found.append(piece)
            high, low = _two_sum(high - piece, low)
        return found


def _two_sum(a: Array, b: Array) -> tuple[Array, Array]:
    """a + b rounded, and the rounding error, without error."""
    total = a + b
    part = total - a
    return total, (a - (total - part)) + (b - part)
