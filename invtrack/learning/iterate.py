"""Run after run until nothing is left to learn; rehearsed, where a rehearsal is given, before anything is driven."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, real_number, shown, whole_number
from invtrack.errors import LearningError
from invtrack.learning.learning import Learning, LearningStep, Planner
from invtrack.plans.plan import Plan
from invtrack.references.signal import PiecewiseSignal
from invtrack.results.result import RunResult

Drive = Callable[[Plan], RunResult]
"""Drives a mechanism along a plan, as `lambda plan: invtrack.simulate(plant, invtrack.TrackingController(plan, K))`."""

REHEARSED = 4
"""Runs of a rehearsal."""

SETTLED = 1e-3
"""Share of the first run's error below which a rehearsal has shown what it is to show."""

MOST_RUNS = 10_000
"""More than this are a mistake: all of them are kept."""

STALLED = 0.9
"""An error of which each of two runs leaves more than this share has stopped shrinking; one run alone may do so on the way."""


@dataclass(frozen=True, eq=False)
class Learned:
    """What `iterate` found.

    Args:
        steps: the runs, in their order.
        best: the one with the least error within the band; its plan is the one to keep.
        predicted: contraction of each run after the first in the rehearsal (k,); empty without one.
        stopped: why it stopped.
        learning: what has been learned; `learning.add` goes on.
    """

    steps: tuple[LearningStep, ...]
    best: LearningStep
    predicted: Array
    stopped: str
    learning: Learning

    @property
    def plan(self) -> Plan:
        """The plan of the best run."""
        return self.best.plan

    @property
    def contractions(self) -> Array:
        """The error within the band of each run after the first, as a share of that of the run before (k,)."""
        return np.array([step.contraction for step in self.steps[1:]], dtype=float)

    def __repr__(self) -> str:
        errors = " -> ".join(f"{step.error:.2g}" for step in self.steps)
        return f"<Learned in {len(self.steps)} runs: error within the band {errors}; {self.stopped}>"


def iterate(
    drive: Drive,
    planner: Planner,
    reference: PiecewiseSignal,
    *,
    band: float,
    runs: int = 8,
    target: float | None = None,
    rehearsal: Drive | None = None,
    gain: float = 1.0,
    degree: int = 7,
    window: tuple[float, float] | None = None,
    progress: Callable[[LearningStep], None] | None = None,
) -> Learned:
    """Drive, learn from the error, drive again: see `Learning` for what is learned.

    It stops after `runs` runs, once the error within the band is down to `target`, or when each of two runs leaves more than 0.9 of
    the error of the run before: what is left then does not repeat itself (noise), or lies beyond what the band's splines follow.

    Args:
        drive: drives the mechanism along a plan and returns the run; where that is done by hand, use `Learning` and `read_log`.
        planner: makes a plan for a reference, as `lambda y_d: invtrack.invert(model, y_d)`.
        reference: the wanted output y_d.
        band: highest frequency that is learned [rad/s].
        runs: at most, the first, which nothing has been learned for, included.
        target: root mean square of y - y_d within the band at which it is enough, in units of the outputs.
        rehearsal: drives a stand-in for the mechanism that differs from the planner's model by what the mechanism may, such as a
            plant with other parameters: the contraction there is what is predicted, and where the error does not contract
            nothing else is driven.
        gain, degree, window: see `Learning`.
        progress: called with each step.

    Raises LearningError where the rehearsal does not contract, with the frequency at which it grows, and as `Learning` does; what
    `drive` and `planner` raise passes through.
    """
    for name, function in (("drive", drive), ("rehearsal", rehearsal), ("progress", progress)):
        if not callable(function) and (function is not None or name == "drive"):
            raise LearningError(f"{name} must be a function, got {shown(function)}")
    most = whole_number("runs", runs, lowest=1, highest=MOST_RUNS, error=LearningError)
    if target is not None and not real_number("target", target, error=LearningError) > 0:
        raise LearningError(f"target must be a positive error, got {target}")

    def beginning() -> Learning:
        return Learning(planner, reference, band=band, gain=gain, degree=degree, window=window)

    predicted = np.zeros(0) if rehearsal is None else _rehearsed(rehearsal, beginning())
    learning = beginning()
    stopped = f"all {most} runs are driven"
    for number in range(most):
        step = learning.add(drive(learning.plan))
        if progress is not None:
            progress(step)
        if target is not None and step.error <= target:
            stopped = f"run {number} is within the target"
            break
        last = [each.contraction for each in learning.steps[-2:] if each.contraction is not None]
        if len(last) == 2 and min(last) > STALLED:
            stopped = f"the last two runs leave {last[0]:.2g} and {last[1]:.2g} of the error of the run before"
            break
    return Learned(tuple(learning.steps), learning.best, predicted, stopped, learning)


def _rehearsed(drive: Drive, learning: Learning) -> Array:
    """Contractions of a rehearsal. Raises LearningError where the error grows before it is small."""
    for number in range(REHEARSED):
        try:
            step = learning.add(drive(learning.plan))
        except LearningError as error:
            raise LearningError(f"in rehearsal {error}; so nothing was driven") from error
        first = learning.steps[0].error
        if step.contraction is not None and step.contraction >= 1 and learning.steps[-2].error > SETTLED * first:
            grows = learning.growing()
            at = "" if grows is None else f", from {grows:.3g} rad/s on"
            narrower = "" if grows is None or grows <= 0 else f"within a band below {grows:.3g} rad/s, "
            raise LearningError(
                f"learning does not contract: in rehearsal run {number} leaves {step.contraction:.3g} times the error of the run "
                f"before{at}, so nothing was driven; learn {narrower}with a smaller gain than {learning.gain:g}, or with a better "
                "model"
            )
        if step.error <= SETTLED * first:
            break
    return np.array([step.contraction for step in learning.steps[1:]], dtype=float)
