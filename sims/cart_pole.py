"""A cart with a pole that stands on it moves by half a metre to forty metres in 2 s, in MuJoCo: where the linear inverse ends.

The position of the cart is nonminimum phase: to arrive without a swing of the pole, the force has to act before the cart moves. The
linear inverse knows the pole only upright. The inverse of the motion itself (`invert(plant, reference)`; S. Devasia, D. Chen,
B. Paden, "Nonlinear inversion-based output tracking", IEEE Trans. Automatic Control 41(7), 1996) follows it wherever it leans, and
is fed back by gains that follow it too. Both, and feedback alone, move the cart by 3 m; then both move it by ever more.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any

import numpy as np
import tyro
from motions.ways import COLUMNS, Motion

import invtrack
from invtrack.figures import comparison_figure, sweep_figure, tracking_figure
from invtrack.studies import Column, Rows, Session, Setup, Study, StudyOptions, Table

DISTANCE, DURATION = 3.0, 2.0  # [m], [s]
AMPLITUDES = (0.5, 1.0, 3.0, 6.0, 10.0, 20.0, 40.0)  # [m]

SWEPT = (
    Column("pole leans by", "deg", key="lean"),
    Column("inverse", "of motion"),
    Column("linear inverse", "of motion"),
    Column("peak force", "N"),
    Column("gains along", "times", key="gains_along"),
    Column("gains of the start", "times", key="gains_of_the_start"),
)


@dataclass(frozen=True, kw_only=True)
class CartPoleOptions(StudyOptions):
    """Options of the study."""

    amplitude: Annotated[tuple[float, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="M")] = ()
    """Move the cart by this many metres in the sweep; may be given several times. All of them unless given."""


def build(options: CartPoleOptions) -> Setup:
    plant = invtrack.Plant.from_xml(invtrack.model_path("cart_pole"), inputs=["force"], outputs=["joint:cart"])
    amplitudes = options.amplitude or AMPLITUDES
    cases = _motion(plant, DISTANCE).cases(options.timestep)
    return Setup(
        cases,
        sweeps={"amplitudes": {f"{amplitude:g} m": partial(_swept, plant, amplitude) for amplitude in amplitudes}},
        figures={
            "comparison": lambda done: comparison_figure(done.among(), window=(-2.0, 5.0)),
            "tracking": lambda done: tracking_figure(done["inverse"], window=(-2.0, 4.0)),
            "amplitudes": _figure,
        },
        report=[
            Table(f"Cart-pole, {DISTANCE:g} m in {DURATION:g} s", COLUMNS),
            Table(f"Further in {DURATION:g} s: largest error, and growth of departures on the way", SWEPT, _rows, "distance"),
            "The linear inverse is driven with the gains of the start, the inverse of the motion with those along it.\n"
            "A dash stands for a run that diverged.",
        ],
    )


def _motion(plant: invtrack.Plant, distance: float) -> Motion:
    return Motion("", plant, invtrack.rest_to_rest(0.0, distance, duration=DURATION), Q=1.0, R=1.0)


def _swept(plant: invtrack.Plant, distance: float, done: Session) -> dict[str, Any]:
    """Both inverses driven over a distance [m]; None for a run that diverged."""
    motion = _motion(plant, distance)
    controllers = {"inverse": motion.inverse(), "linear_inverse": motion.linear_inverse()}
    row: dict[str, Any] = {"distance": distance}
    for way, controller in controllers.items():
        run = done.tried(plant, controller, name=f"{distance:g}_m_{way}")
        numbers = motion.numbers(run, controller) if run.status == "completed" else None
        row[way] = None if numbers is None else numbers["error_share"]
        if way == "inverse" and numbers is not None:
            row |= {
                "lean": float(np.degrees(np.max(np.abs(run.state["pole"])))),
                "peak_force": float(np.max(np.abs(run.applied.values))),
                "gains_along": numbers["amplification"],
                "gains_of_the_start": numbers["amplification_of_frozen_gains"],
            }
    return row


def _rows(done: Session) -> Rows:
    return {f"{row['distance']:g} m": row for row in done.section("amplitudes")}


def _figure(done: Session) -> Any:
    rows = done.section("amplitudes")
    ways = {"inverse of the motion": "inverse", "linear inverse": "linear_inverse"}
    errors = {label: [np.nan if row[way] is None else row[way] for row in rows] for label, way in ways.items()}
    return sweep_figure(
        "cart-pole: how far the inverses reach in 2 s",
        label="distance [m]",
        values=[row["distance"] for row in rows],
        predicted={},
        measured=errors,
        quantity="largest error [share of the distance]",
        logarithmic=True,
    )


STUDY = Study("cart_pole", build, description=__doc__, defaults=CartPoleOptions())

if __name__ == "__main__":
    STUDY.main()
