"""Whether a reference can be followed exactly with bounded input through all jumps, condition by condition."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.errors import (
    BoundednessError,
    CompatibilityError,
    InversionError,
    InvtrackError,
    NonHyperbolicError,
    RelativeDegreeError,
    TrajectoryError,
)
from invtrack.inversion.assembly import Assembly, assemble
from invtrack.inversion.boundary_value import BoundaryValueSolution, solve
from invtrack.inversion.decay_stops import decay_stops
from invtrack.inversion.feasibility_report import BoundaryConditions, FeasibilityReport, IntervalReport, JumpReport
from invtrack.inversion.stable import _require_consistent, _require_smooth, _shared_orders
from invtrack.lti.hidden_modes import state_scale
from invtrack.lti.state_space import StateSpace
from invtrack.lti.switched import SwitchedSystem, as_switched
from invtrack.lti.zero_dynamics import SplitDynamics, split_dynamics
from invtrack.lti.zero_report import ZeroReport, zero_report
from invtrack.signals.piecewise import PiecewiseSignal
from invtrack.signals.profiles import constant

Array = NDArray[np.float64]

CONDITIONS: dict[type[InvtrackError], str] = {
    TrajectoryError: "smoothness of the reference",
    RelativeDegreeError: "vector relative degree in every interval",
    NonHyperbolicError: "no zeros on the imaginary axis",
    CompatibilityError: "compatibility at the jumps",
    BoundednessError: "boundedness before and after the manoeuvre",
    InversionError: "a bounded response to the reference's endless modes",
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
    first = plant.systems[0]
    if reference.n_channels != first.n_channels:
        names = list(first.output_names)
        raise TrajectoryError(f"the reference has {reference.n_channels} channels, the plant {len(names)} outputs {names}")
    edges = [-np.inf, *plant.switch_times.tolist(), np.inf]
    known = {id(system): _examine(system) for system in plant.systems}
    examined = [known[id(system)] for system in plant.systems]
    intervals = tuple(
        IntervalReport(start, end, zeros, "" if error is None else str(error))
        for start, end, (zeros, _, error) in zip(edges[:-1], edges[1:], examined, strict=True)
    )
    errors: list[InvtrackError] = [error for _, _, error in examined if error is not None]
    splits = [split for _, split, _ in examined if split is not None]
    problem: tuple[Assembly, BoundaryValueSolution] | None = None
    if not errors:
        problem, errors = _boundary_value_problem(plant, splits, reference)
    jumps = tuple(_jump(plant, k, examined[k][1], examined[k + 1][1], problem) for k in range(len(plant) - 1))
    failed = errors[0] if errors else None
    return FeasibilityReport(
        solvable=failed is None,
        failed="" if failed is None else CONDITIONS.get(type(failed), "the inverse"),
        message="" if failed is None else str(failed),
        intervals=intervals,
        jumps=jumps,
        boundary=None if problem is None else _boundary_conditions(splits, jumps, *problem),
    )


def _examine(system: StateSpace) -> tuple[ZeroReport | None, SplitDynamics | None, InvtrackError | None]:
    zeros = None
    try:
        zeros = zero_report(system)
        return zeros, split_dynamics(system), None
    except (RelativeDegreeError, NonHyperbolicError) as error:
        return zeros, None, error


def _boundary_value_problem(
    plant: SwitchedSystem, splits: list[SplitDynamics], reference: PiecewiseSignal
) -> tuple[tuple[Assembly, BoundaryValueSolution] | None, list[InvtrackError]]:
    """The problem that `invert` solves, as far as it can be set up, and what speaks against it, first things first."""
    errors: list[InvtrackError] = []
    y_0 = plant.systems[0].operating_point.y0
    deviation = reference + constant(-y_0, at=reference.support[0]) if np.any(y_0) else reference
    try:
        _require_smooth(plant, splits, reference)
    except TrajectoryError as error:
        errors.append(error)
    try:
        assembly = assemble(plant, splits, deviation.refined([*plant.switch_times, *decay_stops(deviation)]))
    except InversionError as error:
        return None, [*errors, error]
    solution = solve(assembly.first, assembly.junctions, assembly.last)
    try:
        _require_consistent(plant, splits, assembly, solution)
    except InversionError as error:
        errors.append(error)
    return (assembly, solution), errors


def _jump(
    plant: SwitchedSystem,
    k: int,
    left: SplitDynamics | None,
    right: SplitDynamics | None,
    problem: tuple[Assembly, BoundaryValueSolution] | None,
) -> JumpReport:
    same: bool | None = None
    angles: tuple[float | None, float | None, float | None] = (None, None, None)
    if left is not None and right is not None:
        forms = [left.internal.form, right.internal.form]
        degrees = [list(form.relative_degree) for form in forms]
        same = degrees[0] == degrees[1] == _shared_orders(left, right)
        scale = state_scale(list(plant.systems[k : k + 2]), forms)[:, None]  # angles must not depend on units
        V_l, V_r = forms[0].V / scale, forms[1].V / scale
        angles = _angle(V_l, V_r), _angle(V_l @ left.W_s, V_r @ right.W_s), _angle(V_l @ left.W_u, V_r @ right.W_u)
    rows, fixed_miss, miss = None, None, None
    if problem is not None and right is not None:
        assembly, solution = problem
        rows = len(assembly.junctions[k].rhs) - len(right.internal.A_eta)
        fixed_miss = float(assembly.open_checks[k][1])
        miss = float(solution.inconsistency[k] / max(assembly.size, np.finfo(float).tiny))
    return JumpReport(float(plant.switch_times[k]), same, *angles, rows, fixed_miss, miss)


def _angle(left: Array, right: Array) -> float:
    """Largest principal angle [rad] between two column spaces, NaN where their dimensions differ."""
    if left.shape != right.shape:
        return float("nan")
    return float(np.max(scipy.linalg.subspace_angles(left, right))) if left.shape[1] else 0.0


def _boundary_conditions(
    splits: list[SplitDynamics], jumps: tuple[JumpReport, ...], assembly: Assembly, solution: BoundaryValueSolution
) -> BoundaryConditions:
    return BoundaryConditions(
        unknowns=len(splits[0].A_u),
        end_conditions=len(splits[-1].A_u),
        compatibility_rows=sum(jump.compatibility_rows or 0 for jump in jumps),
        stable_after=len(splits[-1].A_s),
        freedom=solution.freedom,
        conditioning=solution.conditioning,
        final_miss=float(solution.inconsistency[-1] / max(assembly.size, np.finfo(float).tiny)),
    )
