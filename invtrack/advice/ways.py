"""The ways to move that are compared: for each the lines that plan it and make its gains, or why it does not apply."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Literal

import numpy as np

from invtrack.advice.feedback import controller_line, gain_line
from invtrack.advice.program import Line, Name, rounded
from invtrack.advice.task import Task
from invtrack.advice.weights import corrected, planned_error, redesign_weights, weights
from invtrack.baselines import base_servo, feedback_tracking, flexible_modes, shaper
from invtrack.errors import ControlError, InvtrackError, PlanError
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.references import PiecewiseSignal

STIFF = 4.0
"""A base servo is this many times as fast as the slowest flexible mode."""

HOLDS = 250
"""Holds of an approximate inverse over the motion."""

TIGHTER = 0.3
"""Share of the acceptable error for which a redesign is weighed where limits, or what no linear model knows, take the rest."""

ShaperKind = Literal["ZV", "ZVD", "EI"]


@dataclass(frozen=True, eq=False)
class Point:
    """A way is worked out for one duration [s] and smoothness of the motion; both are those of the signal where one was given.

    names: what the program's lines before have named. known: see `redesign_weights`. guesses: what it found last, by the share of
    the acceptable error. done: what lines have made that were run while they were chosen, by their texts.
    """

    task: Task
    duration: float
    smoothness: int | None
    names: dict[str, Any] = field(repr=False)
    known: dict[int, float] = field(repr=False)
    guesses: dict[float, int] = field(repr=False)
    done: dict[str, Any] = field(default_factory=dict, repr=False)

    @property
    def reference(self) -> PiecewiseSignal:
        """The wanted output."""
        found: PiecewiseSignal = self.names["reference"]
        return found

    @property
    def preactuation(self) -> dict[str, float]:
        """The option of planners that limits the preactuation."""
        return {} if math.isinf(self.task.max_preactuation) else {"max_preactuation": self.task.max_preactuation}

    def planned(self, line: Line) -> Any:
        """The plan that a line makes, which is not made again."""
        names = dict(self.names)
        line.run(names)
        self.done[line.text] = names[line.target]
        return names[line.target]


@dataclass(frozen=True)
class Way:
    """A method.

    Args:
        name: as tables call it.
        lines: those that plan and make gains, at a point; raises InvtrackError where it does not apply.
        offsets: smoothnesses of the motion that are tried, counted from what the inverse needs; several where the method cares.
        durations: whether shorter motions are tried, too.
        mechanism: whether it takes a Plant.
        within_limits: whether it only applies where limits act.
        gives_up: share of the acceptable error that its plan is to take for less input, None where it is to take none.
        follows: name of the way at whose best smoothness it is tried, which then is the only one: a plan on the motion of a
            mechanism takes seconds.
    """

    name: str
    lines: Callable[[Point], Sequence[Line]]
    offsets: Sequence[int] = (0,)
    durations: bool = False
    mechanism: bool = False
    within_limits: bool = False
    gives_up: float | None = None
    follows: str = ""

    def smoothnesses(self, task: Task) -> list[int]:
        """Those that are tried, at least 1."""
        return sorted({max(1, task.least_smoothness + offset) for offset in self.offsets})


def _exact(point: Point) -> Sequence[Line]:
    return (Line("plan", "invtrack.invert", [Name("model"), Name("reference")], point.preactuation), gain_line("plan"))


def _motion(point: Point) -> Sequence[Line]:
    return (Line("plan", "invtrack.invert", [Name("plant"), Name("reference")], point.preactuation), gain_line("plan"))


def _modified(point: Point) -> Sequence[Line]:
    line = _modification(point, "model")
    if all(np.array_equal(each.zeros_before, each.zeros_after) for each in point.planned(line).modification):
        rate = line.options["axis_distance"]
        raise PlanError(f"no zero lies within {rate:.3g} rad/s of the imaginary axis, so there is none to move")
    return (line, gain_line("plan"))


def _modified_motion(point: Point) -> Sequence[Line]:
    _modified(point)  # refuses where there is no zero to move
    return (_modification(point, "plant"), gain_line("plan"))


def _modification(point: Point, subject: str) -> Line:
    rates = {"axis_distance": rounded(1 / point.duration), "real_part": rounded(5 / point.duration)}
    return Line("plan", "invtrack.modified_inversion", [Name(subject), Name("reference")], {**rates, **point.preactuation})


def _quadratic(share: float) -> Callable[[Point], Sequence[Line]]:
    def lines(point: Point) -> Sequence[Line]:
        return (_redesign(point, "model", weights(point.task, _weight(point, share))), gain_line("plan"))

    return lines


def _redesign(point: Point, subject: str, chosen: dict[str, Any]) -> Line:
    options = {**chosen, **point.preactuation}
    return Line("plan", "invtrack.quadratic_redesign", [Name(subject), Name("reference")], options)


def _weight(point: Point, share: float) -> int:
    """The number of the weights with which a redesign takes this share of the acceptable error, see `redesign_weights`."""
    found, _ = redesign_weights(
        point.task,
        point.reference,
        point.known,
        share=share * point.task.error,
        guess=point.guesses.get(share),
        **point.preactuation,
    )
    point.guesses[share] = found
    return found


def _quadratic_motion(point: Point) -> Sequence[Line]:
    """With the weights of the linear redesign; once others where the motion makes something else of them."""
    number = _weight(point, 1.0)
    line = _redesign(point, "plant", weights(point.task, number))
    again = corrected(number, planned_error(point.task, point.planned(line)), share=point.task.error)
    return (_redesign(point, "plant", weights(point.task, again)), gain_line("plan"))


def _constrained(point: Point) -> Sequence[Line]:
    line = _within_limits(point, "model")
    if not point.planned(line).active:
        raise PlanError("no limit acts on it, so that it is the quadratic redesign")
    return (line, gain_line("plan"))


def _constrained_motion(point: Point) -> Sequence[Line]:
    try:
        _constrained(point)
    except InvtrackError as refusal:
        raise PlanError(f"it is tried where redesign of the linear model within limits applies, of which: {refusal}") from refusal
    return (_within_limits(point, "plant"), gain_line("plan"))


def _within_limits(point: Point, subject: str) -> Line:
    task = point.task
    limits = task.planned_limits
    if limits is None:
        raise PlanError("there are no limits to keep: none were given, and the actuators state no range")
    options = {**weights(task, _weight(point, TIGHTER)), "limits": limits, **point.preactuation}
    return Line("plan", "invtrack.constrained_redesign", [Name(subject), Name("reference")], options)


def _causal(point: Point) -> Sequence[Line]:
    return (Line("plan", "invtrack.causal_inverse", [Name("model"), Name("reference")]), gain_line("plan"))


def _following(derivatives: int) -> Callable[[Point], Sequence[Line]]:
    def lines(point: Point) -> Sequence[Line]:
        options = {"gains": Name("gains"), "derivatives": derivatives}
        line = Line("plan", "invtrack.baselines.feedback_tracking", [Name("model"), Name("reference")], options)
        return (gain_line("model"), line)

    return lines


def _postures(point: Point) -> Sequence[Line]:
    line = Line("plan", "invtrack.inversion.steady_state_feedforward", [Name("plant"), Name("reference")])
    return (line, gain_line("plan"))


def _shaped(kind: ShaperKind) -> Callable[[Point], Sequence[Line]]:
    def lines(point: Point) -> Sequence[Line]:
        names = dict(point.names)
        gains = gain_line("model")
        gains.run(names)
        return (gains, *_command(point, kind, names["gains"]))

    return lines


def _shaped_on_servo(kind: ShaperKind) -> Callable[[Point], Sequence[Line]]:
    def lines(point: Point) -> Sequence[Line]:
        options = _servo(point)
        servo = Line("gains", "invtrack.baselines.base_servo", [Name("model")], options)
        return (servo, *_command(point, kind, base_servo(point.task.model, **options)))

    return lines


def _servo(point: Point) -> dict[str, Any]:
    """Options of a servo that holds one position by one input so that the loop is stable, of the first one there is."""
    model = point.task.model
    period = slowest_flexible_period(model.systems[-1])
    frequency = rounded(STIFF * 2 * math.pi / (period if math.isfinite(period) else point.duration))
    refusals = []
    for position, driven in product(model.states.names, model.inputs.names):
        options = {"position": position, "frequency": frequency, **({"input": driven} if len(model.inputs) > 1 else {})}
        try:
            feedback_tracking(model, point.reference, gains=base_servo(model, **options))
        except InvtrackError as error:
            refusals.append(f"{position!r} by {driven!r}: {error}")
            continue
        return options
    raise ControlError(f"no servo of one position by one input makes this loop stable; of {refusals[0]}")


def _command(point: Point, kind: ShaperKind, gains: Any) -> Sequence[Line]:
    """A command that is shaped for the modes of the loop and, where the motion is ours to choose, done when the motion is."""
    task = point.task
    modes = [(rounded(mode.frequency), rounded(mode.damping)) for mode in flexible_modes(task.model, gains=gains)]
    if not modes:
        raise ControlError(
            "under this feedback no mode has a damping ratio below 0.5, so there is nothing to shape for; what remains is feedback "
            "tracking alone"
        )
    lasting = shaper(kind, modes).duration
    lines = [Line("shaper", "invtrack.baselines.shaper", [kind, modes])]
    profile = task.reference_lines(rounded(point.duration - lasting), point.smoothness, target="profile")
    if profile:
        if not lasting < 0.9 * point.duration:
            raise ControlError(
                f"the shaper alone takes {lasting:.3g} s of the {point.duration:.3g} s for the motion; allow a longer motion"
            )
        lines += profile
    lines.append(Line("command", "shaper.shaped", [Name("profile" if profile else "reference")]))
    options = {"gains": Name("gains"), "command": Name("command")}
    lines.append(Line("plan", "invtrack.baselines.feedback_tracking", [Name("model"), Name("reference")], options))
    return lines


def _approximate(kind: str) -> Callable[[Point], Sequence[Line]]:
    def lines(point: Point) -> Sequence[Line]:
        hold = rounded(point.duration / HOLDS)
        options = {"kind": kind, "hold": hold}
        line = Line("plan", "invtrack.baselines.approximate_inverse", [Name("model"), Name("reference")], options)
        return (line, gain_line("plan"), controller_line({"period": hold}))

    return lines


WAYS: tuple[Way, ...] = (
    Way("quadratic redesign", _quadratic(1.0), offsets=(-2, -1, 0, 2), durations=True, gives_up=1.0),
    Way("quadratic redesign", _quadratic(TIGHTER), offsets=(-1, 0, 2), gives_up=TIGHTER),
    Way("constrained redesign", _constrained, offsets=(-1, 0), durations=True, within_limits=True, gives_up=TIGHTER),
    Way("stable inversion", _exact, offsets=(-1, 0, 2), durations=True),
    Way("stable inversion of the motion", _motion, mechanism=True, follows="stable inversion"),
    Way("quadratic redesign of the motion", _quadratic_motion, mechanism=True, gives_up=1.0, follows="quadratic redesign"),
    Way(
        "constrained redesign of the motion",
        _constrained_motion,
        mechanism=True,
        within_limits=True,
        gives_up=TIGHTER,
        follows="constrained redesign",
    ),
    Way("modified inversion", _modified),
    Way("modified inversion of the motion", _modified_motion, mechanism=True),
    Way("causal inverse", _causal),
    Way("feedback alone", _following(0)),
    Way("feedback and rigid feedforward", _following(2)),
    Way("feedback and postures", _postures, mechanism=True),
    *(Way(f"{kind} shaper under feedback", _shaped(kind)) for kind in ("ZV", "ZVD", "EI")),
    *(Way(f"{kind} shaper on a base servo", _shaped_on_servo(kind)) for kind in ("ZV", "ZVD", "EI")),
    *(Way(kind, _approximate(kind)) for kind in ("ZPETC", "ZMETC")),
)
"""All of them, in the order in which a table shows what is otherwise equal."""
