"""Exact inversion of a reference that is known only some time ahead."""

from __future__ import annotations

from typing import Any

from numpy.typing import ArrayLike

from invtrack.errors import PlanError
from invtrack.inversion.inverse_system import hyperbolic_splits, inverse_systems, require_square
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.dynamics import mechanism
from invtrack.plans.plan import Plan
from invtrack.preview.chain_driven import ChainDriven
from invtrack.preview.driven_plan import driven_plan
from invtrack.preview.law import PreviewLaw
from invtrack.preview.output_chain import OutputChain
from invtrack.preview.planner import PreviewPlanner
from invtrack.references.signal import PiecewiseSignal

METHOD = "inversion with preview"


def inversion_planner(
    model: Any, *, preview: float, period: float, start: float = 0.0, held: ArrayLike | None = None
) -> PreviewPlanner:
    """A planner that inverts `model` for a reference that is known only `preview` seconds ahead, told of it update by update.

    The exact inverse's antistable part z_u(t) = -integral from t to infinity of e^(-A_u (s - t)) G_u [zeta; chi](s) ds is cut where
    the reference ends to be known: beyond, chi = y^(r) counts as zero. The stable part runs on from what was driven before. Each
    piece of the plan has the exact output; x and u jump from one piece to the next by what is new, which a feedback around x_ref
    takes up. Jumps of the plant are known for all time.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D, with as many inputs as outputs.
        preview: how far ahead the reference is known [s], a whole number of periods.
        period: between updates [s].
        start: time of the first update [s].
        held: outputs (p,) at which the plant stands until told otherwise, absolute; by default those of its rest.

    Raises PlanError for times that do not fit, and what `invert` raises for the model (NonHyperbolicError, RelativeDegreeError);
    CompatibilityError, BoundednessError where at a jump the future does not fix the plan. Sources: Q. Zou, S. Devasia,
    "Preview-based stable-inversion for output tracking of linear systems", ASME J. Dynamic Systems, Measurement, and Control
    121(4), 1999; for jumps Devasia, Paden, Rossi 1996.
    """
    return PreviewPlanner(inversion_law(model), preview=preview, period=period, start=start, held=held)


def preview_inversion(
    model: Any,
    reference: PiecewiseSignal,
    *,
    preview: float,
    period: float,
    tolerance: float = 1e-10,
    max_postactuation: float | None = None,
) -> Plan:
    """What an `inversion_planner` drives that gets to know `reference` only `preview` seconds ahead, as a plan over all of time.

    The planned output is the reference; x_ref and u jump at updates, by what is new (the certificate's `continuity`), so that the
    plan is no trajectory of the plant: a loop around it misses the output by what `preview_bound` bounds.

    Args:
        model: as for `inversion_planner`.
        reference: absolute, held still before and after the manoeuvre.
        preview, period: as for `inversion_planner` [s].
        tolerance, max_postactuation: as for `invert`.

    Raises what `inversion_planner` and its updates raise, and TrajectoryError for a reference that goes on moving for ever.
    """
    return driven_plan(
        inversion_law(model), reference, preview=preview, period=period, tolerance=tolerance, max_postactuation=max_postactuation
    )


def inversion_law(model: Any) -> PreviewLaw:
    """The exact inverse of each interval, joined at the jumps from the future back."""
    plant = linear_plant(model)
    require_square(plant, METHOD)
    inverses = inverse_systems(plant, hyperbolic_splits(plant))
    chain = OutputChain.of(plant)
    made = {id(inverse): ChainDriven.of(system, chain, inverse) for system, inverse in zip(plant.systems, inverses, strict=True)}
    return PreviewLaw(METHOD, plant, chain, [made[id(inverse)] for inverse in inverses], keeps_state=False)


def linear_plant(model: Any) -> SwitchedSystem:
    """The model; raises PlanError for a Plant."""
    if mechanism(model) is not None:
        raise PlanError(
            "planning with preview is for linear models, got a Plant; linearize it first: invtrack.linearize(plant), or a "
            "SwitchedSystem of several"
        )
    return as_switched(model)
