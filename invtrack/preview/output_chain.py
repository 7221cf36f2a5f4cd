"""The outputs as chains of integrators: y, y', ..., y^(r-1), driven by y^(r), which is all that the future can bring anew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers, shown
from invtrack.errors import PlanError, RelativeDegreeError, TrajectoryError
from invtrack.linear.normal_form import normal_form
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal


@dataclass(frozen=True, eq=False)
class OutputChain:
    """zeta' = shift zeta + entry chi, zeta = (y_i, y_i', ..., y_i^(r_i - 1)) of each output (q,), chi = (y_i^(r_i)) (p,).

    orders: r_i >= 1 of each output (p,).
    """

    orders: tuple[int, ...]

    @classmethod
    def of(cls, plant: SwitchedSystem) -> OutputChain:
        """Orders up to which the exact inverse needs the outputs' derivatives, in any interval; 1 where there is no inverse."""
        try:
            found = [normal_form(system).derivatives for system in plant.distinct]
        except RelativeDegreeError:
            found = []
        return cls(tuple(np.max([[1] * plant.n_outputs, *found], axis=0).tolist()))

    @property
    def size(self) -> int:
        """Length q of zeta."""
        return sum(self.orders)

    @cached_property
    def values(self) -> list[int]:
        """Where in zeta the outputs themselves stand (p,)."""
        return [0, *np.cumsum(self.orders)[:-1].tolist()]

    @cached_property
    def entry(self) -> Array:
        """Where chi enters (q, p)."""
        ends = np.cumsum(self.orders) - 1
        return np.asarray(np.eye(self.size)[:, ends])

    @cached_property
    def shift(self) -> Array:
        """Shifts along each chain (q, q)."""
        return np.asarray(scipy.linalg.block_diag(*(np.eye(order, k=1) for order in self.orders)))

    @cached_property
    def generator(self) -> Generator:
        """Outputs y = R w with w = [zeta; chi] and chi constant."""
        p = len(self.orders)
        S = np.block([[self.shift, self.entry], [np.zeros((p, self.size + p))]])
        return Generator(S, np.eye(self.size + p)[self.values])

    def zeta(self, generator: Generator) -> Array:
        """Rows that give zeta of a generator's state (q, k)."""
        return np.vstack([generator.derivative(k)[i] for i, order in enumerate(self.orders) for k in range(order)])

    def chi(self, generator: Generator) -> Array:
        """Rows that give chi of a generator's state (p, k)."""
        return np.vstack([generator.derivative(order)[i] for i, order in enumerate(self.orders)])

    def at_rest(self, y: Array) -> Array:
        """zeta (q,) of outputs held at y (p,)."""
        result = np.zeros(self.size)
        result[self.values] = y
        return result

    def require_smooth(self, reference: PiecewiseSignal, names: Sequence[str]) -> None:
        """Raises TrajectoryError unless y_i, ..., y_i^(r_i - 1) are continuous, so that chi is a function."""
        for i, order in enumerate(self.orders):
            found = reference.smoothness(i, order)
            if found < order:
                raise TrajectoryError(
                    f"the reference of {names[i]!r} must have continuous derivatives up to order {order - 1}, so that what is new "
                    f"of it is its derivative of order {order}; its derivative of order {found} jumps. Smooth it, for instance "
                    "with invtrack.rest_to_rest or invtrack.sampled_reference"
                )


def held_outputs(name: str, value: ArrayLike, plant: SwitchedSystem) -> Array:
    """One value for each output (p,), or a number for a single one; raises PlanError for anything else."""
    values = np.atleast_1d(real_numbers(name, value, error=PlanError))
    if values.shape != (plant.n_outputs,) or not np.all(np.isfinite(values)):
        raise PlanError(f"{name} must be one finite value for each of the outputs {list(plant.outputs.names)}, got {shown(value)}")
    return values
