"""Limits against a trajectory: where they are imposed, and by how much they are exceeded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.errors import RedesignError
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.limited.discretization import Grid
from invtrack.redesign.limits import Bound

STEP_SHARES = np.arange(17) / 16
"""Shares of a step at which its worst excess is looked for; a parabola through the largest and its neighbours finds what lies
between."""

TAIL_SAMPLES = 4000
"""Instants at which a tail is looked at, half of them evenly spread, half the denser the nearer to the manoeuvre."""

TAIL_DECAY = 40.0
"""Time constants of its slowest mode over which a tail is looked at."""


LEAST_MARGIN = 1e-6
"""How far inside its limits a plan must be at rest, as a share of their size: a tail that dies out there keeps within them."""


@dataclass(frozen=True, eq=False)
class PathPoints:
    """Where limits on states and outputs are imposed: number of the bound, step and share of that step, all (k,)."""

    bound: Indices
    step: Indices
    share: Array

    def joined(self, other: PathPoints) -> PathPoints:
        """Both sets."""
        return PathPoints(
            np.concatenate([self.bound, other.bound]),
            np.concatenate([self.step, other.step]),
            np.concatenate([self.share, other.share]),
        )


def grid_points(grid: Grid, bounds: Sequence[Bound]) -> PathPoints:
    """Every limit on states and outputs at the start of every step, and at the end of those where the next one differs."""
    steps = len(grid.kind)
    switches = np.flatnonzero(np.diff(grid.owner))
    ends = np.unique(np.concatenate([grid.jumps - 1, switches, [steps - 1]]))
    step = np.concatenate([np.arange(steps), ends])
    share = np.concatenate([np.zeros(steps), np.ones(len(ends))])
    numbers = [k for k, bound in enumerate(bounds) if bound.kind == "path"]
    return PathPoints(np.repeat(numbers, len(step)).astype(np.intp), np.tile(step, len(numbers)), np.tile(share, len(numbers)))


def values_between(trajectory: Trajectory, bounds: Sequence[Bound], shares: Array) -> Array:
    """What is limited, at these shares (s,) of each piece between breakpoints: (bounds, pieces, s)."""
    edges = trajectory.breakpoints
    times = (edges[:-1, None] + np.diff(edges)[:, None] * shares).ravel()
    piece = np.repeat(np.arange(1, len(edges)), len(shares))
    plain = trajectory(times, piece)
    rate = trajectory.derivative()(times, piece) if any(b.kind == "input rate" for b in bounds) else plain
    inside = np.repeat(edges[:-1] + np.diff(edges) / 2, len(shares))
    values = [(rate if bound.kind == "input rate" else plain) @ bound.row + bound.rest_at(inside) for bound in bounds]
    return np.array(values).reshape(len(bounds), len(edges) - 1, len(shares))


def worst_within_steps(trajectory: Trajectory, bounds: Sequence[Bound]) -> tuple[Array, Array]:
    """Largest excess of each limit within each step, as a share of its size, and the share of the step: (bounds, steps) both."""
    values = values_between(trajectory, bounds, STEP_SHARES)
    return tops(np.array([bound.excess(value) for bound, value in zip(bounds, values, strict=True)]))


def tops(values: Array) -> tuple[Array, Array]:
    """Largest of values (..., steps, shares) at STEP_SHARES within each step, and the share of the step, both (..., steps)."""
    best = np.argmax(values, axis=-1)
    middle = np.clip(best, 1, len(STEP_SHARES) - 2)
    left, centre, right = (np.take_along_axis(values, (middle + k)[..., None], axis=-1)[..., 0] for k in (-1, 0, 1))
    bend = left - 2 * centre + right
    vertex = (left - right) / (2 * np.where(bend < 0, bend, 1.0))
    within = (bend < 0) & (np.abs(vertex) <= 1)  # also where the largest is the step's end: the vertex may lie beside it
    offset = np.where(within, vertex, best - middle)
    top = np.where(within, centre - (left - right) * vertex / 4, np.max(values, axis=-1))
    return top, (middle + offset) / (len(STEP_SHARES) - 1)


def tail_excess(tail: Tail, bounds: Sequence[Bound]) -> Array:
    """How far each limit is exceeded within a tail, as a share of its size: (bounds,)."""
    sigma, end = np.zeros(1), 0 if tail.direction < 0 else -1
    if tail.departs:
        modes = np.linalg.eigvals(tail.departure.M)
        horizon = TAIL_DECAY / -np.max(modes.real)
        nearest = 1e-3 / np.max(np.abs(modes))
        half = TAIL_SAMPLES // 2
        sigma = np.union1d(np.linspace(0.0, horizon, half), np.geomspace(min(nearest, horizon / 2), horizon, half))
    plain, rate = (each.values(sigma, slice(None), 0.0) for each in (tail, tail.derivative()))
    values = [(rate if bound.kind == "input rate" else plain) @ bound.row + bound.rest[end] for bound in bounds]
    return np.array([np.max(bound.excess(value)) for bound, value in zip(bounds, values, strict=True)])


def require_rest_within(tails: tuple[Tail, Tail], bounds: Sequence[Bound]) -> None:
    """Raises RedesignError where the plan at rest lies outside a limit, or so near to one that nothing may move there."""
    for tail, when in zip(tails, ("before", "after"), strict=True):
        for bound in bounds:
            moved = bound.rest[0 if tail.direction < 0 else -1]
            rest = 0.0 if bound.kind == "input rate" else float(bound.row @ tail.held + moved)
            if bound.excess(np.array(rest)) > -LEAST_MARGIN:
                at, low, high = rest + bound.offset, bound.low + bound.offset, bound.high + bound.offset
                raise RedesignError(
                    f"limits that cannot be kept: at rest {when} the manoeuvre {bound.name} is {at:.6g}, expected strictly between "
                    f"its limits {low:.6g} and {high:.6g} (off by {max(low - at, at - high):.3g}); loosen that limit, or choose "
                    "another operating point or held value"
                )
