"""Quadratic redesign of a reference that is known only some time ahead."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.errors import RedesignError
from invtrack.plans.plan import Plan
from invtrack.preview.chain_driven import ChainDriven
from invtrack.preview.driven_plan import driven_plan
from invtrack.preview.inversion import linear_plant
from invtrack.preview.law import PreviewLaw
from invtrack.preview.output_chain import OutputChain
from invtrack.preview.planner import PreviewPlanner
from invtrack.redesign.cost import as_weights
from invtrack.redesign.optimum import TrackedSystem, optimum
from invtrack.references.signal import PiecewiseSignal

METHOD = "redesign with preview"


def redesign_planner(
    model: Any,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    preview: float,
    period: float,
    start: float = 0.0,
    held: ArrayLike | None = None,
) -> PreviewPlanner:
    """A planner of least cost for a reference that is known only `preview` seconds ahead, told of it update by update.

    At each update the costate of the future, s(t) = -integral from t on of e^(A_c' (s - t)) C'Q_y y_d ds, A_c = A - B K, is cut
    where the reference ends to be known, and the plan u = -K x - R^-1 B's goes on from the state x that the last one has
    reached: x_ref is a motion of the plant, u jumps by what is new. Jumps of the plant are known for all time.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D.
        R, Q_x, Q_y: weights as for `quadratic_redesign`.
        preview: how far ahead the reference is known [s], a whole number of periods.
        period: between updates [s].
        start: time of the first update [s].
        held: outputs (p,) at which the plant stands until told otherwise, absolute; by default those of its rest.

    Raises PlanError for times that do not fit, RedesignError for weights, and where no optimum exists. The method is the
    linear-quadratic tracker of Devasia 1996 (output-trajectory redesign), its future cut as in Zou and Devasia 1999.
    """
    return PreviewPlanner(redesign_law(model, R=R, Q_x=Q_x, Q_y=Q_y), preview=preview, period=period, start=start, held=held)


def preview_redesign(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    preview: float,
    period: float,
    tolerance: float = 1e-10,
    max_postactuation: float | None = None,
) -> Plan:
    """What a `redesign_planner` drives that gets to know `reference` only `preview` seconds ahead, as a plan over all of time.

    The plan is a motion of the plant. With a long preview it is that of `quadratic_redesign`.

    Args:
        model: as for `redesign_planner`.
        reference: absolute, held still before and after the manoeuvre.
        R, Q_x, Q_y: weights as for `quadratic_redesign`.
        preview, period: as for `redesign_planner` [s].
        tolerance, max_postactuation: as for `invert`.

    Raises what `redesign_planner` and its updates raise, and TrajectoryError for a reference that goes on moving for ever.
    """
    law = redesign_law(model, R=R, Q_x=Q_x, Q_y=Q_y)
    return driven_plan(law, reference, preview=preview, period=period, tolerance=tolerance, max_postactuation=max_postactuation)


def redesign_law(model: Any, *, R: ArrayLike, Q_x: ArrayLike, Q_y: ArrayLike) -> PreviewLaw:
    """The optimum of each interval, joined at the jumps from the future back."""
    plant = linear_plant(model)
    weights = as_weights(plant, R=R, Q_x=Q_x, Q_y=Q_y)
    if not np.any(weights.Q_y):
        raise RedesignError("Q_y must not be zero: the plan would be not to move, whatever the reference")
    weights, chain = weights.in_unit(), OutputChain.of(plant)
    intervals = plant.map(lambda system: ChainDriven.of(system, chain, optimum(TrackedSystem.of([system]), weights)))
    return PreviewLaw(METHOD, plant, chain, intervals, keeps_state=True)
