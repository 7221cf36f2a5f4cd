"""Where everything stands in a recording: entity paths, timelines, and which rows of a run they index.

    /<case>/run                         settings and events as JSON, the compiled MuJoCo model as bytes
    /<case>/time, qpos                  float64, one row per sample
    /<case>/<signal>/[<unit>]           float64, one row per sample: the channels of one signal that share a unit
    /<case>/error, log10_error, events, event_lines, scene    to look at, never read back

A recording that shares its layout with those of other cases has SHARED_ROOT in the place of <case>. Rows stand on two timelines:
`step`, the number of the sample, and `time`, a duration rounded to nanoseconds for people.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from invtrack.results.result import Array, RunResult, Signal

FORMAT = 2
"""Number of this layout, written into every recording; a reader refuses numbers that it does not know."""

ARCHETYPE = "invtrack"
"""Rerun archetype under which the fields stand that no Rerun archetype has: metadata, mjb, qpos."""

SHARED_ROOT = "case"
"""What a recording's only case stands under where recordings of several cases share one layout."""

STEP, TIME = "step", "time"

SAMPLED = ("state", "state_reference", "output", "reference", "planned_output")
"""Signals at the N + 1 times."""

HELD = ("commanded", "applied", "parameters", "measured", "estimate")
"""Signals that hold over the N steps; the last two only of controllers with sensors."""


def entity_path(case: str, *parts: str) -> str:
    """Path of an entity of one case, with every character that Rerun treats specially escaped.

    Rerun does not read its own escape of a backslash back, so that one is written as in a URL: %5C.
    """
    return str(rr.new_entity_path([re.sub(r"%(?=5C|25)", "%25", part).replace("\\", "%5C") for part in (case, *parts)]))


def unit_path(case: str, signal: str, unit: str) -> str:
    """Path of the channels of a signal that have this unit."""
    return entity_path(case, signal, f"[{unit}]")


def channels_by_unit(signal: Signal) -> dict[str, list[int]]:
    """Column numbers of a signal grouped by unit, in order of appearance: an axis of a plot can carry one unit only."""
    groups: dict[str, list[int]] = {}
    for column, unit in enumerate(signal.channels.units):
        groups.setdefault(unit, []).append(column)
    return groups


def time_columns(steps: NDArray[np.int64], times: Array) -> list[rr.TimeColumn]:
    """Both timelines for rows that belong to the samples `steps` and are shown at `times` [s]."""
    nanoseconds = np.round(times * 1e9).astype("timedelta64[ns]")
    return [rr.TimeColumn(STEP, sequence=steps), rr.TimeColumn(TIME, duration=nanoseconds)]


def send_rows(recording: rr.RecordingStream, path: str, indexes: Sequence[rr.TimeColumn], rows: Array) -> None:
    """Send a matrix (samples, channels) as Rerun scalars, one row per sample."""
    lengths = np.full(rows.shape[0], rows.shape[1])
    columns = rr.Scalars.columns(scalars=np.ascontiguousarray(rows).ravel()).partition(lengths)
    rr.send_columns(path, indexes, columns, recording=recording, strict=True)


def step_at(result: RunResult, times: Array) -> NDArray[np.int64]:
    """Number of the sample nearest to each of `times` [s]."""
    return np.searchsorted((result.time[1:] + result.time[:-1]) / 2, times)
