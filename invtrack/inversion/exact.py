"""Exact output tracking with bounded input and state: stable inversion, through parameter jumps at known times."""

from __future__ import annotations

from typing import Any

from invtrack.inversion.bounded_solution import bounded_solution, require_smooth
from invtrack.inversion.inverse_system import split_each
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.references.signal import PiecewiseSignal


def invert(
    model: Any,
    reference: PiecewiseSignal,
    *,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
) -> Plan:
    """The bounded input and state with which the output of `model` follows `reference` exactly.

    x' = A_k x + B_k u, C_k x = y_d on all of time, x continuous through the jumps. Internal dynamics: stable part forward from
    rest, antistable part backward from rest, so the input acts before the manoeuvre (preactuation) and rings down after it.

    model: StateSpace, SwitchedSystem, or anything with A, B, C, D. reference: absolute, in the units of the outputs. tolerance:
    what counts as rest at the two ends, as a share of each state's and input's peak; it sets how early the plan starts.
    max_preactuation [s] limits that, at the price of a start that is not quite at rest, which `remarks` states.

    Raises TrajectoryError (reference not smooth enough, wrong number of channels), PlanError (options out of range; too
    ill-conditioned), RelativeDegreeError, NonHyperbolicError (zeros on the imaginary axis in the first or last interval),
    CompatibilityError (a jump at which no continuous state keeps the output exact), BoundednessError (no bounded solution).
    Sources: Devasia, Chen, Paden 1996; Devasia, Paden, Rossi 1996, Lemma 1.
    """
    problem = PlanningProblem.of(model, reference, tolerance=tolerance, max_preactuation=max_preactuation)
    splits = split_each(problem.plant)
    require_smooth(problem.plant, splits, problem.deviation)
    solution = bounded_solution(problem, splits)
    return problem.plan("stable inversion", solution.trajectory, exact=True, remarks=solution.remarks)
