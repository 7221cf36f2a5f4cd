"""Polynomials of high degree from their Bernstein coefficients: where to cut them, and their exact derivatives there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import TrajectoryError

ONE_PIECE_DEGREE = 2
"""Up to this degree the derivatives at one end tell a whole bounded polynomial, to within 20 roundings."""

DEGREES_PER_PIECE = 2
"""One of higher degree gets a piece for so many degrees: whatever the degree, that costs less than a thousand roundings."""

SHORT_SHARES = 2.0**16
"""Breakpoints lie at multiples of one part in so many of a motion, so that exact arithmetic mostly has short numbers to work on."""


def pieces_for(degree: int) -> int:
    """How many graded pieces a bounded polynomial of this degree needs."""
    return 1 if degree <= ONE_PIECE_DEGREE else -(-degree // DEGREES_PER_PIECE)


def graded_breakpoints(start: float, end: float, pieces: int) -> Array:
    """Breakpoints (pieces + 1,) [s] that lie densest at the ends, as the extrema of Chebyshev polynomials do.

    A bounded polynomial changes fastest at the ends: its Taylor series about a point there, every term taken positive, grows with
    the degree times the angle by which the next breakpoint is away on the half circle over [start, end]. Raises TrajectoryError
    where rounding leaves no room for the pieces.
    """
    share = np.rint((1 - np.cos(np.pi * np.arange(pieces + 1) / pieces)) / 2 * SHORT_SHARES) / SHORT_SHARES
    with np.errstate(over="ignore", invalid="ignore"):
        times = np.asarray(start + (end - start) * share)
    times[-1] = end
    if not np.all(np.isfinite(times)) or np.any(times[1:] <= times[:-1]):
        raise TrajectoryError(
            f"from {start:.17g} s to {end:.17g} s there is no room for the {pieces} piece(s) of a polynomial: times of that size "
            f"are rounded to {abs(np.spacing(-max(abs(start), abs(end)) / 2)) * 2:.1e} s; count time from the start of the motion"
        )
    return times


def bernstein_derivatives(coefficients: Sequence[int | Fraction], breakpoints: Array, unit: float) -> Array:
    """y^(i) unit^i at the start of every piece of one polynomial, each right to the last bit: (pieces, degree + 1).

    De Casteljau's algorithm in whole numbers: floating-point breakpoints are rational numbers, and so are the shares of the span
    at which they lie, whatever rounding has made of them.

    Args:
        coefficients: b_j with y = sum of b_j C(d, j) s^j (1 - s)^(d - j), s from 0 to 1 over all pieces (d + 1,).
        breakpoints: of the pieces (pieces + 1,) [s].
        unit: of time, for the derivatives [s].

    Raises TrajectoryError for derivatives beyond the range of floating-point numbers.
    """
    degree = len(coefficients) - 1
    first, last = Fraction(breakpoints[0]), Fraction(breakpoints[-1])
    ratio = Fraction(unit) / (last - first)
    shared = math.lcm(*(c.denominator for c in coefficients))
    whole = [int(c * shared) for c in coefficients]
    binomials = [[math.comb(i, j) * (-1) ** (i - j) for j in range(i + 1)] for i in range(degree + 1)]
    result = np.empty((len(breakpoints) - 1, degree + 1))
    for row, time in zip(result, breakpoints[:-1].tolist(), strict=True):
        share = (Fraction(time) - first) / (last - first)
        a, b = share.numerator, share.denominator
        level, divisor = whole, shared
        for order in range(degree, -1, -1):  # level: the coefficients after degree - order steps, times divisor
            difference = sum(c * value for c, value in zip(binomials[order], level, strict=False))
            factor = math.perm(degree, order) * ratio.numerator**order
            try:
                row[order] = factor * difference / (ratio.denominator**order * divisor)
            except OverflowError as reason:
                raise TrajectoryError(
                    f"the derivative of order {order} of a polynomial of degree {degree} is beyond the range of floating-point "
                    "numbers; lower the degree, or the size of the coefficients"
                ) from reason
            level = [(b - a) * left + a * right for left, right in pairwise(level)]
            divisor *= b
    return result
