"""Polynomials in a few variables without constant term: their monomials, products and fits."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices

SAMPLES_PER_MONOMIAL = 2.0
"""Points at which a polynomial is fitted, for each of its coefficients; half of them are the others' mirror images."""


@dataclass(frozen=True, eq=False)
class Powers:
    """The monomials phi(w) = (w^alpha) with 1 <= |alpha| <= d of k variables, and of others no more than these themselves.

    The variables come first, those in powers before those without; then the monomials of higher degree, lowest first.

    Args:
        variables: k.
        degree: d.
        plain: how many others there are.
    """

    variables: int
    degree: int
    plain: int = 0

    @classmethod
    def most(cls, variables: int, monomials: int, degree: int) -> Powers:
        """As many degrees as make no more than so many monomials, one at least, at most `degree`."""
        found = [cls(variables, d) for d in range(1, degree + 1)]
        return max((each for each in found if each.degree == 1 or len(each) <= monomials), key=lambda each: each.degree)

    @property
    def all(self) -> int:
        """Number of variables in all."""
        return self.variables + self.plain

    @cached_property
    def exponents(self) -> Indices:
        """alpha of each monomial (K, k)."""
        found = list(np.eye(self.all, dtype=np.intp))
        for degree in range(2, self.degree + 1):
            for chosen in itertools.combinations_with_replacement(range(self.variables), degree):
                found.append(np.bincount(np.array(chosen, dtype=np.intp), minlength=self.all))
        return np.array(found, dtype=np.intp).reshape(len(found), self.all)

    def __len__(self) -> int:
        """K, the number of monomials."""
        return math.comb(self.variables + self.degree, self.degree) - 1 + self.plain

    def values(self, w: Array) -> Array:
        """phi(w) (..., K) for w (..., k)."""
        return np.asarray(np.prod(w[..., None, :] ** self.exponents, axis=-1))

    def slopes(self, w: Array) -> Array:
        """The derivatives of phi at w (k,): (K, k)."""
        result = np.empty((len(self), self.all))
        for i in range(self.all):
            lower = self.exponents.copy()
            lower[:, i] = np.maximum(lower[:, i] - 1, 0)
            result[:, i] = self.exponents[:, i] * np.prod(w**lower, axis=1)
        return result

    def carried(self, N: Array) -> Array:
        """P (K, K) with phi(N phi(w)) = P phi(w) up to degree d, for a map w -> N phi(w), N (k, K)."""
        P, (places, first, second) = np.zeros((len(self), len(self))), self._products
        P[: self.all] = N
        for row in range(self.all, len(self)):
            i = int(np.argmax(self.exponents[row] > 0))
            lower = self.exponents[row].copy()
            lower[i] -= 1
            before = int(np.flatnonzero(np.all(self.exponents == lower, axis=1))[0])
            np.add.at(P[row], places, P[before, first] * N[i, second])
        return P

    @cached_property
    def _products(self) -> tuple[Indices, Indices, Indices]:
        """Monomials, and which two make each as their product."""
        places = {tuple(alpha): place for place, alpha in enumerate(self.exponents.tolist())}
        pairs = itertools.product(enumerate(self.exponents), repeat=2)
        made = [(places.get(tuple((one + other).tolist()), -1), i, j) for (i, one), (j, other) in pairs]
        found = np.array([each for each in made if each[0] >= 0], dtype=np.intp).reshape(-1, 3)
        return found[:, 0], found[:, 1], found[:, 2]

    @cached_property
    def samples(self) -> Array:
        """Points (s, k) in the cube |w_i| <= 1 to fit polynomials at: a sequence that fills it evenly, denser to its faces."""
        count = int(np.ceil(SAMPLES_PER_MONOMIAL * len(self) / 2)) + 1
        # The generalised golden ratio's powers make the steps (M. Roberts, "The unreasonable effectiveness of quasirandom
        # sequences", 2018); cosines of even angles are where polynomials are best fitted.
        root = 2.0
        for _ in range(60):
            root = (1 + root) ** (1 / (self.all + 1))
        shares = (0.5 + np.arange(1, count + 1)[:, None] / root ** np.arange(1, self.all + 1)) % 1.0
        half = np.cos(np.pi * shares)
        return np.vstack([half, -half])

    @cached_property
    def _fit(self) -> Array:
        return np.asarray(np.linalg.pinv(self.values(self.samples)))

    def fitted(self, values: Array) -> Array:
        """Coefficients (r, K) of the polynomials nearest to values (s, r) at the samples."""
        return np.asarray((self._fit @ values).T)
