"""The papers' redesign over a range of slew durations and two profiles, because the papers publish neither; free and limited."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from scipy.optimize import brentq
from two_disc.rig import (
    MARGIN,
    PROFILES,
    PUBLISHED,
    SHARES,
    SHOWN,
    TOLERANCE,
    WEIGHTS,
    Plans,
    clamped_steps,
    measured_shares,
    peak,
    run,
)

import invtrack
from invtrack.redesign import outcome
from invtrack.studies.progress import progress
from invtrack.studies.table import Column, print_table

DURATIONS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0)  # [s]
LIMIT = 0.8  # of the redesigned plan's peak input: what the actuator passes on in the limited case
COLUMNS = tuple(Column(f"{which} {share.replace('_', ' ')}") for share in SHARES for which in ("predicted", "measured"))
LIMITED_COLUMNS = (
    Column("limit", "1", "input_limit"),
    Column("peak input", "1"),
    Column("steps clamped", "", "clamped"),
    *(Column(share.replace("_", " ")) for share in SHARES),
)


def sweep(
    plant: invtrack.Plant, model: invtrack.StateSpace, gains: invtrack.GainSchedule, timestep: float
) -> tuple[list[dict[str, Any]], list[invtrack.RunResult]]:
    """Shares, predicted and measured, of each profile and duration, and the two runs of the slew that is shown.

    Under "limited": the same for the optimum within a limit on the input, driven through an actuator that has it.
    """
    rows: list[dict[str, Any]] = []
    shown: list[invtrack.RunResult] = []
    with progress("slews") as report:
        for profile in PROFILES:
            for duration in DURATIONS:
                plans = Plans.of(model, duration, profile)
                runs = [run(plant, invtrack.TrackingController(plan, gains), name, timestep) for name, plan in vars(plans).items()]
                rows.append(
                    {
                        "profile": profile,
                        "duration": duration,
                        "predicted": plans.shares(),
                        "measured": measured_shares(*runs),
                        "limited": _limited(plant, model, gains, plans, runs[0], timestep),
                    }
                )
                if (profile, duration) == SHOWN:
                    shown = runs
                report(len(rows) / (len(PROFILES) * len(DURATIONS)))
    return rows, shown


def _limited(
    plant: invtrack.Plant,
    model: invtrack.StateSpace,
    gains: invtrack.GainSchedule,
    plans: Plans,
    exact: invtrack.RunResult,
    timestep: float,
) -> dict[str, Any]:
    limit = LIMIT * outcome(plans.redesigned).peak_input
    plan = invtrack.constrained_redesign(
        model,
        plans.redesigned.reference,
        **WEIGHTS,
        limits=invtrack.Limits(input=(1 - MARGIN) * limit),
        tolerance=TOLERANCE,
    )
    actuated = invtrack.plant.with_input_limits(plant, {"motor": limit})
    result = run(actuated, invtrack.TrackingController(plan, gains), "redesigned_limited", timestep)
    return {
        "input_limit": limit,
        "predicted": plans.in_place_of_redesigned(plan).shares(),
        "measured": measured_shares(exact, result),
        "peak_input": peak(result.applied.values),
        "clamped": clamped_steps(result),
    }


def where_shares_occur(model: invtrack.StateSpace, published: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """For each published share: the quintic's duration [s] at which it occurs, and the other shares there, predicted."""

    def miss(share: str) -> Callable[[float], float]:
        return lambda duration: Plans.of(model, duration, "quintic").shares()[share] - published[share]

    result = {}
    for share in published:
        duration = float(brentq(miss(share), 10.0, 60.0, xtol=1e-2))
        result[share] = {"duration": duration, **Plans.of(model, duration, "quintic").shares()}
    return result


def report_sweep(rows: list[dict[str, Any]], occurs: dict[str, dict[str, float]]) -> None:
    """The table, and what the papers report beside it."""
    table = {
        f"{row['profile']}, {row['duration']:g} s": {
            f"{which}_{share}": row[which][share] for which in ("predicted", "measured") for share in SHARES
        }
        for row in rows
    }
    print_table("Two-disc rig: what redesign changes, as shares", columns=COLUMNS, rows=table, row_header="slew")
    limited = {f"{row['profile']}, {row['duration']:g} s": row["limited"] for row in rows}
    print_table(
        f"Within |u| <= {LIMIT:g} of the redesigned plan's peak, in MuJoCo",
        columns=LIMITED_COLUMNS,
        rows={name: {**row, **row["measured"]} for name, row in limited.items()},
        row_header="slew",
    )
    both = [*rows, *limited.values()]
    worst = max(abs(row["predicted"][share] - row["measured"][share]) for row in both for share in SHARES)
    print(f"largest difference of prediction and MuJoCo: {100 * worst:.3f} percentage points")
    print("the papers report, without profile and duration: 10 % of the slew, 60 % less input, 20 % less twist. For the quintic:")
    for share, there in occurs.items():
        print(
            f"  {share.replace('_', ' ')} of {PUBLISHED[share]:.0%} occurs at {there['duration']:.1f} s: output changed by "
            f"{there['output_change']:.1%}, input -{there['input_reduction']:.1%}, twist -{there['twist_reduction']:.1%}"
        )
    print()
