"""A motion from where the outputs stand, by so much in so long, whose smoothness and duration are still open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_number, real_numbers, require_duration
from invtrack.errors import TrajectoryError


@dataclass(frozen=True, eq=False, init=False)
class Move:
    """From where the outputs stand by `by`, from rest to rest, in `duration` at most.

    Args:
        by: distance of each output (p,), or one number, in their units.
        duration: [s].

    Raises TrajectoryError for distances that are not finite or all zero, and a duration that is not positive.
    """

    by: Array
    duration: float

    def __init__(self, by: ArrayLike, duration: float) -> None:
        distances = np.atleast_1d(real_numbers("by", by))
        if distances.ndim != 1 or not np.all(np.isfinite(distances)) or not np.any(distances):
            raise TrajectoryError(f"by must be a finite distance for each output (p,), not all zero, got {distances.tolist()}")
        require_duration("duration", duration)
        distances.setflags(write=False)
        object.__setattr__(self, "by", distances)
        object.__setattr__(self, "duration", real_number("duration", duration, unit="s"))

    def __repr__(self) -> str:
        """As it is written."""
        by = self.by.tolist()
        return f"Move({by[0] if len(by) == 1 else by!r}, {self.duration!r})"
