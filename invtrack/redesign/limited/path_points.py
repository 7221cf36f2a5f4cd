"""Instants at which limits on states and outputs are imposed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.redesign.limited.discretization import Grid
from invtrack.redesign.limits import Bound

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


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
    switches = np.flatnonzero(np.diff([id(grid.steps[k].system) for k in grid.kind]))
    ends = np.unique(np.concatenate([grid.jumps - 1, switches, [steps - 1]]))
    step = np.concatenate([np.arange(steps), ends])
    share = np.concatenate([np.zeros(steps), np.ones(len(ends))])
    numbers = [k for k, bound in enumerate(bounds) if bound.kind == "path"]
    return PathPoints(np.repeat(numbers, len(step)).astype(np.intp), np.tile(step, len(numbers)), np.tile(share, len(numbers)))
