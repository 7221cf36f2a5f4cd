"""Exact output tracking with bounded input and state: stable inversion, through parameter jumps at known times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array, as_divisor
from invtrack.errors import BoundednessError, CompatibilityError, TrajectoryError
from invtrack.inversion.allocated import AllocatedDynamics, AllocatedInverse, require_same_resting_places
from invtrack.inversion.axis_zeros import require_rest_held, require_rest_left, split_through_axis
from invtrack.inversion.input_measure import InputMeasure, held_inputs, input_measure
from invtrack.inversion.missing_derivative import CONSISTENCY_TOLERANCE, missing_derivative
from invtrack.inversion.tracking_values import tracking_values
from invtrack.linear.internal_dynamics import InternalDynamics, SplitDynamics, split_dynamics
from invtrack.linear.normal_form import NormalForm
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.quadrature import quadrature_nodes
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import SAME_ROW_TOLERANCE, TwoSidedProblem, TwoSidedSolution, two_sided_problem
from invtrack.references.signal import JUMP_TOLERANCE, Generator, PiecewiseSignal


@dataclass(frozen=True, eq=False)
class Correction:
    """The term v = feedback V eta + feedforward [zeta_d; chi_d] of u = B_y^-1 (chi_d - A_x x + v), which gives up exactness.

    feedback (p, n) acts on the state's distance V eta from P zeta_d, feedforward (p, rho + p) on the wanted output's derivatives.
    """

    feedback: Array
    feedforward: Array


@dataclass(frozen=True, eq=False)
class InverseSystem:
    """x = P zeta_d + V (W_s z_s + W_u z_u), u = B_y^-1 (chi_d - A_x x + v): z_s forward, z_u backward.

    zeta_d and chi_d are what `NormalForm` makes of the wanted outputs and their derivatives. What is continuous through a jump is
    the state x (n,). Without a correction v = 0 and zeta = C* x is prescribed; a modified inverse prescribes nothing
    (Devasia 1996, eqs. 7-9 and 12; Devasia, Paden, Rossi 1996, eqs. 3-5).
    """

    plant: StateSpace
    split: SplitDynamics
    correction: Correction | None
    system: TwoSidedSystem

    @classmethod
    def of(cls, plant: StateSpace, split: SplitDynamics, correction: Correction | None = None) -> InverseSystem:
        """The inverse of `plant` with these internal dynamics, which take account of the correction."""
        form = split.internal.form
        parts = []
        for A, W in ((split.A_s, split.W_s), (split.A_u, split.W_u)):
            x = form.V @ W
            if correction is None:
                values = tracking_values(plant, x, x @ A, np.zeros((plant.n_outputs, len(A))))
            else:
                values = _values(plant, split, x, correction.feedback @ x)
            parts.append(Part(A, values, x))
        T = np.vstack([form.C_star, split.L_s @ form.N, split.L_u @ form.N])
        return cls(plant, split, correction, TwoSidedSystem(parts[0], parts[1], T, len(form.C_star), split.neutral))

    def driven(self, generator: Generator) -> DrivenSystem:
        """The inverse for outputs y_d = R w, w' = S w."""
        form = self.split.internal.form
        Z, highest = form.zeta.rows(generator.derivative), form.chi.rows(generator.derivative)
        drive, x = np.vstack([Z, highest]), form.P @ Z
        D_f, D_b = self.split.G_s @ drive, self.split.G_u @ drive
        if self.correction is None:
            forward, backward = self.system.forward.J, self.system.backward.J
            values = tracking_values(self.plant, x, forward @ D_f + backward @ D_b + x @ generator.S, generator.R)
        else:
            values = _values(self.plant, self.split, x, highest + self.correction.feedforward @ drive)
        return DrivenSystem(system=self.system, S=generator.S, D_f=D_f, D_b=D_b, X_w=values, J_w=x)


def split_each(plant: SwitchedSystem) -> tuple[SplitDynamics, ...]:
    """Split internal dynamics of each interval; models that recur share them.

    Zeros on the imaginary axis are refused in the first and the last interval, which have no end; over the others they stay
    bounded. Raises NonHyperbolicError, RelativeDegreeError.
    """
    return plant.map(lambda system: split_dynamics(system, endless=plant.is_endless(system)))


def _values(plant: StateSpace, split: SplitDynamics, x_rows: Array, y_r_rows: Array) -> Array:
    """Rows of [x; u; y] from those of x and of chi_d + v."""
    F, G, _ = split.internal.form.tracking_law()
    u_rows = F @ x_rows + G @ y_r_rows
    return np.vstack([x_rows, u_rows, plant.C @ x_rows + plant.D @ u_rows])


@dataclass(frozen=True, eq=False)
class BoundedSolution:
    """The trajectory, the equations that it solves, and what a user should know about it."""

    trajectory: Trajectory
    equations: TwoSidedSolution
    remarks: tuple[str, ...] = ()


def bounded_solution(
    problem: PlanningProblem,
    splits: Sequence[SplitDynamics],
    corrections: Sequence[Correction] | None = None,
    measure: InputMeasure | None = None,
) -> BoundedSolution:
    """Stable part forward in time, antistable part backward, the state continuous at the jumps.

    Args:
        problem: plant and reference.
        splits: internal dynamics of each interval, split.
        corrections: what each interval's law adds to the exact one (nothing, by default).
        measure: how dear inputs are, where the conditions leave a choice.

    Raises CompatibilityError and BoundednessError where the conditions cannot all be met.
    """
    return _bounded(problem, inverse_problem(problem, splits, corrections), [split.internal for split in splits], measure)


def _bounded(
    problem: PlanningProblem, task: TwoSidedProblem, internals: Sequence[InternalDynamics], measure: InputMeasure | None = None
) -> BoundedSolution:
    equations = task.solve()
    require_consistent(problem, internals, equations)
    freedom = equations.boundary.freedom
    if not freedom:
        return BoundedSolution(equations.trajectory(), equations)
    measure = measure or input_measure(problem.plant, None)
    least = least_input(problem, equations, measure)
    remark = (
        f"the bounded inverse is not unique ({freedom} free direction(s)); the one of least input, {measure.wording}, was taken"
    )
    return BoundedSolution(least.trajectory(), least, (remark,))


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


def inverse_problem(
    problem: PlanningProblem, splits: Sequence[SplitDynamics], corrections: Sequence[Correction] | None = None
) -> TwoSidedProblem:
    """The two-sided problem of the inverse: that of each interval, driven by each generator of the reference that occurs in it."""
    inverses: dict[int, InverseSystem] = {}
    for k, split in enumerate(splits):
        if id(split) not in inverses:
            inverses[id(split)] = InverseSystem.of(problem.plant.systems[k], split, None if corrections is None else corrections[k])
    models = [inverses[id(split)] for split in splits]
    peaks = [
        _prescribed_peak(problem.deviation, split.internal, model.system)
        for split, model in zip(splits[1:], models[1:], strict=True)
    ]
    return two_sided_problem(problem, models, peaks=peaks)


def allocated_problem(problem: PlanningProblem, inverses: Sequence[AllocatedInverse]) -> TwoSidedProblem:
    """The same for more inputs than outputs, with the inputs of least cost."""
    peaks = [_prescribed_peak(problem.deviation, model.internal, model.system) for model in inverses[1:]]
    return two_sided_problem(problem, inverses, peaks=peaks)


def _prescribed_peak(reference: PiecewiseSignal, internal: InternalDynamics, system: TwoSidedSystem) -> Array:
    """Largest size over the whole reference of each output and derivative that the inverse prescribes (rho,)."""
    return internal.form.zeta.size(reference.size)[: system.prescribed]


def require_smooth(plant: SwitchedSystem, internals: Sequence[InternalDynamics], reference: PiecewiseSignal) -> None:
    """What the outputs prescribe of the state must be continuous within an interval; at a jump the conditions there decide.

    With a vector relative degree r this is y_d ... y_d^(r-1). Raises TrajectoryError.
    """
    edges, inner = reference.breakpoints, reference.inner_times()
    after, before = plant.interval(edges), np.searchsorted(plant.switch_times, edges, side="left")
    known: dict[int, Array] = {}

    def jump(order: int) -> Array:
        """Jump of a derivative at each breakpoint (p, m + 1)."""
        if order not in known:
            sides = [reference(edges, derivative=order, inside=times) for times in (inner[1:], inner[:-1])]
            known[order] = (sides[0] - sides[1]).T
        return known[order]

    shape = (len(plant), len(plant))
    pairs, which = np.unique(np.ravel_multi_index((before, after), shape), return_inverse=True)
    for number, (i, j) in enumerate(zip(*np.unravel_index(pairs, shape), strict=True)):
        form = internals[i].form
        size = form.zeta.size(reference.size)
        shared = np.ones(len(size), dtype=bool) if i == j else _shared_rows(form, internals[j].form)
        broken = np.abs(form.zeta.rows(jump)) > JUMP_TOLERANCE * np.where(size > 0, size, 1.0)[:, None]
        broken &= shared[:, None] & (which == number)
        if np.any(broken):
            at = int(np.flatnonzero(np.any(broken, axis=0))[0])
            raise TrajectoryError(_not_smooth(plant, form, reference, at, [jump(k) for k in range(len(form.zeta.coefficients))]))


def _not_smooth(plant: SwitchedSystem, form: NormalForm, reference: PiecewiseSignal, at: int, jumps: Sequence[Array]) -> str:
    """The sentence for a reference of which a derivative that the inverse prescribes jumps at a breakpoint.

    Args:
        plant, form: whose outputs these are, and its normal form there.
        reference: the deviation that is to be followed.
        at: number of the breakpoint.
        jumps: of each derivative (p, m + 1).
    """
    needed = [highest + 1 for highest in form.zeta.highest]
    shares = [np.abs(jump[:, at]) / np.where(reference.size(k) > 0, reference.size(k), 1.0) for k, jump in enumerate(jumps)]
    order, channel = next((k, i) for k, share in enumerate(shares) for i in np.flatnonzero(share > JUMP_TOLERANCE) if k < needed[i])
    r = needed[channel]
    return (
        f"the reference for {plant.outputs.names[channel]!r} is not smooth enough: its derivative of order {order} jumps at "
        f"t = {reference.breakpoints[at]:.6g} s, so it has {order} continuous derivatives (the value counted), but the "
        + ("plant's inverse, without relative degree," if form.combined else f"plant's relative degree {r}")
        + f" needs {r}; use a smoother profile, for instance rest_to_rest(..., smoothness={max(needed)})"
    )


def _shared_rows(left: NormalForm, right: NormalForm) -> NDArray[np.bool_]:
    """Which rows of zeta are, like those before them of the same output, the same functions of the state in both forms (rho,)."""
    shared, start, other = np.zeros(len(left.C_star), dtype=bool), 0, 0
    for ours, theirs in zip(left.orders, right.orders, strict=True):
        for k in range(min(ours, theirs)):
            same_row = _same(left.C_star[start + k], right.C_star[other + k])
            if not (same_row and _same(left.zeta.combination(start + k), right.zeta.combination(other + k))):
                break
            shared[start + k] = True
        start, other = start + ours, other + theirs
    return shared


def _same(a: Array, b: Array) -> bool:
    return a.shape == b.shape and bool(np.all(np.abs(a - b) <= SAME_ROW_TOLERANCE * np.maximum(np.abs(a), np.abs(b)).max()))


def require_consistent(problem: PlanningProblem, internals: Sequence[InternalDynamics], equations: TwoSidedSolution) -> None:
    """Raises CompatibilityError or BoundednessError where conditions are left that the solution cannot meet."""
    plant, solution = problem.plant, equations.boundary
    for k, (_, size) in enumerate(equations.open_checks):
        if size > CONSISTENCY_TOLERANCE:
            raise CompatibilityError(missing_derivative(problem, internals[k + 1].form, equations.trajectory(), k, size))
    scale = max(equations.size, np.finfo(float).tiny)
    compatibility_rows = 0
    for k, miss in enumerate(solution.inconsistency[:-1]):
        compatibility_rows += equations.compatibility_rows[k]
        if miss > CONSISTENCY_TOLERANCE * scale and not compatibility_rows:
            raise BoundednessError(
                "no bounded inverse: the internal state that the past leaves at the jump at "
                f"t = {plant.switch_times[k]:.6g} s is off the one that stays bounded over the next interval by "
                f"{miss / scale:.1e} of the trajectory's size; change the reference, the parameters after the jump, or the output"
            )
        if miss > CONSISTENCY_TOLERANCE * scale:
            raise CompatibilityError(
                f"at the jump at t = {plant.switch_times[k]:.6g} s the state cannot be continuous and the output exact at "
                f"once: the compatibility conditions fail by {miss / scale:.1e} of the trajectory's size; change the reference "
                "around the jump, or keep C* (outputs and derivatives as functions of the state) the same on both sides"
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


def invert(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
) -> Plan:
    """The bounded input and state with which the outputs of `model` follow `reference` exactly.

    x' = A_k x + B_k u, C_k x = y_d on all of time, x continuous through the jumps. Internal dynamics: stable part forward from
    rest, antistable part backward from rest, so the input acts before the manoeuvre (preactuation) and rings down after it. What
    belongs to zeros on the imaginary axis runs forward, from rest; a reference that leaves it at rest is served.

    With more inputs than outputs many inputs do it. Taken are those with the least integral of (u - u_rest)'R (u - u_rest), where
    u_rest is the least u'R u (from the operating point's input) that would hold the wanted outputs where they are.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D, with at least as many inputs as outputs.
        reference: absolute, in the units of the outputs.
        R: how dear inputs are where there is a choice (m, m), in 1 / (units squared); by default each input by its range
            (`input_limits`), without limits all alike.
        tolerance: what counts as rest at the two ends, as a share of each state's and input's peak; it sets how early the plan
            starts.
        max_preactuation: longest preactuation [s], at the price of a start that is not quite at rest, which `remarks` states.

    Raises TrajectoryError (reference not smooth enough, wrong number of channels), PlanError (options out of range; too
    ill-conditioned), RelativeDegreeError, NonHyperbolicError (the reference leaves motion in zeros on the imaginary axis
    of the last interval, or holds outputs that drive a zero at the origin), CompatibilityError (a jump at which no continuous state
    keeps the output exact), BoundednessError (no bounded solution).
    Sources: Devasia, Chen, Paden 1996; Devasia, Paden, Rossi 1996, Lemma 1.
    """
    problem = PlanningProblem.of(model, reference, tolerance=tolerance, max_preactuation=max_preactuation)
    plant, measure = problem.plant, input_measure(problem.plant, R)
    if plant.n_inputs > plant.n_outputs:
        return _allocated(problem, measure)
    splits = split_through_axis(plant)
    internals = [split.internal for split in splits]
    require_rest_held(problem, splits)
    require_smooth(plant, internals, problem.deviation)
    solution = bounded_solution(problem, splits, measure=measure)
    remarks = solution.remarks + require_rest_left(problem, splits, solution.equations)
    return problem.plan("stable inversion", solution.trajectory, exact=True, remarks=remarks)


def _allocated(problem: PlanningProblem, measure: InputMeasure) -> Plan:
    """The plan for more inputs than outputs."""
    plant = problem.plant

    def inverse(system: StateSpace) -> AllocatedInverse:
        return AllocatedDynamics.of(system, measure.R).inverse(endless=plant.is_endless(system))

    inverses = plant.map(inverse)
    require_same_resting_places(inverses)
    internals = [each.internal for each in inverses]
    require_smooth(plant, internals, problem.deviation)
    solution = _bounded(problem, allocated_problem(problem, inverses), internals, measure)
    remark = (
        f"{plant.n_inputs} inputs for {plant.n_outputs} output(s): of those that follow the reference exactly the least, "
        f"{measure.wording}, was taken"
    )
    return problem.plan("stable inversion", solution.trajectory, exact=True, remarks=(remark, *solution.remarks))
