"""Whether runs track, by how much, and, where they do not, why."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from invtrack.plans.certificate import ACCURACY
from invtrack.report.page import Verdict
from invtrack.results import RunResult, max_error
from invtrack.studies.table import short_number

MOST = 0.5
"""A plan that itself misses by this share of the largest error, or more, is the reason for it."""


def motion(run: RunResult) -> float:
    """How far the output moves that moves farthest, 0 where none is to move."""
    wanted = run.reference.values
    return float(np.max(np.ptp(wanted, axis=0), initial=0.0)) if len(wanted) else 0.0


def share_missed(run: RunResult) -> float | None:
    """Largest error of any output as a share of what it is to move, or of the largest motion where it is to stay still."""
    moved = np.ptp(run.reference.values, axis=0)
    sizes = np.where(moved > 0, moved, motion(run))
    if run.status == "diverged" or not np.all(sizes > 0) or not np.all(np.isfinite(run.error)):
        return None
    return float(np.max(np.abs(run.error) / sizes))


def verdict(
    runs: Mapping[str, RunResult], error: float, *, reasons: Mapping[str, str], plans: Mapping[str, Mapping[str, Any]]
) -> Verdict:
    """Of one run or several.

    Args:
        runs: by case.
        error: share of the motion within which they are to track.
        reasons: of the cases of which there is no run, by name.
        plans: what plans say of themselves, by case, as far as it is known.
    """
    if not runs:
        said = "; ".join(f"{name}: {text}" for name, text in reasons.items())
        return Verdict(None, "No run was completed", said or "Nothing ran.")
    shares = {name: share_missed(run) for name, run in runs.items()}
    if len(runs) == 1:
        ((name, run),) = runs.items()
        return _single(run, shares[name], error, plans.get(name))
    known = {name: share for name, share in shares.items() if share is not None}
    if not known:
        return Verdict(None, "There is nothing to judge", "No run was completed whose reference moves.")
    within = [name for name, share in known.items() if share <= error]
    best, worst = (choose(known, key=lambda name: known[name]) for choose in (min, max))
    said = f"Best is {best}, which misses by {percent(known[best])} of the motion at most."
    if known[worst] > error:
        said += f" {worst} misses by {percent(known[worst])}: {why(runs[worst], plans.get(worst))}."
    good = True if len(within) == len(runs) else None if within else False
    return Verdict(good, f"{len(within)} of {len(runs)} cases track within {percent(error)}", said)


def _single(run: RunResult, share: float | None, error: float, plan: Mapping[str, Any] | None) -> Verdict:
    if run.status == "diverged":
        return Verdict(False, "The run diverged", f"{run.message}. A smaller timestep, other gains or less input may help.")
    if share is None:
        return Verdict(None, "There is nothing to follow", "The reference does not move, so that no error is a share of it.")
    unit = run.output.channels.units[0] if len(set(run.output.channels.units)) == 1 else ""
    amount, moved = (f"{short_number(value)} {unit}".strip() for value in (max_error(run), motion(run)))
    said = f"The largest error is {amount} in a motion of {moved}"
    if share <= error:
        return Verdict(True, f"Tracks within {percent(share)} of the motion", f"{said}; {percent(error)} would do.")
    head = f"Misses by {percent(share)} of the motion"
    return Verdict(False, head, f"{said}, where {percent(error)} would do: {why(run, plan)}.")


def why(run: RunResult, plan: Mapping[str, Any] | None) -> str:
    """What the run shows of the reason for a miss, the plainest sign first."""
    acting = [event for event in run.events if event.kind in ("limit", "contact")]
    if acting:
        return f"{acting[0].text.partition(',')[0]} acts from t = {acting[0].time:.3g} s"
    departed = run.planned_output.values - run.reference.values
    planned = float(np.max(np.abs(departed[np.isfinite(departed)]), initial=0.0))
    if planned > MOST * max_error(run):
        return "the plan itself gives up that much of the motion, by design or because it does not look ahead"
    if plan is not None and (plan["certificate"]["dynamics_residual"] or 0.0) > ACCURACY:
        return f"the plan, {plan['method']}, is no motion of the plant, and feedback alone makes up for it"
    changes = [event.text for event in run.events if event.kind == "parameter"]
    if changes:
        return f"the output departs from what was planned; on the way {changes[0]}"
    return "the output departs from what was planned, so the plant is not quite what the plan knows of it"


def percent(share: float) -> str:
    """A share as text."""
    value = 100 * share
    return f"{value:.3g} %" if value == 0 or value >= 1e-2 else f"{short_number(value)} %"
