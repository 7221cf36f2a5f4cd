"""Options of methods that plan on the nonlinear motion of a Plant, in calls that may be for linear models, too."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from invtrack.arguments import items
from invtrack.arrays import real_number, shown
from invtrack.errors import InvtrackError, PlanError
from invtrack.plans.dynamics import ScheduledChange


def checked_motion_options(
    schedule: Sequence[ScheduledChange],
    accuracy: float,
    progress: Callable[[float], None] | None = None,
    *,
    error: type[InvtrackError] = PlanError,
) -> list[ScheduledChange]:
    """The schedule as a list. Raises `error` for what is none, and for the other options where they are out of range."""
    changes = items("schedule", schedule, expected="a list of changes, such as [invtrack.Change(1.0, mass=2.0)]", error=error)
    if not 0 < real_number("accuracy", accuracy, error=error) < 1:
        raise error(f"accuracy must lie between 0 and 1, a share of the motion, got {accuracy}")
    if progress is not None and not callable(progress):
        raise error(f"progress must be a function of the share that is done, got {shown(progress)}")
    return changes


def require_no_schedule(schedule: Sequence[ScheduledChange]) -> None:
    """Raises PlanError where a call for a linear model has a schedule."""
    if schedule:
        raise PlanError(
            "schedule is for a Plant, which is planned for as it moves; a linear model that switches is a SwitchedSystem"
        )
