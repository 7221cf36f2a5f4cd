"""Explicit Runge-Kutta methods, and even steps by one of them under inputs that are polynomials."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array


@dataclass(frozen=True, eq=False)
class RungeKutta:
    """k_i = f(t + c_i h, x + h sum_j a_ij k_j), x(t + h) = x + h sum_i b_i k_i, of s stages.

    Args:
        name: of the method.
        order: power of h with which its error over a time falls.
        a, b, c: (s, s), zero on and above the diagonal, (s,) and (s,).
    """

    name: str
    order: int
    a: Array
    b: Array
    c: Array

    @classmethod
    def of(cls, name: str, order: int, rows: list[list[float]], b: list[float]) -> RungeKutta:
        """From the rows of a below the diagonal."""
        a = np.zeros((len(b), len(b)))
        for i, row in enumerate(rows, start=1):
            a[i, : len(row)] = row
        return cls(name, order, a, np.array(b), a.sum(axis=1))


CLASSICAL = RungeKutta.of("classical", 4, [[1 / 2], [0, 1 / 2], [0, 0, 1]], [1 / 6, 1 / 3, 1 / 3, 1 / 6])
"""MuJoCo's RK4."""

_R = float(np.sqrt(21))

EIGHTH_ORDER = RungeKutta.of(
    "Cooper and Verner",
    8,
    [
        [1 / 2],
        [1 / 4, 1 / 4],
        [1 / 7, (-7 - 3 * _R) / 98, (21 + 5 * _R) / 49],
        [(11 + _R) / 84, 0, (18 + 4 * _R) / 63, (21 - _R) / 252],
        [(5 + _R) / 48, 0, (9 + _R) / 36, (-231 + 14 * _R) / 360, (63 - 7 * _R) / 80],
        [(10 - _R) / 42, 0, (-432 + 92 * _R) / 315, (633 - 145 * _R) / 90, (-504 + 115 * _R) / 70, (63 - 13 * _R) / 35],
        [1 / 14, 0, 0, 0, (14 - 3 * _R) / 126, (13 - 3 * _R) / 63, 1 / 9],
        [1 / 32, 0, 0, 0, (91 - 21 * _R) / 576, 11 / 72, (-385 - 75 * _R) / 1152, (63 + 13 * _R) / 128],
        [1 / 14, 0, 0, 0, 1 / 9, (-733 - 147 * _R) / 2205, (515 + 111 * _R) / 504, (-51 - 11 * _R) / 56, (132 + 28 * _R) / 245],
        [0, 0, 0, 0, (-42 + 7 * _R) / 18, (-18 + 28 * _R) / 45, (-273 - 53 * _R) / 72, (301 + 53 * _R) / 72,
         (28 - 28 * _R) / 45, (49 - 7 * _R) / 18],
    ],
    [1 / 20, 0, 0, 0, 0, 0, 0, 49 / 180, 16 / 45, 49 / 180, 1 / 20],
)  # fmt: skip
"""Eleven stages (G. J. Cooper and J. H. Verner, SIAM J. Numer. Anal. 9, 1972), at Lobatto's points of the step."""


@dataclass(frozen=True, eq=False)
class Steps:
    """How motions over elements of time are integrated: in even steps, the input a polynomial over each element.

    Args:
        method: of each step.
        number: of steps on an element, S.
        count: coefficients of each input on an element, s, of shifted Legendre polynomials.
    """

    method: RungeKutta
    number: int
    count: int

    @cached_property
    def basis(self) -> Array:
        """The polynomials at all stages of all steps (S, stages, s)."""
        shares = (np.arange(self.number)[:, None] + self.method.c) / self.number
        return np.ascontiguousarray(legendre(self.count, shares.ravel()).reshape(*shares.shape, self.count))


def legendre(count: int, shares: Array) -> Array:
    """The first `count` Legendre polynomials on [0, 1] at shares (k,) of it: (k, count)."""
    return np.asarray(np.polynomial.legendre.legvander(2 * shares - 1, count - 1), dtype=float)
