"""Weights of the redesign's cost, constant or varying with frequency."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import RedesignError
from invtrack.redesign.weights import real_weight, weight_matrix

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]
WeightLike = ArrayLike | Callable[[float], ArrayLike]

CONJUGATE_TOLERANCE = 1e-9
"""Largest departure from W(-w) = conj W(w), as a share of the weight's norm."""


@dataclass(frozen=True, eq=False)
class FrequencyWeight:
    """A weight W(w) (k, k), Hermitian, positive semidefinite, W(-w) = conj W(w): a constant, or a function of w [rad/s]."""

    name: str
    size: int
    value: Array | Callable[[float], ArrayLike]

    @property
    def is_constant(self) -> bool:
        """Whether the weight is the same at all frequencies."""
        return not callable(self.value)

    @property
    def is_zero(self) -> bool:
        """Whether the weight is a constant without any entry."""
        return not callable(self.value) and not np.any(self.value)

    def at(self, w: float) -> ComplexArray:
        """W(w) (k, k). Raises RedesignError where it is malformed, not Hermitian or not positive semidefinite."""
        if callable(self.value):
            return weight_matrix(self.name, self.value(w), self.size, where=f" at w = {w:.6g} rad/s")
        return self.value.astype(complex)

    def factor(self, w: Array) -> ComplexArray:
        """F(w) with F*F = W at frequencies w (m,), not negative: (m, k, k)."""
        if not callable(self.value):
            return np.broadcast_to(_square_root(self.at(0.0)), (len(w), self.size, self.size))
        if len(w) == 0:
            return np.zeros((0, self.size, self.size), dtype=complex)
        return _square_root(np.stack([self.at(float(frequency)) for frequency in w]))


def frequency_weight(name: str, value: WeightLike, size: int, probes: Array) -> FrequencyWeight:
    """A weight, checked at the frequencies `probes` (m,) [rad/s]; a number stands for a multiple of the identity.

    Raises RedesignError for a wrong shape, a weight that is not Hermitian positive semidefinite, a constant that is not real, or a
    function whose values at w and -w are not conjugate (a real trajectory would then have a complex optimum).
    """
    if not callable(value):
        return FrequencyWeight(name, size, real_weight(name, value, size))
    weight = FrequencyWeight(name, size, value)
    for w in probes:
        here, mirrored = weight.at(float(w)), weight.at(-float(w))
        if np.max(np.abs(mirrored - here.conj())) > CONJUGATE_TOLERANCE * np.linalg.norm(here):
            raise RedesignError(
                f"{name} must have conjugate values at w and -w so that the redesign is real; at w = {w:.6g} rad/s it has not "
                "(use |w| in its formula)"
            )
    return weight


def _square_root(matrices: ComplexArray) -> ComplexArray:
    values, vectors = np.linalg.eigh(matrices)
    root: ComplexArray = np.sqrt(np.maximum(values, 0.0))[..., None] * np.swapaxes(vectors.conj(), -1, -2)
    return root
