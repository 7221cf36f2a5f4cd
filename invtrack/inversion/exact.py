"""Exact output tracking with bounded input and state: stable inversion, through parameter jumps at known times."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import BoundednessError, CompatibilityError, TrajectoryError
from invtrack.linear.internal_dynamics import SplitDynamics, split_dynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import SAME_ROW_TOLERANCE, TwoSidedProblem, TwoSidedSolution, two_sided_problem
from invtrack.references.signal import Generator, PiecewiseSignal

CONSISTENCY_TOLERANCE = 1e-7
"""Conditions without unknowns left must hold to this share of the size of their terms."""


@dataclass(frozen=True, eq=False)
class Correction:
    """The term v = feedback V eta + feedforward [zeta_d; y_d^(r)] of u = B_y^-1 (y_d^(r) - A_x x + v), which gives up exactness.

    feedback (p, n) acts on the state's distance V eta from P zeta_d, feedforward (p, rho + p) on the wanted output's derivatives.
    """

    feedback: Array
    feedforward: Array


@dataclass(frozen=True, eq=False)
class InverseSystem:
    """x = P zeta_d + V (W_s z_s + W_u z_u), u = B_y^-1 (y_d^(r) - A_x x + v): z_s forward, z_u backward.

    What is continuous through a jump is the state x (n,). Without a correction v = 0 and the outputs' derivatives zeta = C* x are
    prescribed; a modified inverse prescribes none (Devasia 1996, eqs. 7-9 and 12; Devasia, Paden, Rossi 1996, eqs. 3-5).
    """

    plant: StateSpace
    split: SplitDynamics
    correction: Correction
    system: TwoSidedSystem

    @classmethod
    def of(cls, plant: StateSpace, split: SplitDynamics, correction: Correction | None = None) -> InverseSystem:
        """The inverse of `plant` with these internal dynamics, which take account of the correction."""
        form = split.internal.form
        if correction is None:
            rho, p = sum(form.relative_degree), plant.n_channels
            correction = Correction(np.zeros((p, plant.n_states)), np.zeros((p, rho + p)))
        x_s, x_u = form.V @ split.W_s, form.V @ split.W_u
        T = np.vstack([form.C_star, split.L_s @ form.N, split.L_u @ form.N])
        system = TwoSidedSystem(
            Part(split.A_s, _values(plant, split, x_s, correction.feedback @ x_s), x_s),
            Part(split.A_u, _values(plant, split, x_u, correction.feedback @ x_u), x_u),
            T,
            len(form.C_star),
        )
        return cls(plant, split, correction, system)

    def driven(self, generator: Generator) -> DrivenSystem:
        """The inverse for outputs y_d = R w, w' = S w."""
        form = self.split.internal.form
        derivatives = [generator.derivative(k) for k in range(max(form.relative_degree) + 1)]
        zeta_rows = [derivatives[k][i] for i, r in enumerate(form.relative_degree) for k in range(r)]
        Z = np.array(zeta_rows).reshape(-1, len(generator.S))
        highest = np.array([derivatives[r][i] for i, r in enumerate(form.relative_degree)])
        drive = np.vstack([Z, highest])
        return DrivenSystem(
            system=self.system,
            S=generator.S,
            D_f=self.split.G_s @ drive,
            D_b=self.split.G_u @ drive,
            X_w=_values(self.plant, self.split, form.P @ Z, highest + self.correction.feedforward @ drive),
            J_w=form.P @ Z,
        )


def split_each(plant: SwitchedSystem) -> tuple[SplitDynamics, ...]:
    """Split internal dynamics of each interval; models that recur share them.

    Zeros on the imaginary axis are refused in the first and the last interval, which have no end; over the others they stay
    bounded. Raises NonHyperbolicError, RelativeDegreeError.
    """
    return plant.map(lambda system: split_dynamics(system, endless=plant.is_endless(system)))


def _values(plant: StateSpace, split: SplitDynamics, x_rows: Array, y_r_rows: Array) -> Array:
    """Rows of [x; u; y] from those of x and of y_d^(r) + v."""
    F, G = split.internal.form.tracking_law()
    u_rows = F @ x_rows + G @ y_r_rows
    return np.vstack([x_rows, u_rows, plant.C @ x_rows + plant.D @ u_rows])


@dataclass(frozen=True, eq=False)
class BoundedSolution:
    """The trajectory, and the equations that it solves."""

    trajectory: Trajectory
    equations: TwoSidedSolution

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a user should know about the solution."""
        freedom = self.equations.boundary.freedom
        if not freedom:
            return ()
        return (f"the bounded inverse is not unique ({freedom} free direction(s)); the one of least norm was taken",)


def bounded_solution(
    problem: PlanningProblem, splits: Sequence[SplitDynamics], corrections: Sequence[Correction] | None = None
) -> BoundedSolution:
    """Stable part forward in time, antistable part backward, the state continuous at the jumps.

    splits: of each interval; corrections: what each interval's law adds to the exact one (nothing, by default). Raises
    CompatibilityError and BoundednessError where the conditions cannot all be met.
    """
    equations = inverse_problem(problem, splits, corrections).solve()
    require_consistent(problem.plant, equations)
    return BoundedSolution(equations.trajectory(), equations)


def inverse_problem(
    problem: PlanningProblem, splits: Sequence[SplitDynamics], corrections: Sequence[Correction] | None = None
) -> TwoSidedProblem:
    """The two-sided problem of the inverse: that of each interval, driven by each generator of the reference that occurs in it."""
    inverses: dict[int, InverseSystem] = {}
    for k, split in enumerate(splits):
        if id(split) not in inverses:
            inverses[id(split)] = InverseSystem.of(problem.plant.systems[k], split, None if corrections is None else corrections[k])
    models = [inverses[id(split)] for split in splits]
    peaks = [_prescribed_peak(problem.deviation, model) for model in models[1:]]
    return two_sided_problem(problem, models, peaks=peaks)


def _prescribed_peak(reference: PiecewiseSignal, model: InverseSystem) -> Array:
    """Largest size over the whole reference of each output and derivative that the inverse prescribes (rho,)."""
    degrees = model.split.internal.form.relative_degree
    sizes = [reference.size(order)[i] for i, r in enumerate(degrees) for order in range(r)]
    return np.array(sizes[: model.system.prescribed], dtype=float)


def require_smooth(plant: SwitchedSystem, splits: Sequence[SplitDynamics], reference: PiecewiseSignal) -> None:
    """Within an interval of relative degree r, y_d ... y_d^(r-1) must be continuous; at a jump the conditions there decide."""
    after = plant.interval(reference.breakpoints)
    before = np.searchsorted(plant.switch_times, reference.breakpoints, side="left")
    shape = (len(plant), len(plant))
    sides, which = np.unique(np.ravel_multi_index((before, after), shape), return_inverse=True)
    pairs = zip(*np.unravel_index(sides, shape), strict=True)
    needed = np.array([_shared_orders(splits[i], splits[j]) for i, j in pairs])[which]  # (breakpoints, p)
    for order in range(int(needed.max(initial=0))):
        discontinuous = (reference.jumps(order) > 1e-9) & (order < needed)
        if np.any(discontinuous):
            at, channel = np.argwhere(discontinuous)[0]
            name, r = plant.outputs.names[channel], int(needed[at, channel])
            raise TrajectoryError(
                f"the reference for {name!r} is not smooth enough: its derivative of order {order} jumps at "
                f"t = {reference.breakpoints[at]:.6g} s, so it has {order} continuous derivatives (the value counted), but the "
                f"plant's relative degree {r} needs {r}; use a smoother profile, for instance rest_to_rest(..., smoothness={r})"
            )


def _shared_orders(left: SplitDynamics, right: SplitDynamics) -> list[int]:
    """Per output, how many of y, y', ... are the same functions of the state in both intervals, so that they cannot jump."""
    rows = [_derivative_rows(split) for split in (left, right)]
    return [
        next((k for k, (a, b) in enumerate(zip(*pair, strict=False)) if not _same_row(a, b)), min(len(pair[0]), len(pair[1])))
        for pair in zip(*rows, strict=True)
    ]


def _derivative_rows(split: SplitDynamics) -> list[Array]:
    """The rows of C* of each output."""
    form = split.internal.form
    return np.split(form.C_star, np.cumsum(form.relative_degree)[:-1])


def _same_row(a: Array, b: Array) -> bool:
    return bool(np.all(np.abs(a - b) <= SAME_ROW_TOLERANCE * np.maximum(np.abs(a), np.abs(b)).max()))


def require_consistent(plant: SwitchedSystem, equations: TwoSidedSolution) -> None:
    """Raises CompatibilityError or BoundednessError where conditions are left that the solution cannot meet."""
    solution = equations.boundary
    for k, (row, size) in enumerate(equations.open_checks):
        if size > CONSISTENCY_TOLERANCE:
            raise CompatibilityError(
                f"at the jump at t = {plant.switch_times[k]:.6g} s the outputs and derivatives of the new plant (condition "
                f"{row + 1}) miss the wanted ones by {size:.1e} of their size whatever the internal state, so no bounded input "
                "keeps the output exact through it; let the reference there take the value that the state before gives"
            )
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
        raise BoundednessError(
            f"no bounded inverse: {n_u[0]} antistable zero(s) before the manoeuvre give {n_u[0]} unknown(s) for the {n_u[1]} "
            "condition(s) that keep the internal state bounded after it, and these fail by "
            f"{solution.inconsistency[-1] / scale:.1e} of the trajectory's size; change the reference, the last interval's "
            "parameters, or the output"
        )


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
