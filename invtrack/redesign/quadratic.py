"""Optimal output-trajectory redesign: a deliberate trade between following the reference and what that costs."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import RedesignError, TrajectoryError
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.certificate import certify
from invtrack.plans.ends import actuation_times
from invtrack.plans.plan import Certificate, Plan
from invtrack.plans.problem import deviation_reference, require_reference
from invtrack.redesign.optimal.assembly import Redesign, assemble
from invtrack.redesign.weights import FREE_HOLDING, ROUNDING, Weights, as_weights
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

ACCURACY = 1e-8
"""Largest residual of a plan's dynamics, relative to its size, with which it is handed out."""


def quadratic_redesign(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
) -> Plan:
    """The trajectory of `model` that minimises what it costs to move and to miss the reference, over all of time.

    integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d), x' = A_k x + B_k (u - u0), x continuous through the jumps.
    u = -K x - R^-1 B's with K from the Riccati equation and s' = -(A - B K)'s + C'Q_y y_d from the future, so the input acts before
    the manoeuvre. The plan's y is the redesigned output; `reference` stays the wanted one, and the certificate's output error is
    what lies between the two by design. Nothing is asked of the reference's smoothness.

    model: StateSpace, SwitchedSystem, or anything with A, B, C, D. reference: absolute, in the units of the outputs, held still
    before and after the manoeuvre. R (p, p) positive definite, Q_x (n, n), Q_y (p, p) positive semidefinite, in 1 / (units
    squared); a number stands for that multiple of the identity. With Q_y = 0 the optimum is not to move. tolerance,
    max_preactuation [s]: as in `invert`.

    Raises TrajectoryError (wrong number of channels, a reference that does not hold still before and after), RedesignError
    (options or weights out of range; holding an end value would cost input for ever, so that the cost is infinite; a mode that
    the cost does not see or the input does not reach). Source: S. Devasia, "Optimal output-trajectory redesign for invertible
    systems", AIAA J. of Guidance, Control, and Dynamics 19(5), 1996 (frequency domain; here the same optimum in time).
    """
    if not 0 < tolerance < 1 or (max_preactuation is not None and not max_preactuation >= 0):
        raise RedesignError(
            f"tolerance must lie between 0 and 1 and max_preactuation must not be negative, got {tolerance} and {max_preactuation}"
        )
    plant = as_switched(model)
    weights = as_weights(plant, R=R, Q_x=Q_x, Q_y=Q_y)
    require_reference(plant, reference)
    deviation = _deviation(plant, reference)
    plan = assemble(plant, deviation, weights)
    _require_free_holding(plant, plan, weights)
    preactuation, postactuation, remarks = actuation_times(plan.trajectory, plan.departures, tolerance, max_preactuation)
    manoeuvre = deviation.manoeuvre
    certificate = certify(plant, plan.trajectory, deviation, (manoeuvre[0] - preactuation, manoeuvre[1] + postactuation))
    _require_accurate(certificate)
    return Plan(
        method="quadratic redesign",
        model=plant,
        reference=reference,
        trajectory=plan.trajectory,
        manoeuvre=manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=certificate,
        remarks=remarks,
    )


def _deviation(plant: SwitchedSystem, reference: PiecewiseSignal) -> PiecewiseSignal:
    """The reference as deviation from the operating point, with breakpoints at the jumps; it must hold still at both ends."""
    for place, when in ((0, "before"), (-1, "after")):
        generator = reference.generators[reference.kind[place]]
        w = reference.anchors[place, : len(generator.S)]
        if np.any(np.abs(generator.S @ w) > 1e-12 * np.abs(generator.S) @ np.abs(w)):
            raise TrajectoryError(
                f"the reference goes on moving {when} its first and last breakpoint ({reference.manoeuvre}), for ever, so the cost "
                "over all of time is infinite; hold it still there, for instance with invtrack.autonomous(..., start=, end=)"
            )
    return deviation_reference(plant, reference)


def _require_free_holding(plant: SwitchedSystem, plan: Redesign, weights: Weights) -> None:
    """Raises RedesignError where the plan goes on costing something at rest before or after the manoeuvre."""
    n, p = plant.n_states, plant.n_channels
    for wanted, values, when in zip(plan.held, plan.held_values, ("before", "after"), strict=True):
        staying_away = float(np.abs(wanted) @ np.abs(weights.Q_y) @ np.abs(wanted))
        x, u, y = np.split(values[np.newaxis], [n, n + p], axis=1)
        rate = float(weights.rate(x, u, y - wanted)[0])
        rounding = ROUNDING * float(weights.terms(x, u, y - wanted)[0])
        if rate > FREE_HOLDING * staying_away + rounding:
            raise RedesignError(
                f"the cost is infinite: {when} the manoeuvre the outputs {list(plant.output_names)} are to be held at "
                f"{wanted.tolist()} (from the operating point) for ever, which costs {rate:.3g} per second even at the best "
                "compromise; let the reference return to the operating point, take the held value itself as the operating point, "
                "or give no weight to the states or inputs that holding it takes (a rigid-body motion needs none)"
            )


def _require_accurate(certificate: Certificate) -> None:
    worst = max(certificate.dynamics_residual, certificate.continuity)
    if not worst <= ACCURACY:
        raise RedesignError(
            f"the redesign is too ill-conditioned to be trusted: the plan misses the plant's equations by {worst:.1e} of its size "
            f"({certificate}); look for inputs or states in badly chosen units, or bring the weights closer to each other"
        )
