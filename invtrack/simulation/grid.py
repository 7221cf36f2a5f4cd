"""From breakpoints to steps: every breakpoint lies exactly on a step boundary."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.control.protocol import Instants, Planned
from invtrack.errors import SimulationError

SNAP = 1e-9
"""Breakpoints closer than this share of the largest step are one and the same, computed in two ways."""


MOST_STEPS = 5e7
"""Steps of a run at most: every one of them is recorded."""

MOST_UPDATES = 20_000_000
"""More updates in one run than this are taken for a mistake in the period."""


@dataclass(frozen=True, eq=False)
class Grid:
    """N steps between N + 1 times [s].

    edges (m + 1,): the breakpoints between which steps are even. first_step (m + 1,): number of the first step after each edge.
    step (m,) [s]: length of the steps in each interval. time (N + 1,).
    """

    edges: Array
    first_step: Indices
    step: Array
    time: Array

    @property
    def n_steps(self) -> int:
        """Number of steps N."""
        return len(self.time) - 1

    @property
    def interval(self) -> Indices:
        """Index of the interval of each step (N,)."""
        return np.repeat(np.arange(len(self.step)), np.diff(self.first_step))

    @property
    def middles(self) -> Array:
        """Middle of each interval (m,) [s]: a time that is certainly on the right side of every breakpoint."""
        return np.asarray((self.edges[:-1] + self.edges[1:]) / 2)

    @property
    def middle(self) -> Array:
        """Middle of the interval of each step (N,) [s]."""
        return self.middles[self.interval]

    @property
    def alike(self) -> Array:
        """Lengths of the steps in each interval (m,) [s], one and the same number for those that differ by rounding of times."""
        order = np.argsort(self.step, kind="stable")
        rounding = 8 * np.finfo(float).eps * np.max(np.abs(self.edges))
        group = np.cumsum(np.diff(self.step[order], prepend=self.step[order[0]]) > rounding)
        result = np.empty_like(self.step)
        result[order] = self.step[order][np.searchsorted(group, group)]
        return result

    def edge_index(self, t: float) -> int | None:
        """Index of the edge at time t, or None where t lies outside the grid."""
        nearest = int(np.argmin(np.abs(self.edges - t)))
        return nearest if abs(self.edges[nearest] - t) <= SNAP * self.step.max() else None


def make_grid(start: float, end: float, breakpoints: Iterable[float], timestep: float) -> Grid:
    """Divide [start, end] at the breakpoints inside it, and each interval evenly into steps not longer than `timestep` [s].

    Raises SimulationError for a time step or a span that is not positive, or more than MOST_STEPS steps.
    """
    if not (np.isfinite(timestep) and timestep > 0):
        raise SimulationError(f"the time step must be a positive number of seconds, got {timestep}")
    if not (np.isfinite(start) and np.isfinite(end) and end > start):
        raise SimulationError(f"the run must end after it starts, got start {start} s and end {end} s")
    edges = _edges(start, end, np.unique(np.fromiter(breakpoints, dtype=float)), SNAP * timestep)
    lengths = np.diff(edges)
    if np.sum(lengths) / timestep > MOST_STEPS:
        raise SimulationError(
            f"a run of {end - start:.6g} s in steps of {timestep:g} s takes {np.sum(lengths) / timestep:.1e} steps, more than the "
            f"{MOST_STEPS:.0e} that can be recorded; take a larger time step or a shorter run"
        )
    counts = np.maximum(np.ceil(lengths / timestep * (1 - SNAP)), 1).astype(np.intp)
    first = np.concatenate([[0], np.cumsum(counts)])
    step = np.arange(first[-1]) - np.repeat(first[:-1], counts)  # number of each within its interval
    time = np.repeat(edges[:-1], counts) + np.repeat(lengths, counts) * step / np.repeat(counts, counts)
    return Grid(edges, first, lengths / counts, np.append(time, end))


def _edges(start: float, end: float, times: Array, apart: float) -> Array:
    """start, end, and those of rising times between them that are further than that from the edge before them and from the end."""
    inside = times[(times > start) & (times < end)]
    if np.any(np.diff(inside, prepend=start) <= apart):  # one and the same time, computed in two ways: the first one counts
        kept = [start]
        for t in inside.tolist():
            if t - kept[-1] > apart:
                kept.append(t)
        inside = np.array(kept[1:])
    return np.concatenate([[start], inside[end - inside > apart], [end]])


def update_times(start: float, end: float, period: float | None) -> Array:
    """start + k period before end [s]; empty where the controller acts in every step. Raises SimulationError for too many."""
    if period is None:
        return np.zeros(0)
    count = int(np.ceil((end - start) / period * (1 - SNAP)))
    if count > MOST_UPDATES:
        raise SimulationError(f"a period of {period} s means {count} updates in this run; the limit is {MOST_UPDATES}")
    return np.asarray(start + period * np.arange(count), dtype=float)


def updates_of_steps(grid: Grid, times: Array) -> Indices:
    """Number of the update whose input holds in each step (N,): all different where `times` is empty."""
    if times.size == 0:
        return np.arange(grid.n_steps)
    middle = (grid.time[:-1] + grid.time[1:]) / 2  # no step holds an update in its inside
    return np.searchsorted(times, middle, side="right") - 1


def held_instants(grid: Grid, update: Indices, planned: Planned | None = None) -> Instants:
    """One instant per update; the parts of its hold are the steps.

    Args:
        grid: the steps.
        update: number of the update whose input holds in each step (N,).
        planned: what is known of a plan: its states at the grid's times, its inputs in the middles of the steps.
    """
    length = grid.step[grid.interval]
    first = np.flatnonzero(np.diff(update, prepend=-1))
    hold = np.add.reduceat(length, first)
    return Instants(
        time=grid.time[first],
        hold=hold,
        inside=grid.middle[first],
        first=first,
        part_middle=(grid.time[:-1] + grid.time[1:]) / 2,
        part_inside=grid.middle,
        part_share=length / hold[update],
        planned=None if planned is None else Planned(planned.plan, planned.states[first], planned.part_inputs),
    )


def stage_instants(grid: Grid) -> Instants:
    """Start, middle and end of each step; nothing is held."""
    begin, end = grid.time[:-1], grid.time[1:]
    time = np.column_stack([begin, (begin + end) / 2, end]).ravel()
    inside = np.repeat(grid.middle, 3)
    return Instants.undivided(time, np.zeros(len(time)), inside)
