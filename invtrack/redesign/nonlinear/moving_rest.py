"""What departures cost from: the state and the input that would hold each wanted output where it is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.nonlinear.postures import POSTURES, steady_plan
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.plans.plan import Plan

ALL_POSTURES = 512
"""Postures along a motion of many pieces, in all, but FEWEST on each of its pieces."""

FEWEST = 4


@dataclass(frozen=True, eq=False)
class MovingRest:
    """x_rest(t) and u_rest(t): an equilibrium with y = y_d(t), with the parameters in force. Where holding takes no other input
    than that of the operating point, u_rest is that."""

    steady: Plan

    @classmethod
    def of(cls, problem: MotionProblem) -> MovingRest:
        """That of a problem. Raises PlanError where a wanted output has no equilibrium on the way."""
        pieces = max(1, len(problem.stops) - 1)
        return cls(steady_plan(problem, int(np.clip(ALL_POSTURES // pieces, FEWEST, POSTURES))))

    def states(self, times: Array, inside: Array) -> Array:
        """x_rest (k, n), as deviation from the operating point."""
        return self.steady.states(times, inside=inside)

    def inputs(self, times: Array, inside: Array) -> Array:
        """u_rest (k, m), absolute."""
        return self.steady.inputs(times, inside=inside)
