"""The usual practice that inversion is compared with: follow the wanted output by its steady state."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import InversionError
from invtrack.linear.state_space import StateSpace
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import two_sided_problem
from invtrack.references.signal import Generator, PiecewiseSignal

Array = NDArray[np.float64]

CONDITION_LIMIT = 1e14
"""Largest condition number, in the best of units, with which the equations of the steady state still count as solvable."""


def steady_state_feedforward(model: Any, reference: PiecewiseSignal) -> Plan:
    """State and input that would hold the output at y_d(t) if it stood still there: A x + B u = 0, C x + D u = y_d.

    No inverse stands behind it: it is not a trajectory of the plant (its certificate's dynamics residual says by how much), and
    with feedback around it, it is what a controller without inversion does.

    Raises InversionError where some output cannot be held (a zero at s = 0), TrajectoryError for a wrong number of channels.
    """
    problem = PlanningProblem.of(model, reference)
    trajectory = two_sided_problem(problem, problem.plant.map(_SteadyState)).solve().trajectory()
    remark = "not a trajectory of the plant: the steady state of each wanted output"
    return problem.plan("steady-state feedforward", trajectory, exact=None, remarks=(remark,))


class _SteadyState:
    """A two-sided system without states: the reference's share is all there is."""

    def __init__(self, plant: StateSpace) -> None:
        self._held = np.vstack([_steady_state(plant), np.eye(plant.n_channels)])
        none = Part.empty(len(self._held), 0)
        self.system = TwoSidedSystem(none, none, np.zeros((0, 0)))

    def driven(self, generator: Generator) -> DrivenSystem:
        """[x; u; y] that would hold the wanted output where it is."""
        nothing = np.zeros((0, len(generator.S)))
        return DrivenSystem(self.system, generator.S, nothing, nothing, self._held @ generator.R, nothing)


def _steady_state(system: StateSpace) -> Array:
    """[x; u] (n + p, p) that holds each output at one: A x + B u = 0, C x + D u = 1."""
    pencil = np.block([[system.A, system.B], [system.C, system.D]])
    n, p = system.n_states, system.n_channels
    try:
        inverse = np.linalg.solve(pencil, np.eye(n + p))
        # The spectral radius of |M^-1| |M| is the condition number that the best scaling of rows and columns reaches (Bauer 1963).
        condition = float(np.max(np.abs(np.linalg.eigvals(np.abs(inverse) @ np.abs(pencil)))))
    except np.linalg.LinAlgError:
        condition = np.inf
    if not condition < CONDITION_LIMIT:
        raise InversionError(f"the outputs {list(system.outputs.names)} cannot be held at constant values (a zero at s = 0)")
    return np.asarray(inverse[:, n:])
