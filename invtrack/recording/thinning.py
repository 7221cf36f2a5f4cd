"""Which samples of a run its recording shows: few enough for a viewer, and all that a person could see.

A run is cut into buckets of as many samples each, so short that `COLUMNS` of them fill the interval with which the plots open and
`PER_PERIOD` a period of the slowest vibration, during the manoeuvre also so short that `IN_MANOEUVRE` of them fill that. A series
keeps the first sample of each bucket, and the least and the largest of every channel where these lie beyond both ends of the
bucket, as M4 keeps them for the columns of pixels of a plot (Jugel, Jerzak, Hackenbroich, Markl, VLDB 2014): a smooth series
costs one row a bucket, and no peak is lost, however short. Around whatever happens at an instant every sample is kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.results.result import RunResult

COLUMNS = 2000
"""Buckets in the interval with which the plots open: about a column of pixels each on a plot as wide as a screen."""

PER_PERIOD = 20
"""Buckets in a period of the slowest vibration, so that its shape stays where the plots open on many periods."""

IN_MANOEUVRE = 1000
"""Buckets in the manoeuvre, for a close look at it where the plots open on much more."""

AROUND = 10
"""Samples that are kept on either side of an event, a change of a parameter, a gap in the values and the run's ends."""


@dataclass(frozen=True)
class Thinning:
    """What to keep of the series of one run.

    parts: of the run, each with the number of its first sample and that of samples in a bucket; they follow one another, from
    sample 0 on. marks: numbers of the samples (M,) at which something happens.
    """

    parts: tuple[tuple[int, int], ...]
    marks: NDArray[np.int64]

    def rows(self, values: Array) -> NDArray[np.int64]:
        """Numbers of the rows to keep (K,), in order, of the series `values` (rows, channels); its channels share them."""
        count, channels = values.shape
        kept = np.zeros(count, dtype=bool)
        ends = [first for first, _ in self.parts[1:]] + [count]
        parts = [(min(first, count), min(end, count), size) for (first, size), end in zip(self.parts, ends, strict=True)]
        for first, end, size in parts:
            kept[first:end:size] = True
            kept[end - (end - first) % size : end] = True  # what is left over for a last bucket
        marks = self.marks
        for channel in range(channels if any(size > 1 for _, size in self.parts) else 0):
            series = np.ascontiguousarray(values[:, channel], dtype=float)
            gaps = np.isnan(series)
            low = high = series
            if gaps.any():
                marks = np.union1d(marks, np.flatnonzero(gaps[1:] != gaps[:-1]) + 1)
                low, high = np.where(gaps, np.inf, series), np.where(gaps, -np.inf, series)
            for first, end, size in parts:
                kept[_extremes(low, high, first, end, size)] = True
        for offset in range(-AROUND, AROUND + 1):
            near = marks + offset
            kept[near[(near >= 0) & (near < count)]] = True
        return np.flatnonzero(kept)


def thinning(run: RunResult, interval: tuple[float, float], *, every_sample: bool = False) -> Thinning:
    """The thinning of a run for people to look at.

    interval: with which the plots open [s]. every_sample: keep all.
    """
    if every_sample or len(run.time) < 2:
        return Thinning(((0, 1),), np.zeros(0, dtype=np.int64))
    period = run.vibration_period if np.isfinite(run.vibration_period) else np.inf
    bucket = min((interval[1] - interval[0]) / COLUMNS, period / PER_PERIOD)
    begins, ends = run.manoeuvre
    in_manoeuvre = min(bucket, (ends - begins) / IN_MANOEUVRE)
    step = (run.time[-1] - run.time[0]) / (len(run.time) - 1)
    firsts = [0, *np.searchsorted(run.time, run.manoeuvre).tolist()]
    sizes = [max(int(length / step), 1) for length in (bucket, in_manoeuvre, bucket)]
    instants = [time for event in run.events for time in (event.time, event.until) if time is not None]
    changed = np.any(run.parameters.values[1:] != run.parameters.values[:-1], axis=1)
    jumps = np.flatnonzero(changed & ~np.concatenate([[False], changed[:-1]])) + 1  # of a drift its beginning
    marks = np.concatenate([np.searchsorted(run.time, instants), jumps, [0, len(run.time) - 1]])
    return Thinning(tuple(zip(firsts, sizes, strict=True)), np.unique(marks))


def _extremes(low: Array, high: Array, first: int, end: int, size: int) -> NDArray[np.int64]:
    """Places of the least of `low` and the largest of `high` in each whole bucket from `first` to `end`, if beyond its ends.

    The ends of a bucket are its first sample and that of the next one; what equals the latter is a step down or up to it, and kept.
    """
    whole = (end - first) // size
    inside = slice(first, first + whole * size)
    starts = first + size * np.arange(whole)
    following = np.minimum(starts + size, len(low) - 1)
    least = starts + low[inside].reshape(whole, size).argmin(axis=1)
    largest = starts + high[inside].reshape(whole, size).argmax(axis=1)
    return np.concatenate([least[low[least] <= low[following]], largest[high[largest] >= high[following]]])
