"""The error of an output at an instant as an integral over y^(r): what the loop has left of each update's news."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.errors import PlanError
from invtrack.preview.closed_loop import FORGOTTEN, Loop, Remembered
from invtrack.preview.law import PreviewLaw
from invtrack.preview.news import NODES, SHARES, News, panels_within, sensitivities

MOST_VALUES = 4 * 10**6
"""Values under an integral, at most: with more the period is too short beside the memory of the loop."""

PER_RADIAN = 6.0
"""Instants per radian of the loop's fastest mode at which the largest error is looked for."""

MOST_INSTANTS = 1500
"""Instants around the jumps of a plant, at most, at which it is looked for."""

MOST_PHASES = 32
"""Instants within a period, at most."""

MOST_PANELS = 10**5
"""Panels of what lies ahead, at most."""

CHANGES = 32
"""Instants around the jumps at which the changes of a plan are looked for."""

ROUNDS, CLOSER = 2, 12
"""How often the search goes on between the neighbours of the largest, and with how many instants."""


@dataclass(frozen=True, eq=False)
class Missed:
    """e(time) = integral of values(s) chi(s) ds: values (k, p) of one output's error at the middles of cells.

    edges: of the cells (k + 1,) [s].
    """

    time: float
    edges: Array
    values: Array

    @property
    def gain(self) -> Array:
        """Largest |e| for |chi_j| <= 1 in one input channel of the integral at a time (p,)."""
        return np.asarray(np.diff(self.edges) @ np.abs(self.values))


@dataclass(frozen=True, eq=False)
class Kernel:
    """Of a loop around a planner that has its updates at start + k period.

    Args:
        law: what is planned.
        loop: what takes in the news.
        start, period, preview: of the planner [s].
    """

    law: PreviewLaw
    loop: Loop
    start: float
    period: float
    preview: float

    @cached_property
    def alpha(self) -> float:
        """The slowest rate [rad/s] at which what lies ahead fades, before the first jump or after the last."""
        ends = (self.law.intervals[0], self.law.intervals[-1])
        return min(float(np.min(np.linalg.eigvals(each.system.backward.A).real, initial=math.inf)) for each in ends)

    @cached_property
    def _news(self) -> News:
        numbers = (0, 0)
        if len(self.law.plant.switch_times):
            first, last = self._numbers
            numbers = (first - self._memory, last)
        return News(self.law, self.loop.entry, self.start, self.period, self.preview, numbers)

    @cached_property
    def _remembered(self) -> Remembered:
        return Remembered(self.loop, self.start, self.period, self._memory)

    @property
    def _numbers(self) -> tuple[int, int]:
        """The first and the last update around the jumps."""
        first, last = (math.floor((t - self.start) / self.period) for t in self._around_jumps)
        return first, last

    def missed(self, number: int, phase: float, output: int) -> Missed:
        """The error of an output a phase [s], less than a period, after an update."""
        updates = np.arange(number - self._memory + 1, number + 1)
        time = self.start + self.period * number + phase
        rows = self._remembered.rows(number, phase)[:, output]
        edges, columns = self._news.of(updates)
        values = np.einsum("kn,kcnp->kcp", rows, columns).reshape(-1, self.law.plant.n_outputs)
        edges = np.append(edges[:, :-1].ravel(), edges[-1, -1])
        if not self.law.keeps_state:
            return Missed(time, edges, values)
        later, widths = self._ahead(edges[-1])
        n, m = self.law.plant.n_states, self.law.plant.n_inputs
        unknown = -self.law.intervals[0].columns[1][n + m + output] @ sensitivities(self.law, np.full(len(later), time), later)
        return Missed(time, np.concatenate([edges, edges[-1] + np.cumsum(widths)]), np.vstack([values, unknown]))

    def largest(self, output: int) -> Missed:
        """That at the instant at which the error of an output can be largest."""

        def size(number: int, phase: float) -> float:
            return float(self.missed(number, phase, output).gain.sum())

        numbers, phases = self._instants
        sizes = np.array([[size(number, phase) for phase in phases.tolist()] for number in numbers.tolist()])
        row, column = np.unravel_index(np.argmax(sizes), sizes.shape)
        number, width = int(numbers[row]), float(phases[1] - phases[0]) if len(phases) > 1 else self.period
        phase = float(phases[column])
        for _ in range(ROUNDS):
            closer = np.linspace(max(phase - width, 0.0), min(phase + width, self.period * (1 - 1e-9)), CLOSER)
            phase = float(closer[np.argmax([size(number, each) for each in closer.tolist()])])
            width = float(closer[1] - closer[0])
        return self.missed(number, phase, output)

    @cached_property
    def _instants(self) -> tuple[Indices, Array]:
        """Numbers of updates, and phases after each, at which the largest error is looked for."""
        step = 1 / (PER_RADIAN * self.loop.pace)
        if not len(self.law.plant.switch_times):
            return np.zeros(1, dtype=np.intp), np.linspace(
                0.0, self.period, min(max(4, math.ceil(self.period / step)), MOST_PHASES), endpoint=False
            )
        first, last = self._numbers
        step = max(step, (last + 1 - first) * self.period / MOST_INSTANTS)
        phases = np.linspace(0.0, self.period, min(math.ceil(self.period / step), MOST_PHASES), endpoint=False)
        return np.arange(first, last + 1, max(1, math.floor(step / self.period))), phases

    def changes(self) -> Array:
        """Most by which all that is not known can change [x; u; y] (n + m + p,), for |chi| <= 1."""
        times = self.law.plant.switch_times
        looked_at = np.linspace(*self._around_jumps, CHANGES) if len(times) else np.array([self.start])
        found = []
        for t in looked_at.tolist():
            later, widths = self._ahead(t + self.preview - self.period)
            interval = int(np.searchsorted(times, t, side="right"))
            moved = self.law.response(interval, self.law.slope(interval, t)) @ sensitivities(
                self.law, np.full(len(later), t), later
            )
            found.append(np.einsum("k,kip->i", widths, np.abs(moved)))
        return np.asarray(np.max(found, axis=0))

    @cached_property
    def _memory(self) -> int:
        """How many updates back the loop remembers."""
        count = math.ceil(self.loop.memory / self.period) + 1
        if count * len(NODES) * panels_within(self.law, self.period) * self.law.plant.n_states > MOST_VALUES:
            raise PlanError(
                f"the loop remembers what was new {self.loop.memory:.3g} s ago, {count} periods of {self.period:g} s: too many for "
                "a bound; take a longer period, or gains with faster poles"
            )
        return count

    @property
    def _around_jumps(self) -> tuple[float, float]:
        """The first and the last instant around the jumps at which the error differs from that without them [s]."""
        times, fade = self.law.plant.switch_times, -math.log(FORGOTTEN) / self.alpha if math.isfinite(self.alpha) else 0.0
        return float(times[0]) - self.preview - fade, float(times[-1]) + self.loop.memory

    def _ahead(self, time: float) -> tuple[Array, Array]:
        """Nodes from a time on until all has faded, and the widths of their cells [s]."""
        starts, widths = self._panels_ahead
        nodes = starts[:, None] + widths[:, None] * (NODES + 1) / 2
        return time + nodes.ravel(), (widths[:, None] * SHARES / 2).ravel()

    @cached_property
    def _panels_ahead(self) -> tuple[Array, Array]:
        """Starts, from where they are counted, and widths [s] of panels, each a radian of the fastest mode that is left there."""
        modes = np.concatenate([np.linalg.eigvals(each.system.backward.A) for each in self.law.intervals])
        faded, paces = -math.log(FORGOTTEN) / np.maximum(modes.real, self.alpha), np.abs(modes)
        starts: list[float] = []
        end = 0.0
        while np.any(faded > end):
            if len(starts) > MOST_PANELS:
                raise PlanError(
                    f"what lies ahead fades at {self.alpha:.3g} 1/s only, so slowly beside modes of {np.max(paces):.3g} rad/s that "
                    "a bound would take too long; move such zeros (invtrack.modified_inversion), or plan with the whole reference"
                )
            starts.append(end)
            end += 1 / float(np.max(paces[faded > end]))
        edges = np.array([*starts, end])
        return edges[:-1], np.diff(edges)
