"""All methods that apply to a plant and a motion, tried and compared."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from invtrack.advice.advice import Advice
from invtrack.advice.choice import chosen, ordered, promise, reason
from invtrack.advice.move import Move
from invtrack.advice.program import rounded
from invtrack.advice.task import Task
from invtrack.advice.trial import Bench, Trial, input_unit
from invtrack.advice.ways import WAYS, Way
from invtrack.arguments import flag
from invtrack.arrays import shown
from invtrack.errors import InvtrackError, PlanError
from invtrack.redesign import Limits
from invtrack.references import PiecewiseSignal

SHORTER = (0.75,)
"""Durations besides the whole one, as shares of it: more time is not always less input."""

LONGER = (1.5, 2.0, 3.0, 5.0)
"""Durations that are tried, one after the other, where nothing does what is asked in the time that was given."""

MOST_PROMISING = 3
"""Ways that are tried for ever shorter motions."""

SHORTEST = 0.125
"""Of the given duration, the shortest that is looked at."""

BISECTIONS = 6
"""Of the logarithm of the duration, between the shortest that does and the longest that does not."""


def advise(
    plant: Any,
    reference: Move | PiecewiseSignal,
    *,
    error: float = 0.01,
    limits: Limits | None = None,
    parameter_errors: float | Mapping[str, Any] = 0.0,
    max_preactuation: float | None = None,
    fastest: bool = False,
    timestep: float = 1e-3,
    progress: Callable[[float], None] | None = None,
) -> Advice:
    """Try every method that applies on the plant itself, under one and the same feedback, and recommend one.

        advice = invtrack.advise(plant, invtrack.Move(1.0, duration=3.0), error=0.01, parameter_errors=0.1)
        print(advice)
        print(advice.program)

    Tried are redesign (its weights searched so that it takes of the error what it may), redesign within limits, exact and modified
    inversion, each of the linear model and, of a Plant, of its own motion, causal inversion, and what people use: feedback alone,
    with rigid feedforward or through postures at rest, shaped commands under that feedback and on a base servo, approximate
    inverses of the sampled plant. Where the reference is a `Move`, several smoothnesses, and shorter motions, are tried, too;
    longer ones where nothing does what is asked in that time.

    Recommended is what keeps to `error`, `limits` and `max_preactuation` and stays stable with parameters off; of these what takes
    the least peak input; of those within 5 % of that what rings least, and of those that ring alike a plan on the linear model.

    Args:
        plant: a Plant at an equilibrium; or a StateSpace, a SwitchedSystem, or anything with A, B, C, D.
        reference: `Move(by, duration)`, or a signal, absolute, in the units of the outputs.
        error: largest |y - y_d| that is acceptable, as a share of the motion of each output.
        limits: what must never be exceeded; the ranges of the actuators unless given.
        parameter_errors: by which share of its value a parameter may be off, by its name or path, {"body:load:mass": 0.1}; one
            number for all that the plant names or, where it names none, for the masses of its moving bodies and for stiffnesses.
            One at a time, both ways. For a linear model: other models that the plant may turn out to be, by a readable name.
        max_preactuation: longest time before the motion for which the input may act [s].
        fastest: recommend the shortest motion that does what is asked, not the one with the least input; needs a `Move`.
        timestep: of the simulations [s].
        progress: called with the share that is done.

    Raises PlanError for options out of range, and whatever keeps the plant from being linearized or stabilized.
    """
    task = Task.of(
        plant,
        reference,
        error=error,
        limits=limits,
        parameter_errors=parameter_errors,
        max_preactuation=max_preactuation,
        timestep=timestep,
    )
    if flag("fastest", fastest, error=PlanError) and not isinstance(reference, Move):
        raise PlanError("fastest needs a motion whose duration is open: give a Move(by, duration) as the reference")
    if not np.any(task.moved):
        raise PlanError("the reference does not move, so there is nothing to choose; give one that does")
    if progress is not None and not callable(progress):
        raise PlanError(f"progress must be a function of the share that is done, got {shown(progress)}")
    search = _Search(Bench.of(task), progress or (lambda share: None))
    search.fastest() if fastest else search.least_input()
    search.parameters_off()
    recommended, trials = search.recommended(fastest=fastest), search.trials
    unit = input_unit(task)
    return Advice(
        plant=getattr(plant, "name", "") or "linear model",
        trials=tuple(ordered(trials, recommended)),
        excluded=search.excluded,
        recommended=recommended,
        reason=reason(task, trials, recommended, fastest=fastest, unit=unit),
        error=task.error,
        input_unit=unit,
        off=tuple(task.off),
    )


@dataclass(eq=False)
class _Search:
    """What was tried so far."""

    bench: Bench
    report: Callable[[float], None]
    trials: list[Trial] = field(default_factory=list)
    refusals: dict[str, str] = field(default_factory=dict)

    @property
    def task(self) -> Task:
        return self.bench.task

    @property
    def excluded(self) -> dict[str, str]:
        """Methods of which nothing could be tried, and why."""
        tried = {trial.method for trial in self.trials}
        return {name: text for name, text in self.refusals.items() if name not in tried}

    def least_input(self) -> None:
        """The whole duration, and shorter ones for the methods that may need less input there; longer ones where nothing does."""
        duration = self.task.duration
        if not isinstance(self.task.reference, Move):
            self._all([(way, duration, None) for way in self._ways()])
            return
        self._tried_at(self._ways(), duration)
        for share in SHORTER:
            self._all([(way, rounded(share * duration), smoothness) for way, smoothness in self._promising(1)])
        self._longer()

    def fastest(self) -> None:
        """Shorter motions, between the shortest that does what is asked and the longest that does not."""
        duration = self.task.duration
        self._tried_at(self._ways(), duration)
        if not any(trial.meets for trial in self.trials):
            self._longer()
            return
        good, below = 1.0, SHORTEST
        promising = self._promising(MOST_PROMISING)
        for _ in range(BISECTIONS):
            middle = math.sqrt(good * below)
            known = len(self.trials)
            self._all([(way, rounded(middle * duration), smoothness) for way, smoothness in promising])
            if any(trial.meets for trial in self.trials[known:]):
                good = middle
            else:
                below = middle

    def _promising(self, count: int) -> list[tuple[Way, int | None]]:
        """For other durations: of each way the smoothness with which it did best, of the ways the best few.

        Redesign within limits, which only shows where limits act, is always among them.
        """
        ranked = sorted(self.trials, key=promise)
        smoothness: dict[str, int | None] = {}
        for trial in ranked:
            smoothness.setdefault(trial.method, trial.smoothness)
        open_to_it = {way.name: way for way in self._ways() if way.durations}
        found = [(open_to_it[name], best) for name, best in smoothness.items() if name in open_to_it][:count]
        missing = [way for way in open_to_it.values() if way.within_limits and way.name not in smoothness]
        return found + [(way, each) for way in missing for each in way.smoothnesses(self.task)]

    def recommended(self, *, fastest: bool) -> Trial | None:
        """The choice among what was tried, which stays stable with parameters off."""
        while True:
            found = chosen(self.trials, fastest=fastest)
            if found is None or found.error_off is not None or not self.task.off:
                return found
            self._with_parameters_off(found)

    def parameters_off(self) -> None:
        """What parameters that are off do to the best of each method."""
        best: dict[str, Trial] = {}
        for trial in sorted(self.trials, key=promise):
            best.setdefault(trial.method, trial)
        for number, trial in enumerate(best.values()):
            self.report(0.5 + 0.5 * number / len(best))
            if trial.error_off is None:
                self._with_parameters_off(trial)

    def _with_parameters_off(self, trial: Trial) -> None:
        self.trials[self.trials.index(trial)] = self.bench.with_parameters_off(trial)

    def _ways(self) -> list[Way]:
        return [way for way in WAYS if self.task.plant is not None or not way.mechanism]

    def _longer(self) -> None:
        for factor in LONGER:
            if any(trial.meets for trial in self.trials):
                return
            self._tried_at(self._ways(), rounded(factor * self.task.duration))

    def _tried_at(self, ways: list[Way], duration: float) -> None:
        """At this duration, those last that are tried where others did best."""
        known = len(self.trials)
        leaders = [way for way in ways if not way.follows]
        self._all([(way, duration, smoothness) for way in leaders for smoothness in way.smoothnesses(self.task)])
        best = {trial.method: trial.smoothness for trial in sorted(self.trials[known:], key=promise, reverse=True)}
        followers = [(way, best.get(way.follows, way.smoothnesses(self.task)[0])) for way in ways if way.follows]
        self._all([(way, duration, smoothness) for way, smoothness in followers])

    def _all(self, points: list[tuple[Way, float, int | None]]) -> None:
        for number, (way, duration, smoothness) in enumerate(points):
            self.report(0.5 * number / len(points))
            try:
                self.trials.append(self.bench.tried(way, duration, smoothness))
            except InvtrackError as refusal:
                self.refusals.setdefault(way.name, str(refusal))
