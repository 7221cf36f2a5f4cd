"""A figure measured of a run, or why there is none."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import InvtrackError
from invtrack.results.result import RunResult

# Times on a run's grid are sums and quotients of floats: two that are meant to be equal differ by some units in the last place.
TIME_TOLERANCE = 1e-9


class Measured(NamedTuple):
    """A value, or None where the figure is not defined; the note says why, or what the value stands for."""

    value: float | None
    note: str = ""

    def required(self) -> float:
        """The value. Raises InvtrackError, with the reason, where there is none."""
        if self.value is None:
            raise InvtrackError(self.note)
        return self.value


def finite_rows(result: RunResult, values: Array) -> tuple[Array, str]:
    """The rows of `values` before the first that is not finite, or none and why: a completed run must have no such row."""
    bad = np.flatnonzero(~np.all(np.isfinite(values), axis=1))
    count = int(bad[0]) if len(bad) else len(values)
    if len(bad) and result.status == "completed":
        return values[:0], f"run {result.name!r} was completed, but is not finite at t = {result.time[count]:.9g} s"
    if not count:
        return values, f"run {result.name!r} has no finite sample to evaluate; {result.message or 'it holds no steps'}"
    return values[:count], ""


def time_tolerance(result: RunResult) -> float:
    """How far two times of a run [s] may be apart and still be meant to be equal."""
    return TIME_TOLERANCE * max(1.0, float(np.max(np.abs(result.time))))
