"""The feedback that all plans are driven with: one LQR, weighed by what is acceptable."""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.advice.program import Line, Name, rounded
from invtrack.advice.task import Task

SMALL = 1e-9
"""States that move by less than this share of the largest of their unit are not weighed."""


def weight_lines(task: Task) -> tuple[Line, ...]:
    """Q and R by Bryson's rule: the acceptable error costs as much as the input and the states that the whole motion takes.

    Outputs that the input reaches at once are weighed by their states alone, as everything is.
    """
    model = task.model
    x, u = task.sizes
    largest = float(np.max(x, initial=0.0))
    states = {name: float(size) for name, size in zip(model.states.names, x, strict=True) if size > SMALL * largest}
    options = {"states": states, "inputs": dict(zip(model.inputs.names, u.tolist(), strict=True))}
    if not any(np.any(system.D) for system in model.distinct) and len({system.C.tobytes() for system in model.distinct}) == 1:
        sizes = rounded(task.error * task.motion)
        options = {"outputs": dict(zip(model.outputs.names, sizes, strict=True)), **options}
    return (Line("Q, R", "invtrack.bryson", [Name("model")], options),)


def gain_line(subject: str) -> Line:
    """The gains for "plan", along its motion, or for "model"."""
    return Line("gains", "invtrack.lqr", [Name(subject)], {"Q": Name("Q"), "R": Name("R")})


def controller_line(options: dict[str, Any] | None = None) -> Line:
    """The controller around "plan" with "gains"."""
    return Line("controller", "invtrack.TrackingController", [Name("plan"), Name("gains")], options or {})
