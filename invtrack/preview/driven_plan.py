"""All that a planner drives for a reference whose future it gets to know update by update, as one plan."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import PlanError, TrajectoryError
from invtrack.plans.plan import Plan
from invtrack.plans.problem import AT_REST, PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import drive_units
from invtrack.plans.two_sided_problem import Pieces, two_sided_trajectory
from invtrack.preview.law import PreviewLaw
from invtrack.preview.plan_piece import PlanPiece
from invtrack.preview.planner import Foreseen, PreviewPlanner, positive_time
from invtrack.references.generator import constant_generator
from invtrack.references.signal import PiecewiseSignal

MOST_UPDATES = 10**6
"""Updates of a plan, at most."""


def driven_plan(
    law: PreviewLaw,
    reference: PiecewiseSignal,
    *,
    preview: float,
    period: float,
    tolerance: float,
    max_postactuation: float | None,
) -> Plan:
    """The plan of a law for a reference that becomes known `preview` [s] ahead.

    Args:
        law: what is planned.
        reference: absolute, held still before and after the manoeuvre.
        preview, period: see PreviewPlanner.
        tolerance, max_postactuation: see PlanningProblem.
    """
    preview, period = positive_time("preview", preview), positive_time("period", period)
    problem = PlanningProblem.of(law.plant, reference, tolerance=tolerance, max_postactuation=max_postactuation)
    _require_held(reference)
    (T_i, T_f), held = problem.manoeuvre, reference(reference.breakpoints[0], inside=reference.breakpoints[0] - 1.0)
    planner = PreviewPlanner(law, preview=preview, period=period, start=T_i - preview, held=held)
    updates = math.ceil((T_f - planner.time) / period)
    if updates > MOST_UPDATES:
        raise PlanError(f"expected at most {MOST_UPDATES} updates, the manoeuvre takes {updates}; take a longer period")
    before = planner.foreseen
    pieces = [planner.update(reference) for _ in range(max(updates, 1))]
    trajectory = _trajectory(law, pieces, held, before, planner.foreseen)
    remark = f"made of {len(pieces)} updates, {period:g} s apart, each of which knew the reference {preview:g} s ahead"
    return problem.plan(law.method, trajectory, exact=False if law.keeps_state else None, remarks=(remark,))


def _require_held(reference: PiecewiseSignal) -> None:
    """Raises TrajectoryError for a reference that goes on moving before its first or after its last breakpoint."""
    for place, when in ((0, "before"), (-1, "after")):
        generator = reference.generators[reference.kind[place]]
        w = reference.anchors[place, : len(generator.S)]
        if np.any(np.abs(generator.S @ w) > AT_REST * np.abs(generator.S) @ np.abs(w)):
            raise TrajectoryError(
                f"the reference goes on moving {when} its first and last breakpoint {reference.manoeuvre}, for ever, so that what "
                "a planner drives has no end; hold it still there, or drive a planner update by update"
            )


def _trajectory(law: PreviewLaw, pieces: list[PlanPiece], held: Array, before: Foreseen, after: Foreseen) -> Trajectory:
    """The pieces one after the other, with the tails before and after them.

    Args:
        law: what was planned.
        pieces: at least one.
        held: outputs (p,) before.
        before, after: what the planner foresaw for the first piece, and what it foresees after the last one.
    """
    stretches = [stretch for piece in pieces for stretch in piece.stretches]
    states = [pair for piece in pieces for pair in piece.own_states()]
    still = constant_generator(law.plant.n_outputs)
    intervals = [before.interval, *(stretch.interval for stretch in stretches), after.interval]
    keys = list(zip(intervals, [still, *(stretch.generator for stretch in stretches), still], strict=True))
    number = {key: index for index, key in enumerate(dict.fromkeys(keys))}
    driven = [law.intervals[k].driven_by(generator) for k, generator in number]
    units = drive_units(driven)
    systems = {id(each.system): each.system.in_units(*units) for each in driven}
    first, last = (law.intervals[ahead.interval] for ahead in (before, after))
    y_first, y_last = held - first.plant.operating_point.y0, stretches[-1].zeta[law.chain.values] - last.plant.operating_point.y0
    first_b = before.phi + first.Pi_b @ law.chain.at_rest(y_first)
    last_f = after.z_f + last.Pi_f @ law.chain.at_rest(y_last)
    pieces_of_time = Pieces(
        breakpoints=np.array([stretches[0].start, *(stretch.end for stretch in stretches)]),
        driven=[each.in_units(*units, systems[id(each.system)]) for each in driven],
        which=np.array([number[key] for key in keys]),
        w_start=_padded([y_first, *(stretch.w_start for stretch in stretches), y_last]),
        w_end=_padded([y_first, *(stretch.w_end for stretch in stretches), y_last]),
    )
    z_f, z_b = (_padded([pair[part] for pair in states]) / unit for part, unit in enumerate(units))
    return two_sided_trajectory(pieces_of_time, z_f, z_b, first_b / units[1], last_f / units[0])


def _padded(rows: Sequence[Array]) -> Array:
    """Rows of different lengths as one array, shorter ones with zeros after them."""
    result = np.zeros((len(rows), max(map(len, rows))))
    for row, values in zip(result, rows, strict=True):
        row[: len(values)] = values
    return result
