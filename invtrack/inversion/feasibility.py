"""Whether a reference can be followed exactly with bounded input through all jumps, condition by condition."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg

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
from invtrack.inversion.axis_zeros import split_interval
from invtrack.inversion.exact import inverse_problem, invert
from invtrack.inversion.feasibility_report import BoundaryConditions, FeasibilityReport, IntervalReport, JumpReport
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.linear.zeros import ZeroReport, zero_report
from invtrack.plans.problem import PlanningProblem, require_reference
from invtrack.plans.two_sided_problem import SAME_ROW_TOLERANCE, TwoSidedSolution
from invtrack.references.signal import PiecewiseSignal

CONDITIONS: dict[type[InvtrackError], str] = {
    TrajectoryError: "smoothness of the reference",
    RelativeDegreeError: "an inverse in every interval",
    NonHyperbolicError: "rest in the zeros on the imaginary axis before and after the manoeuvre",
    CompatibilityError: "compatibility at the jumps",
    BoundednessError: "boundedness before and after the manoeuvre",
}


def feasibility(model: Any, reference: PiecewiseSignal) -> FeasibilityReport:
    """Whether `invert` can follow `reference` with `model`, and what Lemmas 1 to 4 say about it; `print` shows it as text.

    Per interval: relative degree and zeros. Per jump: whether C* and the subspaces of the internal dynamics are the same on both
    sides, and the compatibility conditions C*_k x(t_k) = Y_d,k(t_k). Over all: the linear equations of Lemma 1, whether they are
    independent (Lemma 4) and whether they hold. Ranks come from the ordered elimination that also solves the equations.

    model, reference: as for `invert`. Raises ModelError and TrajectoryError for malformed input (wrong number of channels) only;
    what makes the problem unsolvable is reported. Source: Devasia, Paden, Rossi 1996, section 2.
    """
    plant = as_switched(model)
    require_reference(plant, reference)
    edges = [-np.inf, *plant.switch_times.tolist(), np.inf]
    examined = plant.map(lambda system: _examine(system, endless=plant.is_endless(system)))
    intervals = tuple(
        IntervalReport(start, end, zeros, "" if error is None else str(error))
        for start, end, (zeros, _, error) in zip(edges[:-1], edges[1:], examined, strict=True)
    )
    splits = [split for _, split, _ in examined if split is not None]
    equations = _equations(plant, splits, reference) if len(splits) == len(plant) else None
    jumps = tuple(_jump(plant, k, examined[k][1], examined[k + 1][1], equations) for k in range(len(plant) - 1))
    error = _verdict(plant, reference)
    return FeasibilityReport(
        solvable=error is None,
        failed="" if error is None else _condition(error, equations is not None),
        message="" if error is None else str(error),
        intervals=intervals,
        jumps=jumps,
        boundary=None if equations is None else _boundary_conditions(splits, jumps, equations),
    )


def _condition(error: InvtrackError, has_equations: bool) -> str:
    for kind, condition in CONDITIONS.items():
        if isinstance(error, kind):
            return condition
    return "accuracy of the inverse" if has_equations else "a bounded response to the reference's endless modes"


def _examine(system: StateSpace, *, endless: bool) -> tuple[ZeroReport | None, SplitDynamics | None, InvtrackError | None]:
    zeros = None
    try:
        zeros = zero_report(system)
        return zeros, split_interval(system, endless=endless), None
    except RelativeDegreeError as error:
        return zeros, None, error


def _verdict(plant: SwitchedSystem, reference: PiecewiseSignal) -> InvtrackError | None:
    """What `invert` says: by definition the report agrees with it."""
    try:
        invert(plant, reference)
    except (TrajectoryError, RelativeDegreeError, InversionError) as error:
        return error
    return None


def _equations(plant: SwitchedSystem, splits: list[SplitDynamics], reference: PiecewiseSignal) -> TwoSidedSolution | None:
    """The equations behind `invert`, also where they have no solution or the reference is not smooth; None if they do not exist."""
    try:
        return inverse_problem(PlanningProblem.of(plant, reference), splits).solve()
    except InversionError:
        return None


def _jump(
    plant: SwitchedSystem,
    k: int,
    left: SplitDynamics | None,
    right: SplitDynamics | None,
    equations: TwoSidedSolution | None,
) -> JumpReport:
    same: bool | None = None
    angles: tuple[float | None, float | None, float | None] = (None, None, None)
    if left is not None and right is not None:
        forms = [left.internal.form, right.internal.form]
        same = _same_outputs(*forms)
        # Angles must not depend on units.
        scale = np.exp2(np.mean([np.log2(form.units) for form in forms], axis=0))[:, None]
        V_l, V_r = forms[0].V / scale, forms[1].V / scale
        angles = _angle(V_l, V_r), _angle(V_l @ left.W_s, V_r @ right.W_s), _angle(V_l @ left.W_u, V_r @ right.W_u)
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


def _boundary_conditions(
    splits: list[SplitDynamics], jumps: tuple[JumpReport, ...], equations: TwoSidedSolution
) -> BoundaryConditions:
    solution = equations.boundary
    return BoundaryConditions(
        unknowns=len(splits[0].A_u),
        end_conditions=len(splits[-1].A_u),
        compatibility_rows=sum(jump.compatibility_rows or 0 for jump in jumps),
        stable_after=len(splits[-1].A_s),
        freedom=solution.freedom,
        conditioning=solution.conditioning,
        final_miss=float(solution.inconsistency[-1] / max(equations.size, np.finfo(float).tiny)),
    )
