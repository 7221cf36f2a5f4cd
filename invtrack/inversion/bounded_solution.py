"""The bounded solution of an inverse's equations over all of time, through the jumps, or the condition that rules it out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, as_divisor
from invtrack.errors import BoundednessError, CompatibilityError
from invtrack.inversion.input_measure import InputMeasure, held_inputs, input_measure
from invtrack.inversion.inverse_system import Inverse
from invtrack.inversion.missing_derivative import CONSISTENCY_TOLERANCE, missing_derivative
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.quadrature import quadrature_nodes
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided_problem import TwoSidedProblem, TwoSidedSolution, two_sided_problem
from invtrack.references.signal import PiecewiseSignal


@dataclass(frozen=True, eq=False)
class BoundedSolution:
    """The trajectory, the equations that it solves, and what a user should know about it."""

    trajectory: Trajectory
    equations: TwoSidedSolution
    remarks: tuple[str, ...] = ()


def bounded_solution(problem: PlanningProblem, inverses: Sequence[Inverse], measure: InputMeasure | None = None) -> BoundedSolution:
    """Stable part forward in time, antistable part backward, the state continuous at the jumps.

    Args:
        problem: plant and reference.
        inverses: of each interval.
        measure: how dear inputs are, where the conditions leave a choice; see `input_measure` for the default.

    Raises CompatibilityError and BoundednessError where the conditions cannot all be met.
    """
    equations = inverse_problem(problem, inverses).solve()
    require_consistent(problem, inverses, equations)
    freedom = equations.boundary.freedom
    if not freedom:
        return BoundedSolution(equations.trajectory(), equations)
    measure = measure or input_measure(problem.plant, None)
    least = least_input(problem, equations, measure)
    remark = (
        f"the bounded inverse is not unique ({freedom} free direction(s)); the one of least input, {measure.wording}, was taken"
    )
    return BoundedSolution(least.trajectory(), least, (remark,))


def inverse_problem(problem: PlanningProblem, inverses: Sequence[Inverse]) -> TwoSidedProblem:
    """The two-sided problem of the inverse: that of each interval, driven by each generator of the reference that occurs in it."""
    peaks = [_prescribed_peak(problem.deviation, inverse) for inverse in inverses[1:]]
    return two_sided_problem(problem, inverses, shifts=problem.plant.shifts, peaks=peaks)


def _prescribed_peak(reference: PiecewiseSignal, inverse: Inverse) -> Array:
    """Largest size over the whole reference of each output and derivative that the inverse prescribes (rho,)."""
    return inverse.internal.form.zeta.size(reference.size)[: inverse.system.prescribed]


def least_input(problem: PlanningProblem, equations: TwoSidedSolution, measure: InputMeasure) -> TwoSidedSolution:
    """Of the solutions that the equations leave open, the one with the least integral of (u - u_rest)'R (u - u_rest).

    u_rest is the least input that would hold the wanted output where it is.
    """
    plant, reference, freedom = problem.plant, problem.deviation, equations.boundary.freedom
    found = equations.trajectory()
    times, piece, shares = quadrature_nodes(found)
    inputs = slice(plant.n_states, plant.n_states + plant.n_inputs)
    held = np.array(plant.map(lambda system: held_inputs(system, measure.R)))[problem.owner[piece]]
    wanted = np.einsum("kij,kj->ki", held, reference(times, inside=reference.inner_times()[piece]))
    root = np.sqrt(shares)[:, None]
    u = found(times, piece)[:, inputs]
    others = [equations.along(weights).trajectory()(times, piece)[:, inputs] - u for weights in np.eye(freedom)]
    columns = np.array([(root * measure.size(other)).ravel() for other in others]).T
    size = as_divisor(np.linalg.norm(columns, axis=0))
    weights = np.linalg.lstsq(columns / size, -(root * measure.size(u - wanted)).ravel(), rcond=None)[0] / size
    return equations.along(weights)


def require_consistent(problem: PlanningProblem, inverses: Sequence[Inverse], equations: TwoSidedSolution) -> None:
    """Raises CompatibilityError or BoundednessError where conditions are left that the solution cannot meet."""
    plant, solution = problem.plant, equations.boundary
    for k, (_, size) in enumerate(equations.open_checks):
        if size > CONSISTENCY_TOLERANCE:
            raise CompatibilityError(missing_derivative(problem, inverses[k + 1].internal.form, equations.trajectory(), k, size))
    scale = max(equations.size, np.finfo(float).tiny)
    for k, miss in enumerate(solution.inconsistency[:-1]):
        if miss <= CONSISTENCY_TOLERANCE * scale:
            continue
        incompatible = equations.compatibility_miss(k)
        if incompatible > CONSISTENCY_TOLERANCE * scale:
            raise CompatibilityError(
                f"at the jump at t = {plant.switch_times[k]:.6g} s the state cannot be continuous and the output exact at "
                f"once: the compatibility conditions fail by {incompatible / scale:.1e} of the trajectory's size; change the "
                "reference around the jump, or keep C* (outputs and derivatives as functions of the state) the same on both sides"
            )
        raise BoundednessError(
            "no bounded inverse: the internal state that the past and the outputs wanted there leave at the jump at "
            f"t = {plant.switch_times[k]:.6g} s is off the one that stays bounded over the next interval by "
            f"{miss / scale:.1e} of the trajectory's size; change the reference, the parameters after the jump, or the output"
        )
    if solution.inconsistency[-1] > CONSISTENCY_TOLERANCE * scale:
        n_u = [stretch.system.backward.size for stretch in (equations.stretches[0], equations.stretches[-1])]
        n_u[1] += len(equations.stretches[-1].system.neutral) if n_u[0] > n_u[1] else 0
        raise BoundednessError(
            f"no bounded inverse: {n_u[0]} antistable zero(s) before the manoeuvre give {n_u[0]} unknown(s) for the {n_u[1]} "
            "condition(s) that keep the internal state bounded after it (and at rest in zeros on the axis), and these fail by "
            f"{solution.inconsistency[-1] / scale:.1e} of the trajectory's size; change the reference, the last interval's "
            "parameters, or the output"
        )
