"""What to do where exact inversion acts too early or not at all: the modified inverse, and the redesigned output, side by side."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import scipy  # loads scipy.optimize at its first use
from two_disc.rig import Q_TWIST, Q_Y, SLEW, TWIST_WEIGHT, R

import invtrack
from invtrack.figures import trade_off_figure
from invtrack.redesign import outcome
from invtrack.studies import Column, Rows, Session, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

NEAR_AXIS = 0.5  # [1/s]: zeros this close to the axis are moved
MOVED_TO = 2.0  # [1/s], the real part that the paper's helicopter gets
ERROR_POLES = {"slow": (-1.0, -2.0), "fast": (-4.0, -5.0)}  # [1/s], of the output's error
REAL_PARTS = (0.1, 0.25, 0.5, 1.0, 2.0, 4.0, 8.0)  # [1/s]
OUTPUT_WEIGHTS = (1.0, 10.0, 100.0, 1000.0, 1e4, 1e5)  # q_y of the redesign, with r = 1 and the twist free
NOTED_WEIGHT = 1e5  # the q_y whose points bear its name in the figure
TOLERANCE = 1e-8  # of the plans: at rest to within this share of each peak when they start
LEVEL = 0.01  # of the peak input, above which the input counts as preactuation

MODIFIED, REDESIGNED = "modified", "redesign"
COLUMNS = (Column("preactuation", "s"), Column("max error", "rad"), Column("peak input", "1"))


def modified(model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal, real_part: float) -> invtrack.Plan:
    """The modified inverse with the zeros near the axis at this real part [1/s], and the fast poles for the error."""
    return invtrack.modified_inversion(
        model, reference, axis_distance=NEAR_AXIS, real_part=real_part, error_poles=ERROR_POLES["fast"], tolerance=TOLERANCE
    )


def papers_redesign(model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal) -> invtrack.Plan:
    """With the weights of the redesign papers."""
    return invtrack.quadratic_redesign(model, reference, R=R, Q_x=Q_TWIST * TWIST_WEIGHT, Q_y=Q_Y, tolerance=TOLERANCE)


def redesign_with_error(
    model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal, error: float
) -> tuple[invtrack.Plan, float]:
    """The redesign (r = 1, twist free) whose largest error [rad] is the one stated, and its q_y."""

    def plan(exponent: float) -> invtrack.Plan:
        return invtrack.quadratic_redesign(model, reference, R=R, Q_y=10**exponent, tolerance=TOLERANCE)

    exponent = float(scipy.optimize.brentq(lambda e: np.log(outcome(plan(e)).max_error / error), 0.0, 3.0, xtol=1e-3))
    return plan(exponent), 10**exponent


def both_remedies(model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal) -> list[dict[str, Any]]:
    """One row per point of either remedy: what it is, its preactuation [s], largest error [rad] and peak input."""
    rows = [row for speed in ERROR_POLES for row in _modified_rows(model, reference, speed)]
    weights = [{"R": R, "Q_y": q_y} for q_y in OUTPUT_WEIGHTS]
    weights.append({"R": R, "Q_x": Q_TWIST * TWIST_WEIGHT, "Q_y": Q_Y})
    sweep = invtrack.redesign.pareto_sweep(model, reference, weights=weights, tolerance=TOLERANCE)
    for point, plan, result in zip(weights, sweep.plans, sweep.outcomes, strict=True):
        q_x, setting = (Q_TWIST, f"$q_x$ = {Q_TWIST:g}, ") if "Q_x" in point else (0.0, "")
        rows.append(
            {
                "remedy": f"{REDESIGNED}, papers' weights" if setting else REDESIGNED,
                "setting": f"{setting}$q_y$ = {point['Q_y']:g}",
                "q_x": q_x,
                "q_y": point["Q_y"],
                "preactuation": invtrack.results.preactuation_time(plan, level=LEVEL),
                "max_error": result.max_error,
                "peak_input": result.peak_input,
            }
        )
    return rows


def _modified_rows(model: invtrack.StateSpace, reference: invtrack.PiecewiseSignal, speed: str) -> list[dict[str, Any]]:
    """Preactuation against error over the real part that the zeros near the axis are given."""
    trade = invtrack.inversion.preactuation_trade_off(
        model,
        reference,
        axis_distance=NEAR_AXIS,
        real_parts=REAL_PARTS,
        error_poles=ERROR_POLES[speed],
        level=LEVEL,
        tolerance=TOLERANCE,
    )
    return [
        {
            "remedy": f"{MODIFIED}, {speed} error poles",
            "setting": f"{point.real_part:g} 1/s",
            "real_part": point.real_part,
            "error_poles": ERROR_POLES[speed],
            "preactuation": point.preactuation,
            "max_error": point.max_error * SLEW,  # it is a share of the motion
            "error_after": point.error_after * SLEW,
            "peak_input": point.peak_input,
        }
        for point in trade.points
    ]


def report_remedies() -> list[Table | str]:
    """The table of both remedies."""
    title = f"Passive rig, both remedies: time above {LEVEL:.0%} of the peak input before the slew, largest error, peak input"
    poles = "; ".join(f"{speed}: {', '.join(f'{pole:g}' for pole in values)} 1/s" for speed, values in ERROR_POLES.items())
    return [
        Table(title, COLUMNS, _rows, row_header="remedy"),
        f"modified: the real part that the zeros get; error poles {poles}. redesign: r = 1, q_x = 0 unless stated.",
    ]


def _rows(done: Session) -> Rows:
    return {f"{row['remedy']}, {row['setting'].replace('$', '')}": row for row in done.section("trade_off")}


def draw_remedies(title: str, rows: list[dict[str, Any]]) -> Figure:
    """Error and peak input over the preactuation, a curve for each remedy."""
    remedies = dict.fromkeys(row["remedy"] for row in rows)
    panels = [
        (label, {remedy: [row[key] if row["remedy"] == remedy else np.nan for row in rows] for remedy in remedies})
        for label, key in (("largest error [rad]", "max_error"), ("peak input", "peak_input"))
    ]
    return trade_off_figure(
        title,
        horizontal=(f"time before the slew above {LEVEL:.0%} of the peak input [s]", [row["preactuation"] for row in rows]),
        panels=panels,
        notes=[_note(row) for row in rows],
        horizontal_log=True,
        vertical_log=True,
    )


def _note(row: dict[str, Any]) -> str:
    """A short text for the one point of each curve that says how its setting reads."""
    if row.get("real_part") == MOVED_TO:
        # Written out on the upper curve alone, since there is room for it.
        return f"{'zeros ' if row['error_poles'] == ERROR_POLES['slow'] else ''}to {row['setting']}"
    return str(row["setting"]) if row.get("q_y") == NOTED_WEIGHT or row.get("q_x") else ""
