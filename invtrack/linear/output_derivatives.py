"""Combinations of outputs and their derivatives: what an inverse asks of the outputs that it is to produce."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array


@dataclass(frozen=True, eq=False)
class OutputDerivatives:
    """The combinations sum_k M_k y^(k) of p outputs: coefficients M (K + 1, m, p)."""

    coefficients: Array

    @property
    def highest(self) -> tuple[int, ...]:
        """Highest derivative of each output that occurs, -1 for one that does not (p,)."""
        occurs = np.any(self.coefficients != 0, axis=1)
        return tuple(np.max(np.where(occurs, np.arange(len(occurs))[:, None], -1), axis=0, initial=-1).tolist())

    def combination(self, row: int) -> Array:
        """The coefficients of one combination (K + 1, p), up to the highest order in it."""
        found = self.coefficients[:, row]
        return found[: int(np.max(np.flatnonzero(np.any(found != 0, axis=1)), initial=-1)) + 1]

    def rows(self, derivative: Callable[[int], Array]) -> Array:
        """The combinations (m, q) on the state w of a signal with the derivatives y^(k) = derivative(k) @ w, (p, q) for each k."""
        result = np.zeros((self.coefficients.shape[1], derivative(0).shape[1]))
        for k, used, M in self._terms:
            result += M[:, used] @ derivative(k)[used]
        return result

    def size(self, size: Callable[[int], Array]) -> Array:
        """What the terms can add up to (m,), from the sizes of the derivatives: (p,) for each k."""
        result = np.zeros(self.coefficients.shape[1])
        for k, used, M in self._terms:
            result += np.abs(M[:, used]) @ size(k)[used]
        return result

    @cached_property
    def _terms(self) -> list[tuple[int, Array, Array]]:
        """Orders k that occur, with the outputs in which they do and M_k: a derivative that does not occur need not exist."""
        found = ((k, np.any(M != 0, axis=0), M) for k, M in enumerate(self.coefficients))
        return [(k, used, M) for k, used, M in found if np.any(used)]
