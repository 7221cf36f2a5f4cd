"""Plans that do not act ahead: the causal inverse, and the usual practice of following by the steady state."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from invtrack.arguments import items
from invtrack.arrays import Array
from invtrack.errors import InversionError, NonHyperbolicError, PlanError
from invtrack.inversion.bounded_solution import bounded_solution
from invtrack.inversion.inverse_system import inverse_systems, require_square
from invtrack.inversion.modified.modified_dynamics import has_equilibrium, undivided_dynamics
from invtrack.inversion.nonlinear.postures import steady_motion
from invtrack.inversion.smoothness import require_smooth
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros, on_axis
from invtrack.linear.state_space import StateSpace
from invtrack.plans.dynamics import ScheduledChange, mechanism
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import two_sided_problem
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal

REPEATED_TOLERANCE = 1e-6
"""Zeros on the axis that are closer than this share of the largest zero are one repeated zero."""

CONDITION_LIMIT = 1e14
"""Largest condition number, in the best of units, with which the equations of the steady state still count as solvable."""


def causal_inverse(
    model: Any, reference: PiecewiseSignal, *, tolerance: float = 1e-10, max_postactuation: float | None = None
) -> Plan:
    """The input with which the output of `model` follows `reference` exactly from rest, without acting before the manoeuvre.

    The internal dynamics eta' = A_eta eta + A_zeta zeta_d + B_r y_d^(r) run forward from their equilibrium. That stays bounded for
    plants without antistable zeros. Zeros on the imaginary axis are allowed: what the manoeuvre leaves in them rings on for ever,
    while the output stands still; `postactuation` is then 0 and `remarks` says so.

    model, reference, tolerance, max_postactuation: as for `invert`, which is compared with it, as is `modified_inversion`.

    Raises PlanError (options out of range), NonHyperbolicError (antistable zeros, repeated zeros on the axis, a zero at the
    origin), TrajectoryError, RelativeDegreeError, CompatibilityError, BoundednessError. Source: Devasia 1996 (non-hyperbolic
    internal dynamics), section 2.3.
    """
    problem = PlanningProblem.of(model, reference, tolerance=tolerance, max_postactuation=max_postactuation)
    require_square(problem.plant, "causal_inverse")
    splits = undivided_dynamics(problem.plant)
    for k, split in enumerate(splits):
        _require_bounded(split.internal, k)
    require_smooth(problem.plant, [split.internal for split in splits], problem.deviation)
    solution = bounded_solution(problem, inverse_systems(problem.plant, splits))
    last, remarks = splits[-1].internal, solution.remarks
    rings = on_axis(last)
    if np.any(rings):
        listed = format_zeros(last.zeros[rings], float(np.max(np.abs(last.zeros))))
        remarks += (f"the zeros at {listed} lie on the imaginary axis: what is left in them after the manoeuvre rings on for ever",)
    return problem.plan("causal inverse", solution.trajectory, exact=True, lasting=bool(np.any(rings)), remarks=remarks)


def _require_bounded(internal: InternalDynamics, interval: int) -> None:
    zeros, axis = internal.zeros, on_axis(internal)
    size = float(np.max(np.abs(zeros), initial=0.0))
    antistable = ~axis & (zeros.real > 0)
    where = f"interval {interval}: "
    if np.any(antistable):
        raise NonHyperbolicError(
            f"{where}no causal inverse: the internal dynamics grow without bound forward in time, antistable zeros at "
            f"{format_zeros(zeros[antistable], size)}; use invert, whose input acts before the manoeuvre, or modified_inversion"
        )
    values = zeros[axis]
    if not has_equilibrium(internal):
        raise NonHyperbolicError(
            f"{where}no bounded causal inverse: a zero at the origin, whose internal state drifts with whatever the manoeuvre "
            "leaves in it; use modified_inversion, or track another output"
        )
    distance = np.abs(values[:, None] - values) + np.diag(np.full(len(values), np.inf))
    if np.min(distance, initial=np.inf) <= REPEATED_TOLERANCE * size:
        raise NonHyperbolicError(
            f"{where}no bounded causal inverse: repeated zeros on the imaginary axis at {format_zeros(values, size)}, whose "
            "response grows with time; use modified_inversion, or track another output"
        )


def steady_state_feedforward(model: Any, reference: PiecewiseSignal, *, schedule: Sequence[ScheduledChange] = ()) -> Plan:
    """State and input that would hold the output at y_d(t) if it stood still there: A x + B u = 0, C x + D u = y_d.

    No inverse stands behind it: it is not a trajectory of the plant (its certificate's dynamics residual says by how much), and
    with feedback around it, it is what a controller without inversion does.

    Of a Plant these are the postures at rest with y_d(t), f(x, u) = 0 and h(x, u) = y_d, and the inputs that hold each of them
    against gravity and springs; `lqr` of such a plan makes gains that follow the postures.

    Args:
        model: as for `invert`.
        reference: absolute; for a Plant from rest, where it stands, to rest.
        schedule: for a Plant, when its parameters change on the way: [Change(1.0, tip_mass=0.5)].

    Raises InversionError where some output cannot be held (a zero at s = 0), TrajectoryError for a wrong number of channels; for a
    Plant PlanError where there is no equilibrium on the way, and for what else `invert` refuses.
    """
    moving = mechanism(model)
    if moving is not None:
        return steady_motion(moving, reference, schedule)
    if len(items("schedule", schedule, expected="a list of changes, such as [invtrack.Change(1.0, mass=2.0)]", error=PlanError)):
        raise PlanError("schedule is for a Plant; a linear model that switches is a SwitchedSystem")
    problem = PlanningProblem.of(model, reference)
    require_square(problem.plant, "steady_state_feedforward")
    trajectory = two_sided_problem(problem, problem.plant.map(_SteadyState)).solve().trajectory()
    remark = "not a trajectory of the plant: the steady state of each wanted output"
    return problem.plan("steady-state feedforward", trajectory, exact=None, remarks=(remark,))


class _SteadyState:
    """A two-sided system without states: the reference's share is all there is."""

    def __init__(self, plant: StateSpace) -> None:
        self._held = np.vstack([quasi_static(plant, 1)[0], np.eye(plant.n_outputs)])
        none = Part.empty(len(self._held), 0)
        self.system = TwoSidedSystem(none, none, np.zeros((0, 0)))

    def driven(self, generator: Generator) -> DrivenSystem:
        """[x; u; y] that would hold the wanted output where it is."""
        nothing = np.zeros((0, len(generator.S)))
        return DrivenSystem(self.system, generator.S, nothing, nothing, self._held @ generator.R, nothing)


def quasi_static(system: StateSpace, terms: int) -> Array:
    """[x; u] (terms, n + p, p) of a slow motion: [x; u] = sum over i of entry i times y^(i), the first one the steady state.

    A X_0 + B U_0 = 0, C X_0 + D U_0 = 1, and A X_i + B U_i = X_(i-1), C X_i + D U_i = 0 from then on.

    Raises InversionError where some output cannot be held (a zero at s = 0).
    """
    pencil = np.block([[system.A, system.B], [system.C, system.D]])
    n, p = system.n_states, system.n_outputs
    try:
        inverse = np.linalg.solve(pencil, np.eye(n + p))
        # The spectral radius of |M^-1| |M| is the condition number that the best scaling of rows and columns reaches (Bauer 1963).
        condition = float(np.max(np.abs(np.linalg.eigvals(np.abs(inverse) @ np.abs(pencil)))))
    except np.linalg.LinAlgError:
        condition = np.inf
    if not condition < CONDITION_LIMIT:
        raise InversionError(f"the outputs {list(system.outputs.names)} cannot be held at constant values (a zero at s = 0)")
    found = [inverse[:, n:]]
    for _ in range(terms - 1):
        found.append(inverse[:, :n] @ found[-1][:n])
    return np.array(found)
