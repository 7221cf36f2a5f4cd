"""Whether a reference can be followed exactly with bounded input through all jumps, condition by condition."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array
from invtrack.errors import (
    BoundednessError,
    CompatibilityError,
    InversionError,
    InvtrackError,
    NonHyperbolicError,
    RelativeDegreeError,
    TrajectoryError,
)
from invtrack.inversion.allocated import AllocatedDynamics
from invtrack.inversion.axis_zeros import split_interval
from invtrack.inversion.bounded_solution import inverse_problem
from invtrack.inversion.exact import invert
from invtrack.inversion.feasibility_report import BoundaryConditions, FeasibilityReport, IntervalReport, JumpReport
from invtrack.inversion.input_measure import InputMeasure, input_measure
from invtrack.inversion.inverse_system import Inverse, InverseSystem
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.linear.zeros import ZeroReport, zero_report
from invtrack.plans.junctions import SAME_ROW_TOLERANCE
from invtrack.plans.problem import PlanningProblem, require_reference
from invtrack.plans.two_sided_problem import TwoSidedSolution
from invtrack.references.signal import PiecewiseSignal

PARTS = ("forward", "backward")
"""Of a two-sided system: what is stable, and what is antistable."""

CONDITIONS: dict[type[InvtrackError], str] = {
    TrajectoryError: "smoothness of the reference",
    RelativeDegreeError: "an inverse in every interval",
    NonHyperbolicError: "rest in the zeros on the imaginary axis before and after the manoeuvre",
    CompatibilityError: "compatibility at the jumps",
    BoundednessError: "boundedness before and after the manoeuvre",
}


def feasibility(model: Any, reference: PiecewiseSignal, *, R: ArrayLike | None = None) -> FeasibilityReport:
    """Whether `invert` can follow `reference` with `model`, and what Lemmas 1 to 4 say about it; `print` shows it as text.

    Per interval: relative degree and zeros. Per jump: whether C* and the subspaces of the internal dynamics are the same on both
    sides, and the compatibility conditions C*_k x(t_k) = Y_d,k(t_k). Over all: the linear equations of Lemma 1, whether they are
    independent (Lemma 4) and whether they hold. Ranks come from the ordered elimination that also solves the equations. With more
    inputs than outputs the equations are those of the least input, whose unknowns are state and costate.

    model, reference, R: as for `invert`. Raises ModelError and TrajectoryError for malformed input (wrong number of channels), and
    InversionError for a malformed R, only; what makes the problem unsolvable is reported. Source: Devasia, Paden, Rossi 1996,
    section 2.
    """
    plant = as_switched(model)
    require_reference(plant, reference)
    measure = input_measure(plant, R)
    edges = [-np.inf, *plant.switch_times.tolist(), np.inf]
    examined = plant.map(lambda system: _examine(system, measure, endless=plant.is_endless(system)))
    intervals = tuple(
        IntervalReport(start, end, zeros, "" if error is None else str(error))
        for start, end, (zeros, _, error) in zip(edges[:-1], edges[1:], examined, strict=True)
    )
    inverses = [inverse for _, inverse, _ in examined if inverse is not None]
    equations = _equations(plant, inverses, reference) if len(inverses) == len(plant) else None
    jumps = tuple(_jump(plant, k, examined[k][1], examined[k + 1][1], equations) for k in range(len(plant) - 1))
    error, remarks = _verdict(plant, reference, R)
    return FeasibilityReport(
        solvable=error is None,
        failed="" if error is None else _condition(error, equations is not None),
        message="" if error is None else str(error),
        intervals=intervals,
        jumps=jumps,
        boundary=None if equations is None else _boundary_conditions(inverses, jumps, equations),
        remarks=remarks,
    )


def _condition(error: InvtrackError, has_equations: bool) -> str:
    for kind, condition in CONDITIONS.items():
        if isinstance(error, kind):
            return condition
    return "accuracy of the inverse" if has_equations else "a bounded response to the reference's endless modes"


def _examine(
    system: StateSpace, measure: InputMeasure, *, endless: bool
) -> tuple[ZeroReport | None, Inverse | None, InvtrackError | None]:
    zeros = None
    try:
        zeros = zero_report(system)
        if system.n_inputs > system.n_outputs:
            return zeros, AllocatedDynamics.of(system, measure.R).inverse(endless=endless), None
        return zeros, InverseSystem.of(system, split_interval(system, endless=endless)), None
    except (RelativeDegreeError, NonHyperbolicError) as error:
        return zeros, None, error


def _verdict(
    plant: SwitchedSystem, reference: PiecewiseSignal, R: ArrayLike | None
) -> tuple[InvtrackError | None, tuple[str, ...]]:
    """What `invert` says, its refusal or its remarks: by definition the report agrees with it."""
    try:
        return None, invert(plant, reference, R=R).remarks
    except (TrajectoryError, RelativeDegreeError, InversionError) as error:
        return error, ()


def _equations(plant: SwitchedSystem, inverses: list[Inverse], reference: PiecewiseSignal) -> TwoSidedSolution | None:
    """The equations behind `invert`, also where they have no solution or the reference is not smooth; None if they do not exist."""
    try:
        return inverse_problem(PlanningProblem.of(plant, reference), inverses).solve()
    except InversionError:
        return None


def _jump(
    plant: SwitchedSystem,
    k: int,
    left: Inverse | None,
    right: Inverse | None,
    equations: TwoSidedSolution | None,
) -> JumpReport:
    same: bool | None = None
    angles: tuple[float | None, float | None, float | None] = (None, None, None)
    if left is not None and right is not None:
        forms = [left.internal.form, right.internal.form]
        same = _same_outputs(*forms)
        # Angles must not depend on units.
        scale = np.exp2(np.mean([np.log2(form.units) for form in forms], axis=0))[:, None]
        kernels = [form.V / scale for form in forms]
        forward, backward = ([getattr(side.system, part).J[: len(scale)] / scale for side in (left, right)] for part in PARTS)
        angles = _angle(*kernels), _angle(*forward), _angle(*backward)
    rows, fixed_miss, miss = None, None, None
    if equations is not None:
        rows, fixed_miss = equations.compatibility_rows[k], equations.open_checks[k][1]
        miss = float(equations.boundary.inconsistency[k] / max(equations.size, np.finfo(float).tiny))
    return JumpReport(float(plant.switch_times[k]), same, *angles, rows, fixed_miss, miss)


def _same_outputs(left: NormalForm, right: NormalForm) -> bool:
    """Assumption 4: as many derivatives of each output in C*, and the same rows."""
    if left.orders != right.orders:
        return False
    size = np.max(np.maximum(np.abs(left.C_star), np.abs(right.C_star)), axis=1, keepdims=True, initial=0.0)
    return bool(np.all(np.abs(left.C_star - right.C_star) <= SAME_ROW_TOLERANCE * size))


def _angle(left: Array, right: Array) -> float:
    """Largest principal angle [rad] between two column spaces, NaN where their dimensions differ."""
    if left.shape != right.shape:
        return float("nan")
    return float(np.max(scipy.linalg.subspace_angles(left, right))) if left.shape[1] else 0.0


def _boundary_conditions(inverses: list[Inverse], jumps: tuple[JumpReport, ...], equations: TwoSidedSolution) -> BoundaryConditions:
    solution, first, last = equations.boundary, inverses[0].system, inverses[-1].system
    return BoundaryConditions(
        unknowns=first.backward.size,
        end_conditions=last.backward.size,
        compatibility_rows=sum(jump.compatibility_rows or 0 for jump in jumps),
        stable_after=last.forward.size,
        freedom=solution.freedom,
        conditioning=solution.conditioning,
        final_miss=float(solution.inconsistency[-1] / max(equations.size, np.finfo(float).tiny)),
    )
