"""Rows of a recording over time: on a timeline of the whole run, and on one that starts where the viewer is to start."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from invtrack.arrays import Array

STEP, TIME, SHOWN = "step", "time", "manoeuvre"
"""Timelines: numbers of samples, the clock, and the clock from where plots open on: a viewer starts where its timeline does."""


@dataclass(frozen=True)
class Stream:
    """What is sent to a recording. begin: from when on rows are on the timeline with which the viewer opens [s]."""

    recording: rr.RecordingStream
    begin: float

    def log(self, path: str, *archetypes: Any) -> None:
        """Send what stays as it is."""
        self.recording.log(path, *archetypes, static=True, strict=True)

    def send(
        self, path: str, steps: NDArray[np.int64], times: Array, columns: Iterable[rr.ComponentColumn], *, held: bool = False
    ) -> None:
        """Send rows over time.

        Args:
            path: of the entity.
            steps: numbers of the samples that the rows belong to (k,), increasing.
            times: at which the rows are shown (k,) [s], increasing.
            columns: their components.
            held: whether a row stays in force until the next one, also across `begin`.
        """
        columns, shown = list(columns), np.maximum(times, self.begin)
        first = int(np.searchsorted(times, self.begin))
        across = max(first - 1, 0) if held else first
        for part, timelines in ((slice(0, across), (STEP, TIME)), (slice(across, len(times)), (STEP, TIME, SHOWN))):
            if part.start < part.stop:
                rows = {STEP: steps[part], TIME: times[part], SHOWN: shown[part]}
                indexes = [_timeline(name, rows[name]) for name in timelines]
                taken: Any = [_Rows(column, part) for column in columns]
                rr.send_columns(path, indexes, taken, recording=self.recording, strict=True)

    def send_numbers(self, path: str, steps: NDArray[np.int64], times: Array, rows: Array, *, held: bool = False) -> None:
        """Send a matrix (k, channels) as scalars, one row per sample."""
        lengths = np.full(rows.shape[0], rows.shape[1])
        columns = rr.Scalars.columns(scalars=np.ascontiguousarray(rows).ravel()).partition(lengths)
        self.send(path, steps, times, columns, held=held)


def _timeline(name: str, values: Sequence[Any] | NDArray[Any]) -> rr.TimeColumn:
    if name == STEP:
        return rr.TimeColumn(STEP, sequence=values)
    return rr.TimeColumn(name, duration=np.round(np.asarray(values) * 1e9).astype("timedelta64[ns]"))


@dataclass(frozen=True)
class _Rows:
    """Some rows of a column, as `send_columns` takes columns."""

    column: rr.ComponentColumn
    rows: slice

    def component_descriptor(self) -> Any:
        return self.column.component_descriptor()

    def as_arrow_array(self) -> pa.Array:
        """The rows' arrays."""
        return self.column.as_arrow_array()[self.rows]
