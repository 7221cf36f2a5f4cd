"""What a controller is to the simulation: a law, prepared for the instants of a run; where it is affine, data."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, Protocol, TypeVar

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.control.gains import GainSchedule
from invtrack.plans.plan import Difference, Plan
from invtrack.references.signal import selection

Key = TypeVar("Key", bound=Hashable)

DIGITS = 9
"""Holds that agree in so many digits are the same."""

Segments = tuple[tuple[int, float], ...]
"""The intervals that a hold runs through, with the time [s] spent in each."""


@dataclass(frozen=True, eq=False)
class Planned:
    """What is known already of a plan at the instants of a run.

    Args:
        plan: the plan.
        states: at the instants (m, n), as deviations from the operating point.
        part_inputs: in the middles of the parts of the holds (k, p).
    """

    plan: Plan
    states: Array
    part_inputs: Array


@dataclass(frozen=True, eq=False)
class Instants:
    """The instants of a run at which a controller is asked for its input, known before the run starts.

    Breakpoints may fall into a hold. It therefore comes in parts without any: hold number i consists of the parts first[i] to
    first[i + 1] - 1.

    Args:
        time: when the plant is measured (m,) [s].
        hold: for how long the input is then held (m,) [s]; 0 where it is evaluated anew at every stage of the integrator.
        inside: a time in the open interval between the breakpoints around the instant (m,) [s], so that nobody has to guess which
            side of a breakpoint it belongs to.
        first: number of the first part of each hold (m,).
        part_middle: the middle of each part (k,) [s].
        part_inside: a time in the open interval between the breakpoints around each part (k,) [s].
        part_share: share of its hold that each part makes up (k,).
        planned: what is known already of a plan; None where nothing is.
    """

    time: Array
    hold: Array
    inside: Array
    first: Indices
    part_middle: Array
    part_inside: Array
    part_share: Array
    planned: Planned | None = None

    def states_of(self, plan: Plan) -> Array:
        """The plan's states (m, n) at the instants."""
        if self.planned is not None and self.planned.plan is plan:
            return self.planned.states
        return plan.states(self.time, inside=self.inside)

    def part_inputs_of(self, plan: Plan) -> Array:
        """The plan's inputs (k, p) in the middles of the parts of the holds."""
        if self.planned is not None and self.planned.plan is plan:
            return self.planned.part_inputs
        return plan.inputs(self.part_middle, inside=self.part_inside)

    @classmethod
    def undivided(cls, time: Array, hold: Array, inside: Array) -> Instants:
        """Instants whose holds contain no breakpoint: time, hold, inside (m,) [s]."""
        return cls(time, hold, inside, np.arange(len(time)), time + hold / 2, inside, np.ones(len(time)))

    def mean_over_hold(self, function: Callable[[Array, Array], Array]) -> Array:
        """Mean over each hold of function(times (k,), inside (k,)) -> (k, p), by the midpoint rule on its parts: (m, p).

        A held input with the mean of a wanted one does what that one does, up to an error of the order of the hold squared.
        """
        values = function(self.part_middle, self.part_inside) * self.part_share[:, None]
        return np.asarray(np.add.reduceat(values, self.first, axis=0))

    @property
    def part_owner(self) -> Indices:
        """Number of the hold that each part belongs to (k,)."""
        return np.repeat(np.arange(len(self.time)), np.diff(self.first, append=len(self.part_share)))

    def segments(self, interval: Callable[[Array], Indices]) -> list[Segments]:
        """What each hold runs through: ((interval, seconds), ...), the parts in one and the same interval taken together.

        interval: index of the interval of something that switches, from times inside them. Holds are equal but for rounding within
        an interval: to nine digits, so that what depends on them need be worked out once for all that agree.
        """
        owner, where = self.part_owner, interval(self.part_inside)
        starts = np.flatnonzero((np.diff(owner, prepend=-1) != 0) | (np.diff(where, prepend=-1) != 0))
        seconds = np.add.reduceat(self.part_share * self.hold[owner], starts)
        digit = 10.0 ** (np.floor(np.log10(np.maximum(seconds, np.finfo(float).tiny))) - (DIGITS - 1))
        pairs = list(zip(where[starts].tolist(), (np.rint(seconds / digit) * digit).tolist(), strict=True))
        edges = np.searchsorted(owner[starts], np.arange(len(self.time) + 1)).tolist()
        return [tuple(pairs[a:b]) for a, b in pairwise(edges)]


def numbered(keys: Iterable[Key]) -> tuple[list[Key], Indices]:
    """The keys without repetition, in the order in which they first come, and which (m,) of them each is."""
    numbers: dict[Key, int] = {}
    which = np.array([numbers.setdefault(key, len(numbers)) for key in keys], dtype=np.intp)
    return list(numbers), which


class Law(Protocol):
    """A controller prepared for the instants of one run; it may hold a state of its own."""

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) for instant number `index`.

        `measurement` is the plant's state (n,), as deviation from the operating point, or the values of its sensors (m,), whichever
        the controller measures.
        """
        ...

    @property
    def estimate(self) -> Array | None:
        """The state (n,), as deviation from the operating point, that the latest update went by; None if it was measured."""
        ...


class Controller(Protocol):
    """A feedback law around a planned trajectory. The same controller can be used in any number of runs."""

    @property
    def plan(self) -> Plan:
        """The trajectory that it follows: it sets the span of the run and what errors are measured against."""
        ...

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which its input may jump; each becomes a step boundary."""
        ...

    @property
    def period(self) -> float | None:
        """Time [s] between two updates; None: one in every physics step."""
        ...

    @property
    def measures(self) -> Literal["state", "sensors"]:
        """What an update is given."""
        ...

    @property
    def stateless(self) -> bool:
        """Whether the input depends on time and measurement alone, so that it may be evaluated at every stage of an integrator."""
        ...

    def begin(self, instants: Instants) -> Law:
        """The law for the instants of one run, everything that can be computed ahead done here."""
        ...


class AffineLaw:
    """u = offset_i - K_i x at instant i, everything that does not depend on the measurement worked out before the run.

    Args:
        offset: (m, p), absolute.
        gains: the distinct K (p, n).
        which: number of the gain in force at each instant (m,).
    """

    estimate = None

    def __init__(self, offset: Array, gains: Sequence[Array], which: Indices) -> None:
        self.offset, self.gains, self.which = offset, gains, which

    @classmethod
    def around(cls, feedforward: Array, x_ref: Array, gains: GainSchedule, inside: Array) -> AffineLaw:
        """u = feedforward_i - K_i (x - x_ref_i): feedforward (m, p), x_ref (m, n); inside (m,) [s] says which gain is in force."""
        which = gains.interval(inside)
        offset = feedforward.copy()
        for k, gain in enumerate(gains.gains):
            chosen = selection(which == k)
            if chosen is not None:
                offset[chosen] += x_ref[chosen] @ gain.T
        return cls(offset, gains.gains, which)

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) at instant number `index`."""
        result: Array = self.offset[index] - self.gains[int(self.which[index])] @ measurement
        return result


class DifferenceLaw:
    """u = feedforward_i - K_i (x minus x_ref_i) at instant i, the difference taken in the plant's own way.

    Args:
        feedforward: (m, p), absolute.
        x_ref: (m, n).
        gains, inside: the schedule, and times (m,) [s] that say which of its gains is in force.
        difference: x minus x_ref, both (n,).
    """

    estimate = None

    def __init__(self, feedforward: Array, x_ref: Array, gains: GainSchedule, inside: Array, difference: Difference) -> None:
        self.feedforward, self.x_ref, self.difference = feedforward, x_ref, difference
        self.gains, self.which = gains.gains, gains.interval(inside)

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) at instant number `index`."""
        away = self.difference(measurement, self.x_ref[index])
        result: Array = self.feedforward[index] - self.gains[int(self.which[index])] @ away
        return result
