"""The causal inverse: internal dynamics run forward from rest, no preactuation. Only where nothing in them grows."""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.errors import NonHyperbolicError
from invtrack.inversion.bounded_solution import bounded_solution, require_smooth
from invtrack.inversion.modified.modified_dynamics import has_equilibrium, undivided_dynamics
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros, on_axis
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.references.signal import PiecewiseSignal

REPEATED_TOLERANCE = 1e-6
"""Zeros on the axis that are closer than this share of the largest zero are one repeated zero."""


def causal_inverse(model: Any, reference: PiecewiseSignal, *, tolerance: float = 1e-10) -> Plan:
    """The input with which the output of `model` follows `reference` exactly from rest, without acting before the manoeuvre.

    The internal dynamics eta' = A_eta eta + A_zeta zeta_d + B_r y_d^(r) run forward from their equilibrium. That stays bounded for
    plants without antistable zeros. Zeros on the imaginary axis are allowed: what the manoeuvre leaves in them rings on for ever,
    while the output stands still; `postactuation` is then 0 and `remarks` says so.

    model, reference, tolerance: as for `invert`. Raises InversionError (tolerance), NonHyperbolicError (antistable zeros, repeated
    zeros on the axis, a zero at the origin), TrajectoryError, RelativeDegreeError, CompatibilityError, BoundednessError. It is what
    `modified_inversion` and `invert` are compared with. Source: Devasia 1996 (non-hyperbolic internal dynamics), section 2.3.
    """
    problem = PlanningProblem.of(model, reference, tolerance=tolerance)
    splits = undivided_dynamics(problem.plant)
    for k, split in enumerate(splits):
        _require_bounded(split.internal, k)
    require_smooth(problem.plant, splits, problem.deviation)
    solution = bounded_solution(problem, splits)
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
