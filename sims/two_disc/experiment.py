"""The papers' experiment, as far as MuJoCo can stand in for it: a rig that is not the identified one, seen through potentiometers.

Disc inertias, shaft stiffness and velocity coupling differ by some per cent from what the plans assume. The controller acts every
20 ms and measures the two angles, with noise and in digits; a Kalman filter estimates the state from them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from two_disc.rig import MEASUREMENTS, PUBLISHED, SHARES, SHOWN, Plans, measured_shares, peak, run_settings, twist

import invtrack
from invtrack.figures import tracking_figure
from invtrack.studies import Case, Column, Rows, Session, Table

PERIOD = 0.02  # [s]
NOISE = 1e-3  # [rad], standard deviation of one sample
DIGIT = 2 * np.pi / 4096  # [rad]: twelve bits to the turn
INPUT_NOISE = 1e-3  # [1 per root Hz], the disturbance that the Kalman filter expects
GAIN_WEIGHTS = {"Q": 1.0, "R": 100.0}  # softer than with the state known: feedback passes the sensors' noise on to the motor
AFTER = 15.0  # [s] simulated after the slew
TOLERANCE = 1e-4  # of the plans: the noise hides an earlier start
PUBLISHED_IN_EXPERIMENT = {**PUBLISHED, "twist_reduction": 0.50}
COLUMNS = (
    *(Column(share.replace("_", " ")) for share in SHARES),
    Column("peak input, exact", "1", "exact_peak_input"),
    Column("peak input, redesigned", "1", "redesigned_peak_input"),
    Column("input noise", "1", "redesigned_input_noise"),
    Column("tracking of plan", "rad", "redesigned_plan_error"),
)


@dataclass(frozen=True)
class Rig:
    """A rig as shares of the identified one, the seed of its sensors' noise, and the duration [s] of its slew."""

    disc1_inertia: float
    disc2_inertia: float
    stiffness: float
    coupling: float
    seed: int
    duration: float = SHOWN[1]


RIGS = {
    "as identified": Rig(1.0, 1.0, 1.0, 1.0, 1),
    "as identified, other noise": Rig(1.0, 1.0, 1.0, 1.0, 2),
    "softer shaft": Rig(1.03, 0.97, 0.95, 1.10, 3),
    "stiffer shaft": Rig(0.97, 1.03, 1.05, 0.90, 4),
    "heavier discs": Rig(1.05, 1.05, 0.97, 1.20, 5),
    "softer shaft, in 20 s": Rig(1.03, 0.97, 0.95, 1.10, 6, duration=20.0),
}
DRAWN = "softer shaft"


def experiment(plant: invtrack.Plant, model: invtrack.StateSpace, seed: int) -> dict[str, Callable[[Session], dict[str, Any]]]:
    """By name of the rig: what it measures."""

    def point(name: str, done: Session) -> dict[str, Any]:
        plans, runs = Plans.of(model, RIGS[name].duration, SHOWN[0], tolerance=TOLERANCE), {}
        for which, plan in vars(plans).items():
            mechanism, settings = real_rig(plant, name, plan, seed)
            runs[which] = done.simulate(mechanism, controller(model, plan), name=f"experiment_{which}", **settings)
        return _row(name, plans, runs)

    return {name: partial(point, name) for name in RIGS}


def experiment_cases(plant: invtrack.Plant, model: invtrack.StateSpace, seed: int) -> list[Case]:
    """The two runs that are drawn and recorded."""
    plans = Plans.of(model, RIGS[DRAWN].duration, SHOWN[0], tolerance=TOLERANCE)
    cases = []
    for which, plan in vars(plans).items():
        mechanism, settings = real_rig(plant, DRAWN, plan, seed)
        cases.append(
            Case(
                f"experiment_{which}",
                mechanism,
                controller(model, plan),
                settings=settings,
                figures={"tracking": tracking_figure},
            )
        )
    return cases


def controller(model: invtrack.StateSpace, plan: invtrack.Plan) -> invtrack.OutputFeedbackController:
    """What knows the identified rig and sees two angles."""
    observer = invtrack.KalmanFilter(INPUT_NOISE, measurement_noise=np.hypot(NOISE, DIGIT / np.sqrt(12)))
    return invtrack.OutputFeedbackController(plan, invtrack.lqr(model, **GAIN_WEIGHTS), observer, period=PERIOD)


def real_rig(plant: invtrack.Plant, name: str, plan: invtrack.Plan, seed: int) -> tuple[invtrack.Plant, dict[str, Any]]:
    """A rig as it really is, seen through its potentiometers, and the arguments of a simulation of it; seed: 0, 1, ..."""
    real = RIGS[name]
    values = plant.parameter_values
    values["disc1_mass"] *= real.disc1_inertia
    values["disc2_mass"] *= real.disc2_inertia
    values["shaft_stiffness"] *= real.stiffness
    mechanism = invtrack.plant.with_coupling_scaled(plant, "velocity_coupling", real.coupling)
    return mechanism, {
        **run_settings(plan, after=AFTER),
        "vibration_period": invtrack.linear.slowest_flexible_period(invtrack.linearize(mechanism, **values)),
        "schedule": [invtrack.Change(plan.start, **values)],
        "sensors": {sensor: invtrack.Sensor(noise=NOISE, quantization=DIGIT) for sensor in MEASUREMENTS},
        "seed": real.seed + len(RIGS) * seed,
    }


def _row(name: str, plans: Plans, runs: dict[str, invtrack.RunResult]) -> dict[str, Any]:
    return {
        "name": name,
        "rig": vars(RIGS[name]),
        "predicted": plans.shares(),
        "measured": measured_shares(runs["exact"], runs["redesigned"]),
        "exact": _numbers(plans.exact, runs["exact"]),
        "redesigned": _numbers(plans.redesigned, runs["redesigned"]),
    }


def _numbers(plan: invtrack.Plan, result: invtrack.RunResult) -> dict[str, float]:
    """Peaks, planned and measured, and what noise and the wrong model leave: in the input, and beside the planned output."""
    middle = (result.time[:-1] + result.time[1:]) / 2
    planned = plan(middle)
    return {
        "planned_peak_input": peak(planned.u),
        "peak_input": peak(result.applied.values),
        "input_noise": float(np.std(result.applied.values - planned.u)),
        "planned_peak_twist": peak(twist(planned.x)),
        "peak_twist": peak(twist(result.state.values)),
        "plan_error": peak(result.output.values - result.planned_output.values),
    }


def report_experiment() -> list[Table | Callable[[Session], str]]:
    """The table beside the papers' numbers, and the duration at which the theory predicts their twist."""
    title = f"Experiment, {SHOWN[0]} of {SHOWN[1]:g} s unless stated: rigs unlike their model, two noisy angles"
    return [Table(title, COLUMNS, _rows, row_header="rig"), _text]


def _rows(done: Session) -> Rows:
    table: dict[str, dict[str, Any]] = {}
    rows = done.section("experiment")
    for row in rows:
        both = {f"{which}_{key}": value for which in ("exact", "redesigned") for key, value in row[which].items()}
        table[row["name"]] = {**row["measured"], **both}
    blank = {column.key: None for column in COLUMNS}
    for row in {row["rig"]["duration"]: row for row in reversed(rows)}.values():
        planned = {f"{which}_peak_input": row[which]["planned_peak_input"] for which in ("exact", "redesigned")}
        table[f"planned, {row['rig']['duration']:g} s"] = {**blank, **row["predicted"], **planned}
    table["papers' experiment"] = {**blank, **PUBLISHED_IN_EXPERIMENT}
    return table


def _text(done: Session) -> str:
    occurs = done.section("published_in_experiment_at")["twist_reduction"]
    return (
        f"control every {PERIOD:g} s from angles with noise of {NOISE:g} rad and digits of {DIGIT:.2g} rad; input noise: standard\n"
        "deviation of the input about the plan's. The papers say no more of their experiment than its twist;\n"
        f"a twist of {-PUBLISHED_IN_EXPERIMENT['twist_reduction']:.0%} is what the theory predicts for a quintic of "
        f"{occurs['duration']:.1f} s, with the output changed by {occurs['output_change']:.1%}\n"
        f"and the input by {-occurs['input_reduction']:.1%}.\n"
    )
