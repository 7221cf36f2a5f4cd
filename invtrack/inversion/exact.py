"""Exact output tracking with bounded input and state: stable inversion, through parameter jumps at known times."""

from __future__ import annotations

from typing import Any

from invtrack.inversion.bounded_solution.problem import split_each
from invtrack.inversion.bounded_solution.refusals import require_accurate, require_smooth
from invtrack.inversion.bounded_solution.solution import asks_for_motion, bounded_solution, require_options
from invtrack.linear.switched import as_switched
from invtrack.plans.certificate import certify
from invtrack.plans.ends import actuation_times
from invtrack.plans.plan import Plan
from invtrack.plans.problem import deviation_reference, require_reference
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

    Raises TrajectoryError (reference not smooth enough, wrong number of channels), InversionError (options out of range),
    RelativeDegreeError, NonHyperbolicError (zeros on the imaginary axis in the first or last interval), CompatibilityError (a jump
    at which no continuous state keeps the output exact), BoundednessError (no bounded solution), InversionError (too
    ill-conditioned). Sources: Devasia, Chen, Paden 1996; Devasia, Paden, Rossi 1996, Lemma 1.
    """
    require_options(tolerance, max_preactuation)
    plant = as_switched(model)
    require_reference(plant, reference)
    deviation = deviation_reference(plant, reference)
    splits = split_each(plant)
    require_smooth(plant, splits, reference)
    solution = bounded_solution(plant, splits, deviation)
    trajectory, manoeuvre = solution.trajectory, solution.manoeuvre
    preactuation, postactuation, remarks = actuation_times(trajectory, solution.departures, tolerance, max_preactuation)
    certificate = certify(plant, trajectory, deviation, (manoeuvre[0] - preactuation, manoeuvre[1] + postactuation))
    if asks_for_motion(deviation, reference):
        require_accurate(certificate, solution.boundary)
    return Plan(
        method="stable inversion",
        model=plant,
        reference=reference,
        trajectory=trajectory,
        manoeuvre=manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=certificate,
        remarks=remarks + solution.remarks,
    )
