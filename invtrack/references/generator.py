"""The autonomous linear system behind a piece of a signal."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, real_matrix
from invtrack.errors import TrajectoryError
from invtrack.linear.propagation import Propagator


@dataclass(frozen=True, eq=False)
class Generator:
    """The autonomous system w' = S w, value = R w behind a piece of a signal: S (q, q), R (p, q), finite.

    Raises TrajectoryError for matrices of other shapes.
    """

    S: Array
    R: Array

    def __post_init__(self) -> None:
        S, R = real_matrix("S of a generator", self.S), real_matrix("R of a generator", self.R)
        q = len(S)
        if S.shape != (q, q) or R.shape[1] != q or not R.size:
            raise TrajectoryError(f"a generator needs S (q, q) and R (p, q), neither empty, got {S.shape} and {R.shape}")
        object.__setattr__(self, "S", S)
        object.__setattr__(self, "R", R)

    def derivative(self, order: int) -> Array:
        """R S^order (p, q), not to be written to: the rows that give the derivative of that order.

        Raises TrajectoryError where it is beyond the range of floating-point numbers.
        """
        rows = self._rows
        while len(rows) <= order and np.any(rows[-1]):
            with np.errstate(over="ignore", invalid="ignore"):
                row = np.asarray(rows[-1] @ self.S)
            if not np.all(np.isfinite(row)):
                raise TrajectoryError(
                    f"the derivative of order {len(rows)} of this signal is beyond the range of floating-point numbers; ask for a "
                    "lower one, or stretch the motion"
                )
            row.setflags(write=False)
            rows.append(row)
        return rows[min(order, len(rows) - 1)]  # once zero, they all are

    @cached_property
    def _rows(self) -> list[Array]:
        """R S^k, as far as known."""
        return [self.R]

    @cached_property
    def horizon(self) -> float:
        """How far [s] exp(S t) can be followed before the rounding of t alone hides in which phase it is."""
        with np.errstate(over="ignore"):
            pace = float(np.linalg.norm(self.S, 1))
        return 1 / (np.finfo(float).eps * pace) if pace > np.finfo(float).tiny / np.finfo(float).eps else np.inf

    def propagator(self, direction: float) -> Propagator:
        """exp(S tau), or exp(-S tau) for a negative direction."""
        return self._propagators[0 if direction > 0 else 1]

    @cached_property
    def _propagators(self) -> tuple[Propagator, Propagator]:
        return Propagator(self.S), Propagator(-self.S)


def constant_generator(p: int) -> Generator:
    """Generator of constant values: w' = 0, value = w."""
    return Generator(np.zeros((p, p)), np.eye(p))
