"""The options that choose a plan, and the plan, with the feedback around it, that they make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, Literal

import tyro

from invtrack.advice.feedback import gain_line, weight_lines
from invtrack.advice.program import rounded
from invtrack.advice.task import Task, least_smoothness
from invtrack.advice.ways import TIGHTER
from invtrack.advice.weights import corrected, planned_error, redesign_weights, weights
from invtrack.command.limits import exceeded
from invtrack.command.mechanism import assignment
from invtrack.command.motion import Motion, share
from invtrack.control import GainSchedule
from invtrack.errors import PlanError
from invtrack.inversion import invert, modified_inversion, steady_state_feedforward
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plant import Change, Plant, linearize
from invtrack.redesign import constrained_redesign, quadratic_redesign
from invtrack.references import PiecewiseSignal, load_reference, rest_to_rest, stack

Method = Literal["exact", "modified", "redesign", "limited", "feedback"]

SMOOTHER = 2
"""Derivatives that vanish at the motion's ends beyond those that exact tracking needs."""


@dataclass(frozen=True, kw_only=True)
class Planned(Motion):
    """A motion of a mechanism, and how it is planned."""

    smoothness: Annotated[int | None, tyro.conf.arg(metavar="INT")] = None
    """How many derivatives of the motion vanish at its ends; by default two more than exact tracking needs."""

    method: Annotated[Method | None, tyro.conf.arg(metavar="{exact,modified,redesign,limited,feedback}")] = None
    """exact: the inverse; modified: zeros near the axis moved, for less preactuation; redesign: less input for a little of the
    motion; limited: the same within --limit and the actuators' ranges; feedback: none of these, feedback alone. By default exact,
    or limited where there is a --limit. A plan that exceeds a --limit is refused."""

    nonlinear: tyro.conf.FlagCreatePairsOff[bool] = False
    """Plan on the mechanism's own motion, not on its linear model."""

    give_up: Annotated[str | None, tyro.conf.arg(metavar="SHARE")] = None
    """How much of the motion a redesign may give up for less input; by default what --error says, 0.3 of that within limits."""

    change: Annotated[tuple[tuple[float, str], ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="SECONDS PATH=VALUE")] = ()
    """A parameter that changes on the way, known to the plan, as in --change 1.5 body:tip:mass=3; may be given several times."""

    @property
    def chosen_method(self) -> Method:
        """That of --method, or what follows from the other options."""
        return self.method or ("limited" if self.limit else "exact")

    @property
    def changes(self) -> list[Change]:
        """Those of --change, in their order in time."""
        changes = [Change(time, **dict([assignment("--change", text)])) for time, text in self.change]
        return sorted(changes, key=lambda change: change.time)

    def planning(self, unknown: tuple[Change, ...] = ()) -> Planning:
        """What the plan is made of; unknown: changes that the plan does not know of, whose parameters the plant has besides."""
        changes = self.changes
        plant = self.plant([path for change in (*changes, *unknown) for path in change.parameters])
        models, values = [linearize(plant)], dict[str, Any]()
        for change in changes:
            values |= change.parameters
            models.append(linearize(plant, **values))
        model = SwitchedSystem(models, [change.time for change in changes])
        reference = self._reference(plant, model)
        task = Task.of(
            model,
            reference,
            error=share("--error", self.error),
            limits=self.limits(plant),
            parameter_errors=0.0,
            max_preactuation=None,
            timestep=1.0,
        )
        return Planning(self, plant, reference, task)

    def _reference(self, plant: Plant, model: SwitchedSystem) -> PiecewiseSignal:
        if self.reference is not None:
            return load_reference(self.reference, channels=plant.outputs)
        distances = self.distances(plant)
        smoothness = SMOOTHER + least_smoothness(model) if self.smoothness is None else self.smoothness
        starts = plant.operating_point.y0
        return stack(
            [
                rest_to_rest(y, y + distance, duration=self.duration, smoothness=smoothness)
                for y, distance in zip(starts.tolist(), distances, strict=True)
            ]
        )


@dataclass(frozen=True, eq=False)
class Planning:
    """What is planned, and for what.

    options: those of the command line. plant: with the parameters that change. reference: the wanted output. task: the linear
    model, what is acceptable, and the sizes that things are measured in.
    """

    options: Planned
    plant: Plant
    reference: PiecewiseSignal
    task: Task

    @cached_property
    def plan(self) -> Plan:
        """The plan. Raises PlanError where it goes beyond a limit that was stated, and whatever keeps it from being made."""
        task, options = self.task, self.options
        subject: Any = self.plant if options.nonlinear else task.model
        given: dict[str, Any] = {"schedule": options.changes} if options.nonlinear and options.changes else {}
        reference, duration = self.reference, task.duration
        rates = {"axis_distance": rounded(1.0 / duration), "real_part": rounded(5.0 / duration)}
        methods: dict[Method, Callable[[], Plan]] = {
            "exact": lambda: invert(subject, reference, **given),
            "modified": lambda: modified_inversion(subject, reference, **rates, **given),
            "redesign": lambda: self._redesigned(subject, given),
            "limited": lambda: self._limited(subject, given),
            "feedback": lambda: steady_state_feedforward(subject, reference, **given),
        }
        plan = methods[options.chosen_method]()
        beyond = exceeded(plan, task.bounds) if options.limit else []
        if beyond:
            remedy = "" if options.chosen_method == "limited" else "take --method limited, or "
            raise PlanError(
                f"--limit: {plan.method} does not keep to it: {'; '.join(beyond)}; {remedy}allow a longer motion (--in)"
            )
        return plan

    @cached_property
    def gains(self) -> GainSchedule:
        """The feedback around the plan: LQR along its motion, in which the acceptable error costs as much as the motion's input."""
        names: dict[str, Any] = {"model": self.task.model, "plan": self.plan}
        for line in (*weight_lines(self.task), gain_line("plan" if self.options.nonlinear else "model")):
            line.run(names)
        gains: GainSchedule = names["gains"]
        return gains

    def _redesigned(self, subject: Any, given: dict[str, Any]) -> Plan:
        task, given_up = self.task, self._given_up(1.0)
        number, chosen = redesign_weights(task, self.reference, {}, share=given_up)
        plan = quadratic_redesign(subject, self.reference, **chosen, **given)
        if not self.options.nonlinear:
            return plan
        again = corrected(number, planned_error(task, plan), share=given_up)
        return plan if again == number else quadratic_redesign(subject, self.reference, **weights(task, again), **given)

    def _limited(self, subject: Any, given: dict[str, Any]) -> Plan:
        limits = self.task.planned_limits
        if limits is None:
            raise PlanError("--method limited: there are no limits to keep; state some with --limit, as in --limit drive=12")
        _, chosen = redesign_weights(self.task, self.reference, {}, share=self._given_up(TIGHTER))
        return constrained_redesign(subject, self.reference, limits=limits, **chosen, **given)

    def _given_up(self, usual: float) -> float:
        """How much of the motion a redesign may give up; usual: of the acceptable error, unless it is stated."""
        stated = self.options.give_up
        return usual * self.task.error if stated is None else share("--give-up", stated)
