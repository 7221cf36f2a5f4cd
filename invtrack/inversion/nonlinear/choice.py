"""Which points and which lengths of elements suit a mechanism: by what an element at rest does to errors."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from invtrack.arrays import Indices
from invtrack.errors import BoundednessError, InvtrackError, NonHyperbolicError, RelativeDegreeError
from invtrack.inversion.nonlinear.elements import Scheme, candidate_schemes
from invtrack.inversion.nonlinear.ends import NEUTRAL, End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.refinement import MOST_PARTS
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.plans.runge_kutta import CLASSICAL, EIGHTH_ORDER

LEAST_GAP = 0.3
"""Least |log |lambda|| of the multipliers that stand for no zero with which a scheme is taken."""

AMPLE_GAP = 1.0
"""A gap with which errors of the mesh are forgotten within a few elements."""

REFINED = 2
"""Steps of eighth order between neighbouring half distances of the points at first: polynomials between them are as exact then."""

LENGTHS = (1.0, 0.5, 0.25, 2.0, 0.125)
"""Multiples of the wanted length of elements that are tried."""


@dataclass(frozen=True, eq=False)
class Choice:
    """A scheme and the length of its elements [s].

    Args:
        problem: for which they were chosen.
        scheme, length: the choice.
        expanding: how many multipliers of an element at rest lie outside the unit circle, the same at all its equilibria.
        gap: smallest |log |lambda|| of those that stand for no zero.
    """

    problem: MotionProblem
    scheme: Scheme
    length: float
    expanding: int
    gap: float
    _known: dict[tuple[int, float], float] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, problem: MotionProblem, scheme: Scheme, length: float) -> Choice | None:
        """This scheme at this length [s]; None where the inputs do not act on the outputs, or not alike at all equilibria."""
        owners = zip(problem.dynamics_of_rests, problem.rests, problem.zeros, strict=True)
        try:
            ends = [End.of(dynamics, rest, scheme, length, zeros) for dynamics, rest, zeros in owners]
        except np.linalg.LinAlgError:
            return None
        if len({end.expanding for end in ends}) > 1:
            return None
        return cls(problem, scheme, length, ends[0].expanding, min(end.gap for end in ends))

    def gap_at(self, length: float) -> float:
        """The gap of elements of another length [s]; none, -inf, where these cannot stand beside them."""
        key = (self.scheme.refinement, float(f"{length:.9g}"))
        if key not in self._known:
            other = Choice.of(self.problem, self.scheme, length)
            self._known[key] = other.gap if other is not None and other.expanding == self.expanding else -np.inf
        return self._known[key]

    def suits(self, length: float) -> bool:
        """Whether elements of another length [s] can stand beside these."""
        return self.gap_at(length) >= LEAST_GAP

    def suits_as_well(self, length: float) -> bool:
        """Whether they forget errors of the mesh as fast as these, or fast enough for errors to stay where they are made."""
        return self.gap_at(length) >= min(self.gap, AMPLE_GAP)

    def allowed(self, parts: Indices, mesh: Mesh) -> Indices:
        """Into how many parts (N,) elements may be split of which `parts` (N,) are wanted, or more; 1 where into none."""
        result = parts.copy()
        for k in np.flatnonzero(parts > 1):
            numbers = range(int(parts[k]), MOST_PARTS + 1)
            result[k] = next((number for number in numbers if self.suits(float(mesh.lengths[k]) / number)), 1)
        return result

    def with_steps(self, factor: int) -> Choice:
        """The same with an integration on each element that is as exact as with so many times as many steps, or more so.

        A method of higher order comes before more steps, but where inputs are held for a plant that is itself driven in steps.
        """
        scheme = self.scheme
        if factor > 1 and scheme.count > 1 and scheme.method is CLASSICAL:
            return replace(self, scheme=replace(scheme, method=EIGHTH_ORDER, refinement=REFINED))
        return replace(self, scheme=replace(scheme, refinement=factor * scheme.refinement))


def choose(problem: MotionProblem, count: int, length: float, *, fixed: bool) -> Choice:
    """The scheme with the largest gap.

    Args:
        problem: mechanism, reference, changes.
        count: coefficients of each input on an element.
        length: of the elements [s].
        fixed: whether other lengths are out of the question.

    Raises RelativeDegreeError, NonHyperbolicError, BoundednessError where none will do.
    """
    best: Choice | None = None
    for factor in (1.0,) if fixed else LENGTHS:
        for scheme in candidate_schemes(count, len(problem.mechanism.outputs)):
            found = Choice.of(problem, scheme, factor * length)
            if found is not None and (best is None or found.gap > best.gap):
                best = found
        if best is not None and best.gap >= LEAST_GAP:
            return best
    raise _nothing_suits(problem, best, length)


def _nothing_suits(problem: MotionProblem, best: Choice | None, length: float) -> InvtrackError:
    inputs, outputs = list(problem.mechanism.inputs.names), list(problem.mechanism.outputs.names)
    if best is None:
        return RelativeDegreeError(
            f"no inverse on elements of {length:.3g} s: within one the inputs {inputs} hardly act on the outputs {outputs}, or not "
            "alike at all equilibria of the motion; track outputs nearer to the actuators"
        )
    zeros = np.concatenate(problem.zeros)
    on_axis = np.abs(zeros.real) * length < NEUTRAL
    kind = NonHyperbolicError if np.any(on_axis) else BoundednessError
    return kind(
        f"no inverse on elements of {length:.3g} s that forgets its errors: multipliers of an element at rest come within "
        f"|log |lambda|| = {best.gap:.2g} of the unit circle, {LEAST_GAP} is the least; the zeros are {format_zeros(zeros)}. Zeros "
        "on the imaginary axis, or about as fast as the elements, do that: track another output, or plan with another hold"
    )
