"""A plant from the literature, with what its source says about it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.linear.state_space import StateSpace
from tests.published.exact import ExactPlant

Array = NDArray[np.float64]


Channels = tuple[int, ...]
Choice = tuple[Channels, Channels]  # outputs and inputs of a square plant


def matrix(text: str) -> Array:
    """A matrix from its rows as they are printed, with a semicolon between them."""
    return np.array([[float(entry) for entry in row.split()] for row in text.split(";")])


@dataclass(frozen=True)
class Figures:
    """Complex numbers as a source prints them, and half a unit of their last digit: how far right values may be off."""

    values: tuple[complex, ...]
    rounding: float


@dataclass(frozen=True, eq=False)
class PublishedPlant:
    """x' = A x + B u, y = C x + D u, with the numbers that a source prints.

    Args:
        name, source: of the plant, and where its numbers stand.
        A, B, C: (n, n), (n, m) and (q, n).
        D: (q, m); by default zero.
        outputs, inputs: the rows of C and D and the columns of B and D to invert, as many of these as of those; by default all.
        zeros, poles: where the literature gives them.
        gain: G(0) from the inputs to the outputs as printed, with half a unit of its last digits, both (p, p).
        duration: of a motion that suits the plant [s, or the source's unit of time].
    """

    name: str
    source: str
    A: ArrayLike
    B: ArrayLike
    C: ArrayLike
    D: ArrayLike | None = None
    outputs: Channels | None = None
    inputs: Channels | None = None
    zeros: Figures | None = None
    poles: Figures | None = None
    gain: tuple[ArrayLike, ArrayLike] | None = None
    duration: float = 4.0

    def __str__(self) -> str:
        return self.name

    @cached_property
    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D with all outputs."""
        A, B, C = (np.array(M, dtype=float) for M in (self.A, self.B, self.C))
        return A, B, C, np.zeros((len(C), B.shape[1])) if self.D is None else np.array(self.D, dtype=float)

    @cached_property
    def exact(self) -> ExactPlant:
        """The same with the printed decimals as fractions."""
        return ExactPlant(*self.matrices)

    @property
    def chosen(self) -> Choice:
        """The outputs and inputs to invert."""
        _, B, C, _ = self.matrices
        return self.outputs or tuple(range(len(C))), self.inputs or tuple(range(B.shape[1]))

    @property
    def choices(self) -> tuple[Choice, ...]:
        """Every choice of as many outputs as there are inputs, or of as many inputs as there are outputs where these are fewer."""
        _, B, C, _ = self.matrices
        size = min(len(C), B.shape[1])
        return tuple(product(combinations(range(len(C)), size), combinations(range(B.shape[1]), size)))

    def square(self, choice: Choice | None = None) -> StateSpace:
        """The square plant of a choice; by default the one to invert."""
        outputs, inputs = (list(channels) for channels in choice or self.chosen)
        A, B, C, D = self.matrices
        return StateSpace(A, B[:, inputs], C[outputs], D[np.ix_(outputs, inputs)])
