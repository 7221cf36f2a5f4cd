"""One way to move, tried: its plan, its run on the plant, what it does where parameters are off, and where it falls short."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from invtrack.advice.feedback import controller_line, weight_lines
from invtrack.advice.program import Line, Name
from invtrack.advice.task import Task, subject_lines
from invtrack.advice.ways import Point, Way
from invtrack.arrays import Array
from invtrack.control import TrackingController
from invtrack.errors import InvtrackError
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.results import RunResult, postactuation_time, preactuation_time
from invtrack.results.vibration import window_length
from invtrack.simulation import LinearPlant, simulate
from invtrack.simulation.parameter_factors import with_factors

LONGEST_WINDOW = 10.0
"""Vibration is looked at for so many times the duration of the motion at most, however slow the slowest mode is."""

AT_REST = 0.01
"""Share of the acceptable error: a run starts where the input is below this share of its peak from rest."""

STEPS = 3
"""Decimals of the times [s] at which runs start and end."""


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Trial:
    """What one method makes of a motion, on the plant itself under feedback. Shares are of the outputs' motion.

    Args:
        method: its name.
        duration: of the motion [s].
        smoothness: how many derivatives vanish at its ends; None where the reference was given as a signal.
        plan: what was driven.
        run: of the plant as it is planned for.
        program: the lines that make plan and run, from `plant`, or `model`, on, `invtrack` imported.
        error, residual_vibration: largest |y - y_d|, and peak to peak of it after the manoeuvre, as shares.
        peak_input: largest |u| applied, in the unit of `Advice.input_unit`.
        preactuation, ringing: how long the input acts before and after the manoeuvre [s]; None where that is not defined.
        error_off, vibration_off: the largest of these where a parameter is off; infinite where a run diverges, None where this was
            not tried.
        misses: in what it falls short of what was asked, by a word for it ("error", "limits", "preactuation", "stability"); empty
            where it does all of it.
        settings: the controller, and the other arguments of the run.
        gives_up: share of the acceptable error that the plan was to take for less input; None of methods that take none.
    """

    method: str
    duration: float
    smoothness: int | None
    plan: Plan
    run: RunResult
    program: str
    error: float
    residual_vibration: float
    peak_input: float
    preactuation: float | None
    ringing: float | None
    error_off: float | None = None
    vibration_off: float | None = None
    misses: Mapping[str, str] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    gives_up: float | None = None

    def __repr__(self) -> str:
        """What it is, without its arrays."""
        said = "; ".join(self.misses.values()) or "does what was asked"
        figures = f"error {100 * self.error:.3g} %, peak input {self.peak_input:.4g}"
        return f"<Trial of {self.method}, {self.duration:.4g} s, {figures}: {said}>"

    @property
    def meets(self) -> bool:
        """Whether it does all that was asked."""
        return not self.misses

    @property
    def row(self) -> dict[str, Any]:
        """Its figures by name, for tables and files; None where one is not defined."""
        names = ("method", "duration", "smoothness", "error", "residual_vibration", "peak_input", "preactuation", "ringing")
        values = {name: getattr(self, name) for name in (*names, "error_off", "vibration_off")}
        finite = {name: None if isinstance(value, float) and not math.isfinite(value) else value for name, value in values.items()}
        return {**finite, "misses": dict(self.misses)}


@dataclass(frozen=True, eq=False)
class Bench:
    """A task with what all its trials share: the model, the feedback's weights, and what is known of redesigns."""

    task: Task
    lines: tuple[Line, ...]
    names: dict[str, Any]
    known: dict[tuple[float, int | None], dict[int, float]] = field(default_factory=dict)
    guesses: dict[float, int] = field(default_factory=dict)

    @classmethod
    def of(cls, task: Task) -> Bench:
        """Set up; raises what `bryson` and `lqr` raise, for without feedback there is nothing to compare."""
        names = {"plant": task.plant} if task.plant is not None else {"model": task.subject}
        lines = (*subject_lines(task), *weight_lines(task))
        for line in lines:
            line.run(names)
        return cls(task, lines, names)

    def tried(self, way: Way, duration: float, smoothness: int | None) -> Trial:
        """Plan and run. Raises InvtrackError where the way does not apply."""
        task, names = self.task, dict(self.names)
        lines = list(task.reference_lines(duration, smoothness))
        for line in lines:
            line.run(names)
        names.setdefault("reference", task.reference)
        known = self.known.setdefault((duration, smoothness), {})
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # what they warn of is looked for in the run
            point = Point(task, duration, smoothness, names, known, self.guesses)
            lines += way.lines(point)
            if not any(line.target == "controller" for line in lines):
                lines.append(controller_line())
            for line in lines[len(task.reference_lines(duration, smoothness)) :]:
                if line.text in point.done:
                    names[line.target] = point.done[line.text]
                else:
                    line.run(names)
            plan: Plan = names["plan"]
            last = self._simulation(plan, names["controller"])
            if task.plant is None:
                lines.append(Line("plant", "invtrack.LinearPlant", [Name("model")]))
                lines[-1].run(names)
            last.run(names, name=way.name)
        program = "\n".join(line.text for line in (*self.lines, *lines, last))
        run: RunResult = names["result"]
        error, vibration = _errors(task, run)
        trial = Trial(
            method=way.name,
            duration=duration,
            smoothness=smoothness,
            plan=plan,
            run=run,
            program=program,
            error=error,
            residual_vibration=vibration,
            peak_input=float(np.max(_peaks(run) / input_scale(task))),
            preactuation=_preactuation(plan, run),
            ringing=_ringing(plan),
            settings={"controller": names["controller"], **last.options},
            gives_up=way.gives_up,
        )
        return replace(trial, misses=_misses(task, trial))

    def with_parameters_off(self, trial: Trial) -> Trial:
        """The same with what happens where the plant is another than was planned for."""
        if not self.task.off or trial.run.status == "diverged":
            return trial
        found, diverged = [], []
        for name, off in self.task.off.items():
            run = self._run_off(trial, off)
            found.append(_errors(self.task, run))
            if run.status == "diverged":
                diverged.append(name)
        error, vibration = (float(np.max(values)) for values in zip(*found, strict=True))
        misses = {**trial.misses, **({"stability": f"diverges with {' or '.join(diverged)}"} if diverged else {})}
        return replace(trial, error_off=error, vibration_off=vibration, misses=misses)

    def _run_off(self, trial: Trial, off: Mapping[str, float] | SwitchedSystem) -> RunResult:
        settings = dict(trial.settings)
        controller: TrackingController = settings.pop("controller")
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)
            plant = self.task.plant
            if isinstance(off, SwitchedSystem) or plant is None:
                return simulate(LinearPlant(off), controller, **settings)
            other, options = with_factors(plant, trial.plan, off, settings)
            return simulate(other, controller, **options)

    def _simulation(self, plan: Plan, controller: TrackingController) -> Line:
        """From where the plan looks at rest to the end of the window for residual vibration."""
        (T_i, T_f), task = plan.manoeuvre, self.task
        window = window_length(plan.manoeuvre, slowest_flexible_period(plan.model.systems[-1])).value or 0.0
        window = min(window, LONGEST_WINDOW * task.duration)
        before = max(0.0, T_i - plan.start)
        if before > task.duration and not np.any(np.isnan(plan.rest_inputs[0])):
            before = min(before, preactuation_time(plan, level=AT_REST * task.error))
        if controller.period is None:
            start = round(T_i - before - 0.5 * 10.0**-STEPS, STEPS) if before else T_i
        else:  # the plan's holds are counted from its start on
            start = T_i - (math.ceil(before / controller.period - 1e-9) + 1) * controller.period
        options = {"start": start, "end": round(T_f + window + 10.0**-STEPS, STEPS), "timestep": task.timestep}
        return Line("result", "invtrack.simulate", [Name("plant"), Name("controller")], options)


def input_scale(task: Task) -> Array:
    """What each input is counted in (m,): its unit where all have the same, else its range, or its size in such a motion."""
    model = task.model
    if len(set(model.inputs.units)) == 1:
        return np.ones(len(model.inputs))
    half = np.diff(model.input_limits, axis=1)[:, 0] / 2
    return half if np.all(np.isfinite(half)) else task.sizes[1]


def input_unit(task: Task) -> str:
    """The unit of peak inputs in a table."""
    units = set(task.model.inputs.units)
    if len(units) == 1:
        return units.pop()
    return "of half its range" if np.all(np.isfinite(task.model.input_limits)) else "of its size"


def _peaks(run: RunResult) -> Array:
    values = np.abs(run.applied.values)
    return np.asarray(np.max(values, axis=0)) if len(values) and np.all(np.isfinite(values)) else np.full(values.shape[1], np.inf)


def _errors(task: Task, run: RunResult) -> tuple[float, float]:
    """Largest error, and peak to peak of it after the manoeuvre, as shares of the motion."""
    if run.status == "diverged":
        return math.inf, math.inf
    error = run.error / task.motion
    after = error[run.time >= run.manoeuvre[1]]
    return float(np.max(np.abs(error))), float(np.max(np.ptp(after, axis=0))) if len(after) else 0.0


def _preactuation(plan: Plan, run: RunResult) -> float | None:
    try:
        return min(preactuation_time(plan), max(0.0, plan.manoeuvre[0] - plan.start))
    except InvtrackError:
        return None


def _ringing(plan: Plan) -> float | None:
    try:
        return postactuation_time(plan)
    except InvtrackError:
        return None


def _misses(task: Task, trial: Trial) -> dict[str, str]:
    """In what a run falls short of what was asked."""
    if trial.run.status == "diverged":
        return {"stability": f"diverges: {trial.run.message}"}
    found = {}
    if not trial.error <= task.error:
        found["error"] = f"its error is {100 * trial.error:.3g} % of the motion"
    limits = limits_exceeded(task, trial.run)
    if limits:
        found["limits"] = ", ".join(limits)
    if math.isfinite(task.max_preactuation):
        if trial.preactuation is None:
            found["preactuation"] = "it is never at rest before the motion"
        elif trial.preactuation > task.max_preactuation:
            found["preactuation"] = f"it acts {trial.preactuation:.3g} s before the motion"
    return found


def limits_exceeded(task: Task, run: RunResult) -> list[str]:
    """The limits that what the controller asked for, or what came of it, goes beyond."""
    point = task.model.operating_point
    x, y = run.state.values[:-1], run.output.values[:-1] - point.y0
    u = run.commanded.values - point.u0
    values = np.hstack([x, u, y])
    rates = np.diff(values, axis=0) / np.diff(run.time[:-1])[:, np.newaxis]
    found = []
    for bound in task.bounds:
        excess = float(np.max(bound.excess((rates if bound.kind == "input rate" else values) @ bound.row), initial=-math.inf))
        if excess > 0:
            found.append(f"{bound.name} beyond its limit by {100 * excess:.2g} %")
    known = {f"limit of {name}" for name in run.commanded.channels.names}
    texts = dict.fromkeys(event.text.partition(",")[0] for event in run.events if event.kind in ("limit", "contact"))
    if not any(text.startswith("input") for text in found):
        found += [text for text in texts if text not in known or not task.bounds]
    return found
