"""What the freedom in a modified inverse is chosen for, and one choice of it with its solution."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from invtrack.inversion.bounded_solution.refusals import ACCURACY
from invtrack.inversion.bounded_solution.solution import BoundedSolution, bounded_solution
from invtrack.inversion.modification.dynamics import ModifiedDynamics
from invtrack.inversion.modification.error_samples import ErrorSamples, error_samples
from invtrack.inversion.modification.placement import MovablePart
from invtrack.inversion.modification.trajectory import Candidate
from invtrack.lti.switched import SwitchedSystem
from invtrack.lti.zero_dynamics import InternalDynamics
from invtrack.signals.certificate import certify
from invtrack.signals.piecewise import PiecewiseSignal

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """What the freedom is chosen for; parts: what is placed in each interval, unmoved: the zeros that stay there.

    deviation: the reference as deviation from the operating point; output_scale (p,): errors are measured in it.
    """

    plant: SwitchedSystem
    internals: Sequence[InternalDynamics]
    parts: Sequence[MovablePart]
    unmoved: Sequence[ComplexArray]
    deviation: PiecewiseSignal
    output_scale: Array

    @cached_property
    def samples(self) -> ErrorSamples:
        """Where the error is weighed."""
        poles = np.concatenate([part.poles for part in self.parts])
        return error_samples(self.deviation.breakpoints, poles if len(poles) else np.array([1.0 + 0j]))

    @cached_property
    def active(self) -> NDArray[np.bool_]:
        """Which outputs are to move at all (p,)."""
        return self.deviation.size(1) * (self.deviation.support[1] - self.deviation.support[0]) > 1e-6 * self.output_scale

    def solve(self, dynamics: Sequence[ModifiedDynamics], L: Sequence[Array]) -> BoundedSolution:
        """The bounded solution for one choice of F and L in each interval."""
        built = [d.with_feedforward(entry) for d, entry in zip(dynamics, L, strict=True)]
        return bounded_solution(self.plant, [b[0] for b in built], self.deviation, [b[1] for b in built])

    def is_accurate(self, solution: BoundedSolution) -> bool:
        """Whether a solution keeps the plant's equations over the manoeuvre, so that it may be handed out."""
        certificate = certify(self.plant, solution.trajectory, self.deviation, solution.support)
        return max(certificate.dynamics_residual, certificate.continuity) <= ACCURACY

    def errors(self, solution: BoundedSolution) -> Array:
        """Weighted error samples (m p,); their sum of squares is the integral of the squared error."""
        return self.samples.errors(solution.trajectory, self.deviation, self.output_scale).ravel()

    def no_feedforward(self) -> list[Array]:
        """L = 0 in each interval."""
        return [np.zeros((len(self.output_scale), len(part.degrees) + sum(part.degrees))) for part in self.parts]


@dataclass(frozen=True, eq=False)
class Solved:
    """One choice of the freedom, with its solution; candidates: what it was compared with."""

    name: str
    dynamics: list[ModifiedDynamics]
    L: list[Array]
    solution: BoundedSolution
    integral_square_error: float
    candidates: tuple[Candidate, ...] = ()
    remarks: tuple[str, ...] = ()


def without_feedforward(problem: DesignProblem, name: str, dynamics: list[ModifiedDynamics]) -> Solved:
    """The solution for these F and L = 0."""
    L = problem.no_feedforward()
    solution = problem.solve(dynamics, L)
    return Solved(name, dynamics, L, solution, float(np.sum(problem.errors(solution) ** 2)))
