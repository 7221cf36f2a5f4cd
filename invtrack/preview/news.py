"""What is new at an update: by how much y^(r) at a later time changes what a plan asks of the present."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.linear.propagation import Propagator
from invtrack.preview.law import PreviewLaw

NODES, SHARES = np.polynomial.legendre.leggauss(3)
"""Of an integral over a panel."""


@dataclass(frozen=True, eq=False)
class News:
    """What each update gets to know, in cells of time, and how much of it the loop is given to take in.

    Args:
        law: what is planned.
        entry: e for a change of phi, of each interval (n, n_b).
        start, period, preview: of the planner [s].
        numbers: the first and the last update that matters; of a plant that does not switch one will do, for all are alike.
    """

    law: PreviewLaw
    entry: Sequence[Array]
    start: float
    period: float
    preview: float
    numbers: tuple[int, int]

    def of(self, updates: Indices) -> tuple[Array, Array]:
        """Edges [s] of the cells of what these updates get to know (k, c + 1), and e for a kick of chi in each (k, c, n, p)."""
        first, edges, columns = self._made
        if len(self.law.plant.switch_times):
            chosen = slice(updates[0] - first, updates[-1] + 1 - first)
            return edges[chosen], columns[chosen]
        return edges + self.period * (updates[:, None] - first), np.broadcast_to(columns, (len(updates), *columns.shape[1:]))

    @cached_property
    def _made(self) -> tuple[int, Array, Array]:
        """The same of all updates that matter, and the first one's number; without jumps they are all alike, and one will do."""
        times = self.law.plant.switch_times
        updates = np.arange(self.numbers[0], self.numbers[1] + 1)
        edges = self._edges(updates)
        later = self._nodes(edges)
        instants = np.repeat(self.start + self.period * updates, later.shape[1])
        entry = np.stack(list(self.entry))[np.searchsorted(times, instants, side="right")]
        columns = entry @ sensitivities(self.law, instants, later.ravel())
        return int(updates[0]), edges, columns.reshape(*later.shape, *columns.shape[1:])

    def _edges(self, updates: Indices) -> Array:
        """Edges [s] of the cells of what each update gets to know (k, c + 1), cut at the jumps of the plant."""
        begins = self.start + self.period * updates + (self.preview - self.period)
        times = self.law.plant.switch_times
        first, last = times.searchsorted(begins, side="right"), times.searchsorted(begins + self.period, side="left")
        most = int(np.max(last - first, initial=0))
        cuts = np.empty((len(updates), most + 2))
        cuts[:, 0], cuts[:, -1] = begins, begins + self.period
        for number in range(1, most + 1):  # where there are fewer jumps, the rest of the period is cut evenly
            jump = first + number - 1
            even = cuts[:, number - 1] + (cuts[:, -1] - cuts[:, number - 1]) / (most + 2 - number)
            cuts[:, number] = np.where(jump < last, times[np.minimum(jump, len(times) - 1)], even) if len(times) else even
        panels = panels_within(self.law, self.period)
        shares = np.concatenate([[0.0], np.cumsum(np.tile(SHARES / 2 / panels, panels))])[:-1]
        within = cuts[:, :-1, None] + np.diff(cuts)[:, :, None] * shares
        return np.column_stack([within.reshape(len(updates), -1), cuts[:, -1]])

    def _nodes(self, edges: Array) -> Array:
        """The nodes (k, c) of cells with these edges (k, c + 1)."""
        stretches = edges[:, :: len(NODES)]
        return np.asarray((stretches[:, :-1, None] + np.diff(stretches)[:, :, None] * (NODES + 1) / 2).reshape(len(edges), -1))


def fastest_ahead(law: PreviewLaw) -> float:
    """How fast what lies ahead fades, at most [rad/s]."""
    rates = [np.abs(np.linalg.eigvals(each.system.backward.A)) for each in law.intervals]
    return max(float(np.max(rate, initial=0.0)) for rate in rates)


def panels_within(law: PreviewLaw, period: float) -> int:
    """Into how many panels a period [s] is cut for integrals over what is new in it."""
    return max(1, math.ceil(period * fastest_ahead(law)))


def sensitivities(law: PreviewLaw, time: Array, later: Array) -> Array:
    """d phi(time) / d chi(later) (k, n_b, p), for outputs that go on as polynomials; each time (k,) [s] has a later one.

    A kick of chi at a later time s adds rho(s) to phi right before it, rho = Phi G_f - G_b + (what the polynomials after it ask at
    the jumps); from there phi decays back to the time in question, through the jumps between.
    """
    times = law.plant.switch_times
    here, there = (np.searchsorted(times, t, side="right") for t in (time, later))
    found = np.empty((len(later), len(law.intervals[-1].G_b), law.plant.n_outputs))
    for k in np.unique(there).tolist():
        found[there == k] = _kicks(law, k, later[there == k])
    at = later.copy()
    for k in range(len(times), 0, -1):
        passing = (there >= k) & (here < k)
        if np.any(passing):
            back = law.junctions[k - 1].back
            found[passing] = back @ (_decays(law, k, at[passing] - times[k - 1]) @ found[passing])
            at[passing] = times[k - 1]
    for k in np.unique(here).tolist():
        chosen = here == k
        found[chosen] = _decays(law, k, at[chosen] - time[chosen]) @ found[chosen]
    return found


def _kicks(law: PreviewLaw, interval: int, time: Array) -> Array:
    """rho (k, n_b, p) at times (k,) in an interval."""
    each = law.intervals[interval]
    if interval == len(law.plant.switch_times):
        return np.broadcast_to(-each.G_b, (len(time), *each.G_b.shape))
    junction, left = law.junctions[interval], law.plant.switch_times[interval] - time
    forward = each.system.propagators[0].matrices(left)
    onward = Propagator(law.extension).matrices(left)[:, :, : law.chain.size] @ law.chain.entry
    return np.asarray(_decays(law, interval, left) @ (junction.ahead @ forward @ each.G_f + junction.held @ onward) - each.G_b)


def _decays(law: PreviewLaw, interval: int, duration: Array) -> Array:
    """exp(-A_b tau) (k, n_b, n_b)."""
    return law.intervals[interval].system.propagators[1].matrices(np.maximum(duration, 0.0))
