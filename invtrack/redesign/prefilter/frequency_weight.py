"""A weight that may vary with frequency, checked wherever it is evaluated."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, hermitian_weight, masked, real_weight
from invtrack.errors import RedesignError
from invtrack.redesign.cost import square_root

WeightLike = ArrayLike | Callable[[float], ArrayLike]
"""A number, a matrix, or a function of the frequency [rad/s] with such values."""

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
        (value,) = self.many(np.array([w]))
        return np.asarray(value)

    def many(self, w: Array) -> ComplexArray:
        """W(w) at frequencies w (m,): (m, k, k). Raises as `at` does, for the first frequency at which something is wrong."""
        shape = (len(w), self.size, self.size)
        if not callable(self.value):
            return np.broadcast_to(self.value.astype(complex), shape)
        given = [self._given(self.value, float(frequency)) for frequency in w]
        hidden = [masked(value) for value in given]
        try:
            values = np.zeros(()) if any(hidden) else np.array(given, dtype=complex)
        except (TypeError, ValueError, OverflowError):  # values of several shapes, or some that are no numbers
            values = np.zeros((), dtype=complex)
        plain: ComplexArray = np.zeros(shape, dtype=complex)
        if values.shape == shape:
            plain[:] = values
        elif values.shape == shape[:1]:
            plain[:, np.arange(self.size), np.arange(self.size)] = values[:, None]
        else:
            plain[:] = np.nan
        plain[hidden] = np.nan
        # What is beyond doubt needs no closer look: finite, Hermitian to the last digit, no negative eigenvalue.
        doubtful = ~np.all(np.isfinite(plain), axis=(1, 2))
        doubtful |= np.any(plain != np.swapaxes(plain.conj(), 1, 2), axis=(1, 2))
        doubtful[~doubtful] = np.linalg.eigvalsh(plain[~doubtful])[:, 0] < 0
        for j in np.flatnonzero(doubtful):
            plain[j] = self._checked(given[j], float(w[j]))
        return plain

    def factor(self, w: Array) -> ComplexArray:
        """F(w) with F*F = W at frequencies w (m,), not negative: (m, k, k)."""
        if not callable(self.value):
            return np.broadcast_to(square_root(self.at(0.0)), (len(w), self.size, self.size))
        return square_root(self.many(w))

    def _given(self, function: Callable[[float], ArrayLike], w: float) -> ArrayLike:
        try:
            return function(w)
        except Exception as reason:  # whatever a user's function ends in, it is the weight that cannot be used
            raise RedesignError(
                f"the function {self.name} of the frequency must have a value at every w [rad/s], 0 and negative ones included; at "
                f"w = {w:.6g} rad/s it ends in {type(reason).__name__}: {reason}"
            ) from reason

    def _checked(self, value: ArrayLike, w: float) -> ComplexArray:
        where = f" at w = {w:.6g} rad/s"
        return hermitian_weight(self.name, value, self.size, where=where, error=RedesignError)


def frequency_weight(name: str, value: WeightLike, size: int, probes: Array) -> FrequencyWeight:
    """A weight, checked at the frequencies `probes` (m,) [rad/s]; a number stands for a multiple of the identity.

    Raises RedesignError for a wrong shape, a weight that is not Hermitian positive semidefinite, a constant that is not real, or a
    function whose values at w and -w are not conjugate (a real trajectory would then have a complex optimum).
    """
    if not callable(value):
        return FrequencyWeight(name, size, real_weight(name, value, size, error=RedesignError))
    weight = FrequencyWeight(name, size, value)
    for w in probes:
        here, mirrored = weight.at(float(w)), weight.at(-float(w))
        if np.max(np.abs(mirrored - here.conj())) > CONJUGATE_TOLERANCE * np.linalg.norm(here):
            raise RedesignError(
                f"{name} must have conjugate values at w and -w so that the redesign is real; at w = {w:.6g} rad/s it has not "
                "(use |w| in its formula)"
            )
    return weight
