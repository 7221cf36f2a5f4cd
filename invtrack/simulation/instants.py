"""When the controller is asked: in every step, every period, or at every stage of the integrator."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Instants
from invtrack.errors import SimulationError
from invtrack.simulation.grid import SNAP, Grid

Array = NDArray[np.float64]

MOST_UPDATES = 20_000_000
"""More updates in one run than this are taken for a mistake in the period."""


def update_times(start: float, stop: float, period: float | None) -> Array:
    """start + k period before stop [s]; empty where the controller acts in every step. Raises SimulationError for too many."""
    if period is None:
        return np.zeros(0)
    count = int(np.ceil((stop - start) / period * (1 - SNAP)))
    if count > MOST_UPDATES:
        raise SimulationError(f"a period of {period} s means {count} updates in this run; the limit is {MOST_UPDATES}")
    return np.asarray(start + period * np.arange(count), dtype=float)


def updates_of_steps(grid: Grid, times: Array) -> NDArray[np.intp]:
    """Number of the update whose input holds in each step (N,): all different where `times` is empty."""
    if times.size == 0:
        return np.arange(grid.n_steps)
    middle = (grid.time[:-1] + grid.time[1:]) / 2  # no step holds an update in its inside
    return np.searchsorted(times, middle, side="right") - 1


def held_instants(grid: Grid, update: NDArray[np.intp]) -> Instants:
    """One instant per update; the parts of its hold are the steps."""
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
    )


def stage_instants(grid: Grid) -> Instants:
    """Start, middle and end of each step; nothing is held."""
    begin, end = grid.time[:-1], grid.time[1:]
    time = np.column_stack([begin, (begin + end) / 2, end]).ravel()
    inside = np.repeat(grid.middle, 3)
    return Instants.undivided(time, np.zeros(len(time)), inside)
