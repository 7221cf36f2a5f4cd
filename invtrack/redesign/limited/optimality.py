"""Whether a limited plan is the best one: the optimality conditions of its programme, from primal and dual values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.redesign.limited.quadratic_program import Minimum, QuadraticProgram, SolverGaveUpError

LARGEST_GAP = 1e-6
"""Largest duality gap of a plan that is handed out, as a share of its cost."""

LARGEST_RESIDUAL = 1e-7
"""Largest residual of the stationarity condition, as a share of its terms."""


@dataclass(frozen=True)
class Optimality:
    """How far from the optimum of its programme a plan can be, measured from its values and multipliers, not from how it was found.

    With L(z, y, l) = z'P z / 2 + q'z + y'(E z - e) + l'(G z - h), multipliers l >= 0, the programme's dual has the value of L where
    dL/dz = 0; no plan within the limits costs less than that.

    Args:
        cost: of the plan, over all of time.
        duality_gap: cost minus the dual's value, as a share of the cost: what the best plan within the limits could save at most.
        stationarity: largest |dL/dz_i|, as a share of the largest sum of the sizes of the terms of one.
    """

    cost: float
    duality_gap: float
    stationarity: float

    def require(self) -> None:
        """Raises SolverGaveUpError for a plan of which it is not certain that it is the best one."""
        if not (self.duality_gap <= LARGEST_GAP and self.stationarity <= LARGEST_RESIDUAL):
            raise SolverGaveUpError(
                f"the limited redesign found a plan that may not be the best one: its duality gap is {self.duality_gap:.1e} of its "
                f"cost (at most {LARGEST_GAP:.0e} is accepted), it misses stationarity by {self.stationarity:.1e} (at most "
                f"{LARGEST_RESIDUAL:.0e}); take a larger step, or bring weights and limits closer to each other"
            )


def measured_optimality(program: QuadraticProgram, z: Array, minimum: Minimum, constant: float) -> Optimality:
    """The conditions for z (m,), which keeps to the constraints of `program`, to whose cost `constant` is to be added.

    `minimum` gives the multipliers y and l, and the point w at which dL/dz is to vanish. The gap is summed from its parts,
    (z - w)'P (z - w) / 2 + z'dL/dz(w) + l'(h - G z) + y'(e - E z) in size, so that no cost cancels in it.
    """
    w, y, multipliers = minimum.z, minimum.of_equations, minimum.of_limits
    slope = program.P @ w
    gradient = slope + program.q + program.E.T @ y + program.G.T @ multipliers
    terms = np.abs(slope) + np.abs(program.q) + abs(program.E.T) @ np.abs(y) + abs(program.G.T) @ multipliers
    parts = (
        (z - w) @ (program.P @ (z - w)) / 2,
        z @ gradient,
        multipliers @ (program.h - program.G @ z),
        y @ (program.e - program.E @ z),
    )
    cost = float(z @ (program.P @ z) / 2 + program.q @ z) + constant
    gap = float(np.sum(np.abs(parts)))
    size = float(np.max(terms))
    return Optimality(
        cost=cost,
        duality_gap=gap / cost if cost > 0 else np.inf,
        stationarity=float(np.max(np.abs(gradient))) / size if size > 0 else 0.0,
    )
