"""The papers' redesign over a range of slew durations and two profiles, because the papers publish neither; free and limited."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import scipy  # loads scipy.optimize at its first use
from two_disc.rig import (
    MARGIN,
    PROFILES,
    PUBLISHED,
    SHARES,
    TOLERANCE,
    WEIGHTS,
    Plans,
    clamped_steps,
    measured_shares,
    peak,
    run_settings,
)

import invtrack
from invtrack.redesign import outcome
from invtrack.studies import Column, Rows, Session, Table

DURATIONS = (5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 60.0)  # [s]
LIMIT = 0.8  # of the redesigned plan's peak input: what the actuator passes on in the limited case
COLUMNS = tuple(Column(f"{which} {share.replace('_', ' ')}") for share in SHARES for which in ("predicted", "measured"))
LIMITED_COLUMNS = (
    Column("limit", "1", "input_limit"),
    Column("peak input", "1"),
    Column("steps clamped", "", "clamped"),
    *(Column(share.replace("_", " ")) for share in SHARES),
)


def slews(
    plant: invtrack.Plant, model: invtrack.StateSpace, gains: invtrack.GainSchedule
) -> dict[str, Callable[[Session], dict[str, Any]]]:
    """By name of the slew: its shares, predicted and measured.

    Under "limited": the same for the optimum within a limit on the input, driven through an actuator that has it.
    """

    def point(profile: str, duration: float, done: Session) -> dict[str, Any]:
        plans = Plans.of(model, duration, profile)
        exact, redesigned = (
            done.simulate(plant, invtrack.TrackingController(plan, gains), name=name, **run_settings(plan))
            for name, plan in vars(plans).items()
        )
        return {
            "profile": profile,
            "duration": duration,
            "predicted": plans.shares(),
            "measured": measured_shares(exact, redesigned),
            "limited": _limited(plant, model, gains, plans, exact, done),
        }

    return {f"{profile}, {duration:g} s": partial(point, profile, duration) for profile in PROFILES for duration in DURATIONS}


def _limited(
    plant: invtrack.Plant,
    model: invtrack.StateSpace,
    gains: invtrack.GainSchedule,
    plans: Plans,
    exact: invtrack.RunResult,
    done: Session,
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
    controller = invtrack.TrackingController(plan, gains)
    result = done.simulate(actuated, controller, name="redesigned_limited", **run_settings(plan))
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
        duration = float(scipy.optimize.brentq(miss(share), 10.0, 60.0, xtol=1e-2))
        result[share] = {"duration": duration, **Plans.of(model, duration, "quintic").shares()}
    return result


def report_slews() -> list[Table | Callable[[Session], str]]:
    """The tables, and what the papers report beside them."""
    limited = f"Within |u| <= {LIMIT:g} of the redesigned plan's peak, in MuJoCo"
    return [
        Table("Two-disc rig: what redesign changes, as shares", COLUMNS, _rows, row_header="slew"),
        Table(limited, LIMITED_COLUMNS, _limited_rows, row_header="slew"),
        _difference,
        _occurrences,
    ]


def _named(done: Session) -> dict[str, dict[str, Any]]:
    return {f"{row['profile']}, {row['duration']:g} s": row for row in done.section("durations")}


def _rows(done: Session) -> Rows:
    return {
        name: {f"{which}_{share}": row[which][share] for which in ("predicted", "measured") for share in SHARES}
        for name, row in _named(done).items()
    }


def _limited_rows(done: Session) -> Rows:
    return {name: {**row["limited"], **row["limited"]["measured"]} for name, row in _named(done).items()}


def _difference(done: Session) -> str:
    both = [each for row in done.section("durations") for each in (row, row["limited"])]
    worst = max(abs(row["predicted"][share] - row["measured"][share]) for row in both for share in SHARES)
    return f"largest difference of prediction and MuJoCo: {100 * worst:.3f} percentage points"


def _occurrences(done: Session) -> str:
    lines = [
        "the papers report, without profile and duration: 10 % of the slew, 60 % less input, 20 % less twist. For the quintic:"
    ]
    for share, there in done.section("published_at").items():
        lines.append(
            f"  {share.replace('_', ' ')} of {PUBLISHED[share]:.0%} occurs at {there['duration']:.1f} s: output changed by "
            f"{there['output_change']:.1%}, input -{there['input_reduction']:.1%}, twist -{there['twist_reduction']:.1%}"
        )
    return "\n".join([*lines, ""])
