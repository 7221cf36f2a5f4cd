"""The motion that is left in the loop after a plan has changed: how it shows in the outputs later on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array
from invtrack.control.gains import GainSchedule
from invtrack.errors import ControlError, PlanError
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.propagation import Propagator
from invtrack.preview.law import PreviewLaw

DECAYS = 1e-12
"""A pole counts as stable where it is further left of the axis than this share of the fastest."""

KEPT = 64
"""Tables of the loop's motion that are kept, at most."""

FORGOTTEN = 1e-7
"""Share down to which the slowest mode of the loop is followed."""


@dataclass(frozen=True, eq=False)
class Loop:
    """e' = A_k e, y = C_k e on each interval of the plant, e continuous through the jumps.

    Args:
        A, C: of each interval (N + 1,): (n, n) and (p, n).
        entry: e for a change of phi, of each interval (n, n_b).
        switch_times: (N,) [s].
    """

    A: Sequence[Array]
    C: Sequence[Array]
    entry: Sequence[Array]
    switch_times: Array

    @classmethod
    def of_feedback(cls, law: PreviewLaw, gains: Sequence[Array]) -> Loop:
        """e = x - x_ref under u = u_ff - K e: a change of phi moves x_ref, and e by as much to the other side."""
        n = law.plant.n_states
        pairs = list(zip(law.plant.systems, gains, strict=True))
        return cls(
            A=[system.A - system.B @ K for system, K in pairs],
            C=[system.C - system.D @ K for system, K in pairs],
            entry=[-each.columns[1][:n] for each in law.intervals],
            switch_times=law.plant.switch_times,
        )

    @classmethod
    def of_optimum(cls, law: PreviewLaw) -> Loop:
        """e = x - x_opt under the optimum's own feedback, for a change of phi that comes from a time when it was not known."""
        (each,), (n, m) = law.intervals, (law.plant.n_states, law.plant.n_inputs)
        J_f, J_b = (part.J[:n] for part in (each.system.forward, each.system.backward))
        into = scipy.linalg.solve(J_f, np.eye(n))
        return cls([J_f @ each.system.forward.A @ into], [each.columns[0][n + m :] @ into], [-J_b], law.plant.switch_times)

    def __post_init__(self) -> None:
        for k in {0, len(self.A) - 1}:
            poles = np.linalg.eigvals(self.A[k]).astype(complex)
            fastest = float(np.max(np.abs(poles)))
            growing = poles[poles.real >= -DECAYS * fastest]
            if len(growing):
                raise PlanError(
                    f"these gains do not stabilize the plant: the loop has poles at {format_zeros(growing, fastest)} rad/s, so "
                    "that no bound exists; choose others, for instance invtrack.lqr(model, Q=1.0, R=1.0)"
                )

    @cached_property
    def memory(self) -> float:
        """Time [s] after which the slowest mode, before the first jump or after the last, is forgotten."""
        slowest = min(float(np.min(-np.linalg.eigvals(self.A[k]).real)) for k in (0, -1))
        return float(-np.log(FORGOTTEN) / slowest)

    @cached_property
    def pace(self) -> float:
        """How fast its modes move, at most [rad/s]."""
        return max(float(np.max(np.abs(np.linalg.eigvals(A)))) for A in self.A)

    def transitions(self, interval: int, duration: Array) -> Array:
        """exp(A tau) (k, n, n) of an interval, for times (k,) [s]."""
        return self._propagators[interval].matrices(np.maximum(duration, 0.0))

    @cached_property
    def _propagators(self) -> list[Propagator]:
        made = {id(A): Propagator(A) for A in self.A}
        return [made[id(A)] for A in self.A]


@dataclass(frozen=True, eq=False)
class Remembered:
    """How what the loop was given at each update shows in the outputs later on.

    Args:
        loop: the loop.
        start, period: updates are at start + k period [s].
        memory: how many updates back count.
    """

    loop: Loop
    start: float
    period: float
    memory: int

    def rows(self, number: int, phase: float) -> Array:
        """How e right after each update that is remembered shows in the outputs a phase after one of them (k, p, n)."""
        times, loop = self.loop.switch_times, self.loop
        time = self.start + self.period * number + phase
        updates = np.arange(number - self.memory + 1, number + 1)
        of = np.searchsorted(times, self.start + self.period * updates, side="right")
        interval = int(np.searchsorted(times, time, side="right"))
        result = np.empty((len(updates), *loop.C[0].shape))
        own = of == interval
        result[own] = self._table(interval, phase)[number - updates[own]]
        if np.all(own):
            return result
        rows = loop.C[interval] @ loop.transitions(interval, np.array([time - times[interval - 1]]))[0]
        for k in range(interval - 1, -1, -1):
            first, onward = self._until_jump[k]
            chosen = of == k
            result[chosen] = rows @ onward[updates[chosen] - first]
            if not k or of[0] == k:
                return result
            rows = rows @ self._across[k]
        return result

    def _table(self, interval: int, phase: float) -> Array:
        """C exp(A (phase + i period)) (k, p, n) for as many periods as are remembered."""
        if (interval, phase) not in self._tables:
            if len(self._tables) >= KEPT:
                self._tables.clear()
            duration = phase + self.period * np.arange(self.memory, dtype=float)
            self._tables[interval, phase] = np.asarray(self.loop.C[interval] @ self.loop.transitions(interval, duration))
        return self._tables[interval, phase]

    @cached_property
    def _tables(self) -> dict[tuple[int, float], Array]:
        return {}

    @cached_property
    def _across(self) -> dict[int, Array]:
        """exp(A L) (n, n) over each interval between two jumps."""
        lengths = np.diff(self.loop.switch_times)
        return {k: self.loop.transitions(k, lengths[k - 1 : k])[0] for k in range(1, len(lengths) + 1)}

    @cached_property
    def _until_jump(self) -> list[tuple[int, Array]]:
        """exp(A tau) (k, n, n) from each update in an interval that is remembered until the jump at its end; the first's number."""
        found = []
        for k, end in enumerate(self.loop.switch_times.tolist()):
            last = math.floor((end - self.start) / self.period)
            updates = np.arange(last - self.memory, last + 1)
            found.append((int(updates[0]), self.loop.transitions(k, end - self.start - self.period * updates)))
        return found


def gains_by_interval(law: PreviewLaw, gains: GainSchedule | ArrayLike) -> list[Array]:
    """The gain K (m, n) of each interval of the plant; raises ControlError for gains that do not fit."""
    plant = law.plant
    schedule = gains if isinstance(gains, GainSchedule) else GainSchedule([gains])
    shape = (plant.n_inputs, plant.n_states)
    if schedule.gains[0].shape != shape:
        raise ControlError(f"gains have shape {schedule.gains[0].shape}, expected {shape} for this plant's inputs and states")
    strange = np.setdiff1d(schedule.switch_times, plant.switch_times)
    if len(strange):
        raise ControlError(f"gains must switch where the plant does, at {plant.switch_times.tolist()} s, got {strange.tolist()} s")
    times = plant.switch_times
    inside = np.concatenate([times[:1] - 1.0, (times[:-1] + times[1:]) / 2, times[-1:] + 1.0]) if len(times) else np.zeros(1)
    return [schedule.gains[k] for k in schedule.interval(inside)]
