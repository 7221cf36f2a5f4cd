"""Polynomials with integer coefficients: through given values, and all their roots with their multiplicities.

Multiplicities come from greatest common divisors; roots of what is then free of repeated ones are improved all at once (O. Aberth,
Mathematics of Computation 27, 1973) with exact values of the polynomial, so that rounding cannot hold them up.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from itertools import count
from math import gcd, lcm

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
Polynomial = list[int]  # coefficients of 1, s, s^2, ..., the last one not zero; the zero polynomial is empty

ABERTH_STEPS = 200


def roots(polynomial: Polynomial) -> Complex:
    """All roots of a polynomial with integer coefficients, as often as they occur, each to rounding."""
    at_origin = next(i for i, coefficient in enumerate(polynomial) if coefficient)
    found = [0j] * at_origin
    for factor, multiplicity in _square_free(polynomial[at_origin:]):
        found += [complex(root) for root in _simple_roots(factor) for _ in range(multiplicity)]
    return np.array(found, dtype=complex)


def interpolated(points: Sequence[int], values: Sequence[Fraction]) -> Polynomial:
    """The polynomial through these values, up to a factor, in coprime integers."""
    differences = list(values)
    for order in range(1, len(points)):
        for i in range(len(points) - 1, order - 1, -1):
            differences[i] = (differences[i] - differences[i - 1]) / (points[i] - points[i - order])
    coefficients = [Fraction(0)]
    for point, difference in zip(points[::-1], differences[::-1], strict=True):
        shifted = [Fraction(0), *coefficients]
        coefficients = [a - point * b for a, b in zip(shifted, [*coefficients, Fraction(0)], strict=True)]
        coefficients[0] += difference
    scale = lcm(*(value.denominator for value in coefficients))
    return _primitive([int(value * scale) for value in coefficients])


def _primitive(polynomial: Sequence[int]) -> Polynomial:
    degree = max((i for i, coefficient in enumerate(polynomial) if coefficient), default=-1)
    shared = gcd(*polynomial[: degree + 1]) if degree >= 0 else 1
    return [coefficient // shared for coefficient in polynomial[: degree + 1]]


def _derivative(polynomial: Polynomial) -> Polynomial:
    return [k * coefficient for k, coefficient in enumerate(polynomial)][1:]


def _remainder(a: Polynomial, b: Polynomial) -> Polynomial:
    """What is left of a when b is divided out, up to a factor, in coprime integers."""
    rest = list(a)
    for k in range(len(a) - len(b), -1, -1):
        shared = gcd(rest[-1], b[-1])
        ours, theirs = b[-1] // shared, rest[-1] // shared
        rest = [ours * value for value in rest]
        for i, coefficient in enumerate(b):
            rest[k + i] -= theirs * coefficient
        rest.pop()
    return _primitive(rest)


def _exact_quotient(a: Polynomial, b: Polynomial) -> Polynomial:
    """a / b of coprime integers, b a divisor of a: the quotient has coprime integers too (Gauss)."""
    rest, quotient = list(a), [0] * (len(a) - len(b) + 1)
    for k in range(len(a) - len(b), -1, -1):
        quotient[k] = rest[k + len(b) - 1] // b[-1]
        for i, coefficient in enumerate(b):
            rest[k + i] -= quotient[k] * coefficient
    return quotient


def _common_divisor(a: Polynomial, b: Polynomial) -> Polynomial:
    while b:
        a, b = b, _remainder(a, b)
    return _primitive(a)


def _square_free(polynomial: Polynomial) -> list[tuple[Polynomial, int]]:
    """Factors without repeated roots, with the multiplicity of their roots in the polynomial (Musser 1971)."""
    repeated = _common_divisor(polynomial, _derivative(polynomial)) if len(polynomial) > 1 else [1]
    simple, factors = _exact_quotient(polynomial, repeated), []
    for multiplicity in count(1):
        if len(simple) <= 1:
            return factors
        shared = _common_divisor(simple, repeated)
        factor = _exact_quotient(simple, shared)
        if len(factor) > 1:
            factors.append((factor, multiplicity))
        simple, repeated = shared, _exact_quotient(repeated, shared)
    raise AssertionError


def _simple_roots(polynomial: Polynomial) -> Complex:
    """Roots of a polynomial without repeated ones, all of them improved at once until none moves by more than rounding."""
    z = np.roots([float(Fraction(value, polynomial[-1])) for value in polynomial[::-1]]).astype(complex)
    for _ in range(ABERTH_STEPS):
        newton = np.array([_newton_step(polynomial, complex(root)) for root in z])
        distances = z[:, None] - z
        np.fill_diagonal(distances, np.inf)
        step = newton / (1 - newton * np.sum(1 / distances, axis=1))
        z = z - step
        if np.all(np.abs(step) <= 2e-16 * np.abs(z)):
            return z
    raise AssertionError(f"the roots of a polynomial of degree {len(polynomial) - 1} did not settle: last steps {np.abs(step)}")


def _newton_step(polynomial: Polynomial, z: complex) -> complex:
    """P(z) / P'(z), rounded once."""
    re, im = Fraction(z.real), Fraction(z.imag)
    unit = max(re.denominator, im.denominator)  # both are powers of two
    x, y = int(re * unit), int(im * unit)
    (a, b), (c, d) = _value(polynomial, x, y, unit), _value(_derivative(polynomial), x, y, unit)
    size = (c * c + d * d) * unit
    return complex((a * c + b * d) / size, (b * c - a * d) / size)


def _value(polynomial: Polynomial, x: int, y: int, unit: int) -> tuple[int, int]:
    """P((x + i y) / unit), times unit to the degree of P."""
    a, b, power = 0, 0, 1
    for coefficient in polynomial[::-1]:
        a, b = a * x - b * y + coefficient * power, a * y + b * x
        power *= unit
    return a, b
