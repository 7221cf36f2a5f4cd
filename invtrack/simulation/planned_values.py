"""A plan's values on the grid of a run; those on long stretches are kept for the next runs."""

from __future__ import annotations

import threading
from collections import OrderedDict
from dataclasses import dataclass, field
from weakref import WeakKeyDictionary

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.plans.plan import Plan, Samples
from invtrack.simulation.grid import Grid

LONG = 500
"""Steps in an interval of the grid from which on it is worth a look whether an earlier run had the same."""

KEPT = 2**22
"""Numbers that are kept for each plan, at most (32 MB)."""


Stretch = tuple[float, float, int]
"""Even steps: where they begin and end [s], and how many they are."""


@dataclass(frozen=True, eq=False)
class _Stretches:
    """Values of one plan on stretches, those asked for last; KEPT numbers in all."""

    known: OrderedDict[Stretch, Array] = field(default_factory=OrderedDict)
    lock: threading.Lock = field(default_factory=threading.Lock)

    def find(self, stretch: Stretch) -> Array | None:
        with self.lock:
            if stretch in self.known:
                self.known.move_to_end(stretch)
            return self.known.get(stretch)

    def keep(self, stretch: Stretch, values: Array) -> None:
        with self.lock:
            self.known[stretch] = values
            while sum(kept.size for kept in self.known.values()) > KEPT:
                self.known.popitem(last=False)


_known: WeakKeyDictionary[Plan, _Stretches] = WeakKeyDictionary()


def planned_values(plan: Plan, grid: Grid) -> tuple[Samples, Array]:
    """The plan's values at the times of a grid of N steps, and its inputs in the middles of these (N, m).

    Runs that differ in a few instants have most of their steps in common: an interval of many steps is evaluated by itself, so that
    what comes out does not depend on the runs before, and once for all of them.
    """
    counts, stretches = np.diff(grid.first_step), _known.setdefault(plan, _Stretches())
    n, m, p = plan.model.n_states, plan.model.n_inputs, plan.model.n_outputs
    values = np.empty((grid.n_steps + 1, n + 2 * m + 2 * p))
    by_itself = counts >= LONG
    for k in np.flatnonzero(by_itself).tolist():
        first, last = grid.first_step[k : k + 2].tolist()
        stretch = float(grid.edges[k]), float(grid.edges[k + 1]), last - first
        found = stretches.find(stretch)
        if found is None:
            found = _evaluated(plan, grid, np.arange(first, last))
            stretches.keep(stretch, found)
        values[first:last] = found
    others = np.flatnonzero(~by_itself[grid.interval])
    values[others] = _evaluated(plan, grid, others)
    end = plan(grid.time[-1:], inside=grid.middle[-1:])
    values[-1] = np.concatenate([end.x[0], end.u[0], end.y[0], end.y_d[0], end.u[0]])
    x, u, y, y_d, middle_inputs = np.split(values, np.cumsum([n, m, p, p]), axis=1)
    return Samples(grid.time, x, u, y, y_d), middle_inputs[:-1]


def _evaluated(plan: Plan, grid: Grid, steps: Indices) -> Array:
    """x, u, y and y_d at the starts of some steps (k,), and u in their middles, side by side (k, .)."""
    inside = grid.middle[steps]
    samples = plan(grid.time[steps], inside=inside)
    middle_inputs = plan.inputs((grid.time[steps] + grid.time[steps + 1]) / 2, inside=inside)
    return np.hstack([samples.x, samples.u, samples.y, samples.y_d, middle_inputs])
