"""Calls of modified inversion for a Plant: what they may ask for, and plans for one problem and many wishes."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from numpy.typing import ArrayLike

from invtrack.errors import InversionError
from invtrack.inversion.modified.modified_motion import ModifiedMotion, modified_motion
from invtrack.inversion.modified.moved_zeros import Wish
from invtrack.inversion.motion_options import checked_motion_options
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.plans.dynamics import Mechanism, ScheduledChange
from invtrack.references.signal import PiecewiseSignal

LEAST_ERROR = "least error"
"""The design that a Plant's bend always is of."""


def motion_planner(
    mechanism: Mechanism,
    reference: PiecewiseSignal,
    *,
    error_poles: Sequence[complex] | None = None,
    interval: int | Sequence[int] | None = None,
    design: str = LEAST_ERROR,
    output_scale: ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
    schedule: Sequence[ScheduledChange] = (),
    accuracy: float = 1e-8,
    progress: Callable[[float], None] | None = None,
) -> tuple[MotionProblem, Callable[[Wish], ModifiedMotion]]:
    """The problem, and its plan as a function of the zeros that are moved; arguments are those of `modified_inversion`.

    Raises InversionError for options of the linear law, and what `invtrack.invert` raises of the same plant and reference.
    """
    for name, given, reason in (
        ("error_poles", error_poles, "its outputs are bent, not driven by a law whose errors have poles"),
        ("interval", interval, "outputs are bent around its whole motion, through changes of its parameters"),
        ("design", None if design == LEAST_ERROR else design, "of all bends the least one is taken"),
    ):
        if given is not None:
            raise InversionError(f"{name} is for linear models; a Plant is planned for as it moves, and {reason}: leave {name} out")
    changes = checked_motion_options(schedule, accuracy, progress)
    problem = MotionProblem.of(mechanism, reference, changes)

    def plan(wish: Wish) -> ModifiedMotion:
        return modified_motion(
            problem,
            wish,
            output_scale=output_scale,
            accuracy=accuracy,
            tolerance=tolerance,
            max_preactuation=max_preactuation,
            max_postactuation=max_postactuation,
            progress=progress,
        )

    return problem, plan
