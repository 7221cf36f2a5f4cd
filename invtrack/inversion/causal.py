"""The causal inverse: internal dynamics run forward from rest, no preactuation. Only where nothing in them grows."""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.errors import NonHyperbolicError
from invtrack.inversion.bounded_solution.refusals import require_accurate, require_smooth
from invtrack.inversion.bounded_solution.solution import asks_for_motion, bounded_solution, require_options
from invtrack.inversion.modified.modified_dynamics import has_equilibrium, undivided_dynamics
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros, on_axis
from invtrack.linear.switched import as_switched
from invtrack.plans.certificate import certify
from invtrack.plans.ends import Departure, actuation_times
from invtrack.plans.plan import Plan
from invtrack.plans.problem import deviation_reference, require_reference
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
    require_options(tolerance, None)
    plant = as_switched(model)
    require_reference(plant, reference)
    deviation = deviation_reference(plant, reference)
    splits = undivided_dynamics(plant)
    for k, split in enumerate(splits):
        _require_bounded(split.internal, k)
    require_smooth(plant, splits, deviation)
    solution = bounded_solution(plant, splits, deviation)
    last = splits[-1].internal
    rings = on_axis(last)
    departures = (solution.departures[0], _decaying(solution.departures[1], bool(np.any(rings))))
    _, postactuation, _ = actuation_times(solution.trajectory, departures, tolerance, None)
    remarks = solution.remarks
    if np.any(rings):
        listed = format_zeros(last.zeros[rings], float(np.max(np.abs(last.zeros))))
        remarks += (f"the zeros at {listed} lie on the imaginary axis: what is left in them after the manoeuvre rings on for ever",)
    manoeuvre = solution.manoeuvre
    certificate = certify(plant, solution.trajectory, deviation, (manoeuvre[0], manoeuvre[1] + postactuation))
    if asks_for_motion(deviation, reference):
        require_accurate(certificate, solution.boundary)
    return Plan(
        method="causal inverse",
        model=plant,
        reference=reference,
        trajectory=solution.trajectory,
        manoeuvre=manoeuvre,
        preactuation=0.0,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=certificate,
        remarks=remarks,
    )


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


def _decaying(departure: Departure, rings: bool) -> Departure:
    """What dies out after the manoeuvre; nothing is waited for where something never does."""
    return Departure(departure.M[:0, :0], departure.X[:, :0], departure.v[:0]) if rings else departure
