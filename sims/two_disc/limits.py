"""A slew that asks for more than the motor has: the optimum within hard limits, driven through an actuator that has them.

The limited rate makes the twist's limit one of third order. Such a limit is touched at single instants before and after it is
followed, and there the input falls for short times as fast as it may (H. M. Robbins, "Junction phenomena for optimal control with
state-variable inequality constraints of third order", J. Optimization Theory and Applications 31(1), 1980). Smaller steps find the
same arcs at the same times.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from two_disc.experiment import DRAWN, controller, real_rig
from two_disc.rig import MARGIN, TOLERANCE, TWIST, clamped_steps, peak, run_settings, slew, twist

import invtrack
from invtrack.figures import overlay_figure, tracking_figure
from invtrack.redesign import ConstrainedTrajectory, outcome
from invtrack.studies import Case, Column, Rows, Session, Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PROFILE, DURATION = "quintic", 10.0  # [s]
WEIGHTS = {"R": 1.0, "Q_y": 10.0}  # the twist has no weight: it has a limit
INPUT, RATE, TWIST_LIMIT = 0.045, 0.05, 0.02  # [1], [1/s], [rad]; exact inversion needs 0.076, 0.22 and 0.023
WINDOW = (-10.0, 20.0)  # [s]
COLUMNS = (
    Column("output change", "rad", "max_error"),
    Column("peak input", "1"),
    Column("peak rate", "1/s"),
    Column("peak twist", "rad"),
    Column("steps clamped", "", "clamped"),
)


@dataclass(frozen=True)
class LimitedSlew:
    """Plans of the same slew, and the cases that drive them through the limited actuator."""

    plans: dict[str, invtrack.Plan]
    cases: list[Case]
    limited: ConstrainedTrajectory

    def summary(self, done: Session) -> dict[str, Any]:
        """Limits, when each is active, and what was planned and measured."""
        return {
            "profile": PROFILE,
            "duration": DURATION,
            "weights": WEIGHTS,
            "limits": {"input": INPUT, "input_rate": RATE, "twist": TWIST_LIMIT},
            "margin": MARGIN,
            "active": [
                {
                    "name": each.name,
                    "side": each.side,
                    "limit": each.limit,
                    "seconds": each.duration,
                    "intervals": [(stretch.start, stretch.end) for stretch in each.stretches],
                    "cost_saved_per_unit": each.multiplier,
                }
                for each in self.limited.active
            ],
            "planned": {name: _planned(plan) for name, plan in self.plans.items()},
            "measured": {run.name: _measured(run) for run in done.among(case.name for case in self.cases)},
        }


def limited_slew(plant: invtrack.Plant, model: invtrack.StateSpace, gains: invtrack.GainSchedule, seed: int) -> LimitedSlew:
    """Exact inversion, the optimum without and with limits; the first and the last driven through the limited actuator.

    That the exact plan exceeds the actuator is the point, and so does what noise adds to the limited one.
    """
    reference = slew(DURATION, PROFILE)
    inside = 1 - MARGIN
    limited = invtrack.constrained_redesign(
        model,
        reference,
        **WEIGHTS,
        limits=invtrack.Limits(
            input=inside * INPUT,
            input_rate=inside * RATE,
            states=[invtrack.StateLimit("twist", dict(zip(model.states.names, TWIST.tolist(), strict=True)), inside * TWIST_LIMIT)],
        ),
        tolerance=TOLERANCE,
    )
    exact = invtrack.invert(model, reference, tolerance=TOLERANCE)
    plans = {
        "exact": exact,
        "redesigned": invtrack.quadratic_redesign(model, reference, **WEIGHTS, tolerance=TOLERANCE),
        "redesigned_limited": limited,
    }
    actuated = invtrack.plant.with_input_limits(plant, {"motor": INPUT})
    drawn = {"tracking": tracking_figure}

    def case(name: str, plan: invtrack.Plan) -> Case:
        return Case(name, actuated, invtrack.TrackingController(plan, gains), settings=run_settings(plan), figures=drawn)

    real, settings = real_rig(actuated, DRAWN, limited, seed)
    cases = [
        case("redesigned_limited", limited),
        case("exact_clamped", exact),
        Case("experiment_limited", real, controller(model, limited), settings=settings, figures=drawn),
    ]
    return LimitedSlew(plans, cases, limited)


def _planned(plan: invtrack.Plan) -> dict[str, float]:
    figures = outcome(plan, {"twist": TWIST}).figures
    times = np.linspace(plan.start, plan.end, 100_001)
    return {**figures, "peak_rate": peak(np.diff(plan.inputs(times), axis=0)) / float(times[1] - times[0])}


def _measured(result: invtrack.RunResult) -> dict[str, float | int | None]:
    """Peaks of what the actuator passed on, and at how many steps it clamped what was commanded.

    A controller with a period moves the input in jumps, which have no rate.
    """
    sampled = len(result.measured.channels) > 0
    middle = (result.time[:-1] + result.time[1:]) / 2
    applied = result.applied.values
    return {
        "max_error": invtrack.max_error(result),
        "peak_input": peak(applied),
        "peak_rate": None if sampled else peak(np.diff(applied, axis=0) / np.diff(middle)[:, None]),
        "peak_twist": peak(twist(result.state.values)),
        "clamped": clamped_steps(result),
        "steps": len(applied),
        "plan_error": invtrack.max_error(result, wanted="planned_output"),
    }


def report_limits(slew_: LimitedSlew) -> list[Table | str | Callable[[Session], str]]:
    """The table, and which limit acts when."""
    title = f"Hard limits, {PROFILE} of {DURATION:g} s, r = 1, q_x = 0, q_y = 10"
    return [Table(title, COLUMNS, _rows), "\n".join(f"  {each}" for each in slew_.limited.active), _text]


def _rows(done: Session) -> Rows:
    summary = done.section("limits")
    table: dict[str, dict[str, Any]] = {f"{name}, planned": {**row, "clamped": None} for name, row in summary["planned"].items()}
    table |= {f"{name}, MuJoCo": row for name, row in summary["measured"].items()}
    table["limit"] = {"max_error": None, "peak_input": INPUT, "peak_rate": RATE, "peak_twist": TWIST_LIMIT, "clamped": None}
    return table


def _text(done: Session) -> str:
    measured = done.section("limits")["measured"][done["redesigned_limited"].name]
    return (
        f"planned {MARGIN:g} inside the limits. In MuJoCo the actuator's ctrlrange of +-{INPUT:g} clamps {measured['clamped']} of "
        f"{measured['steps']} steps.\n"
        "The short arcs at the rate's and the twist's limits are the optimum's own: smaller steps of the plan find the same.\n"
    )


def draw_limits(slew_: LimitedSlew) -> Figure:
    """What is given up of the output, input and twist, with their limits."""
    times = np.linspace(*WINDOW, 6001)
    values = {name.replace("_", " "): plan(times) for name, plan in slew_.plans.items()}
    motor, shaft = "motor command", r"$\theta_1 - \theta_2$ [rad]"
    panels = [
        (r"$\theta_2$ - wanted [rad]", {name: (times, (at.y - at.y_d)[:, 0]) for name, at in values.items()}),
        (motor, {name: (times, at.u[:, 0]) for name, at in values.items()}),
        (shaft, {name: (times, twist(at.x)) for name, at in values.items()}),
    ]
    limits = {motor: (-INPUT, INPUT), shaft: (-TWIST_LIMIT, TWIST_LIMIT)}
    title = f"two_disc: {PROFILE} of {DURATION:g} s within limits on input, its rate ({RATE:g} 1/s) and twist"
    manoeuvre = next(iter(slew_.plans.values())).manoeuvre
    return overlay_figure(title, panels=panels, window=WINDOW, limits=limits, manoeuvre=manoeuvre)
