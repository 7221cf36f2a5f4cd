"""What less input and twist cost in motion given up: the redesign over its weights."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from two_disc.rig import Q_TWIST, Q_Y, SHOWN, SLEW, TOLERANCE, TWIST, TWIST_WEIGHT, R, slew

import invtrack
from invtrack.figures import trade_off_figure
from invtrack.studies import Column, Rows, Session, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

# q_x, and the values of q_y: with the twist free far less weight on the output gives up as much of the motion.
FAMILIES: dict[str, tuple[float, tuple[float, ...]]] = {
    "twist weighed (q_x = 5000)": (Q_TWIST, (0.01, 0.1, 0.3, Q_Y, 3.0, 10.0, 100.0)),
    "twist free (q_x = 0)": (0.0, (1e-6, 1e-5, 1e-4, 3e-4, 1e-3, 1e-2, 0.1)),
}
VERTICAL = {"peak_input": "peak input", "rms_input": "rms input", "peak_twist": "peak twist"}
COLUMNS = (
    Column("output change", "", "output_change"),
    *(Column(f"{text} / exact's", "", f"{figure}_share") for figure, text in VERTICAL.items()),
    Column("cost"),
    Column("dominated by another"),
)


def trade_off(model: invtrack.StateSpace) -> list[dict[str, Any]]:
    """One row per point: its weights, its figures, and these as shares of the slew and of exact inversion's."""
    profile, duration = SHOWN
    reference = slew(duration, profile)
    points = [{"r": R, "q_x": q_x, "q_y": q_y} for q_x, output_weights in FAMILIES.values() for q_y in output_weights]
    sweep = invtrack.redesign.pareto_sweep(
        model,
        reference,
        weights=[{"R": point["r"], "Q_x": point["q_x"] * TWIST_WEIGHT, "Q_y": point["q_y"]} for point in points],
        quantities={"twist": TWIST},
        exact=invtrack.invert(model, reference, tolerance=TOLERANCE),
        tolerance=TOLERANCE,
    )
    shares = {figure: sweep.shares(figure) for figure in VERTICAL}
    rows = []
    for i, (point, row) in enumerate(zip(points, sweep.rows, strict=True)):
        relative = {f"{figure}_share": float(values[i]) for figure, values in shares.items()}
        rows.append({**point, **row, "output_change": row["max_error"] / SLEW, **relative})
    return rows


def report_trade_off() -> Table:
    """The table; a point is dominated where another is no worse in any figure and better in one."""
    return Table(f"Trade-off over the weights (r = 1), {SHOWN[0]} of {SHOWN[1]:g} s", COLUMNS, _rows, row_header="weights")


def _rows(done: Session) -> Rows:
    return {
        f"q_x = {row['q_x']:g}, q_y = {row['q_y']:g}": {**row, "dominated_by_another": "yes" if row["dominated"] else "no"}
        for row in done.section("pareto")
    }


def draw_trade_off(rows: list[dict[str, Any]]) -> Figure:
    """Input and twist over the motion given up, one curve per family."""

    def curve(q_x: float, key: str) -> list[float]:
        return [row[key] if row["q_x"] == q_x else float("nan") for row in rows]

    return trade_off_figure(
        f"two_disc: input and twist against the motion given up, {SHOWN[0]} of {SHOWN[1]:g} s, q_y varied",
        horizontal=("largest change of the output [share of the slew]", [row["output_change"] for row in rows]),
        panels=[
            (f"{text}\n[share of exact's]", {name: curve(q_x, f"{figure}_share") for name, (q_x, _) in FAMILIES.items()})
            for figure, text in VERTICAL.items()
        ],
        notes=[f"the papers' weights: q_y = {Q_Y:g}" if (row["q_x"], row["q_y"]) == (Q_TWIST, Q_Y) else "" for row in rows],
        horizontal_log=True,
    )
