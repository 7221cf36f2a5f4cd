"""The bounded solution of an inverse system, exact or modified: what every method computes once the dynamics are split."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.errors import InversionError
from invtrack.inversion.bounded_solution.assembly import Assembly, assemble
from invtrack.inversion.bounded_solution.pieces import Correction
from invtrack.inversion.bounded_solution.refusals import require_consistent
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.boundary_value import BoundaryValueSolution, solve
from invtrack.plans.ends import Departure
from invtrack.plans.plan import TwoSidedTrajectory
from invtrack.references.signal import PiecewiseSignal

AT_REST = 1e-12
"""A reference that departs from the operating point by no more than this share of its values asks for no motion."""


@dataclass(frozen=True, eq=False)
class BoundedSolution:
    """A two-sided trajectory with the equations that it solves."""

    assembly: Assembly
    boundary: BoundaryValueSolution
    trajectory: TwoSidedTrajectory

    @property
    def manoeuvre(self) -> tuple[float, float]:
        """First and last breakpoint [s]: the manoeuvre."""
        return float(self.trajectory.breakpoints[0]), float(self.trajectory.breakpoints[-1])

    @cached_property
    def departures(self) -> tuple[Departure, Departure]:
        """What dies out before and after the manoeuvre."""
        return self.assembly.departures(self.trajectory)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about the solution."""
        if not self.boundary.freedom:
            return ()
        return (f"the bounded inverse is not unique ({self.boundary.freedom} free direction(s)); the one of least norm was taken",)


def bounded_solution(
    plant: SwitchedSystem,
    splits: Sequence[SplitDynamics],
    deviation: PiecewiseSignal,
    corrections: Sequence[Correction | None] | None = None,
) -> BoundedSolution:
    """Stable part forward in time, antistable part backward, the state continuous at the jumps.

    deviation: the reference as deviation from the operating point, with breakpoints at all jumps. Raises CompatibilityError and
    BoundednessError where the conditions cannot all be met.
    """
    assembly = assemble(plant, splits, deviation, corrections)
    boundary = solve(assembly.first, assembly.junctions, assembly.last)
    require_consistent(plant, splits, assembly, boundary)
    return BoundedSolution(assembly, boundary, assembly.trajectory(boundary.values))


def require_options(tolerance: float, max_preactuation: float | None) -> None:
    """Raises InversionError for a tolerance or a limit of the preactuation out of range."""
    if not 0 < tolerance < 1 or (max_preactuation is not None and not max_preactuation >= 0):
        raise InversionError(
            f"tolerance must lie between 0 and 1 and max_preactuation must not be negative, got {tolerance} and {max_preactuation}"
        )


def asks_for_motion(deviation: PiecewiseSignal, reference: PiecewiseSignal) -> bool:
    """Whether the reference ever leaves the operating point."""
    return bool(np.any(deviation.size(0) > AT_REST * reference.size(0)))
