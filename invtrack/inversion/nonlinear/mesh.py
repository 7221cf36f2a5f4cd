"""The mesh of a motion: elements between breakpoints, jumps of parameters and the ends of the window."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices

BESIDE = 3
"""Elements on either side of a stop that are near it."""

EVEN = 1e-9
"""A stretch that is longer than whole elements by no more than this share is as long as these."""


@dataclass(frozen=True, eq=False)
class Mesh:
    """N elements of time.

    Args:
        edges: times (N + 1,) [s].
        interval: which values of the parameters hold on each element (N,).
    """

    edges: Array
    interval: Indices

    @cached_property
    def lengths(self) -> Array:
        """Of the elements (N,) [s]."""
        return np.diff(self.edges)

    def __len__(self) -> int:
        """Number of elements N."""
        return len(self.interval)

    @classmethod
    def even(cls, stops: Array, switch_times: Array, length: float) -> Mesh:
        """Between stops (m + 1,) [s] even elements of at most that length [s]; switch times are among the stops."""
        counts = np.ceil(np.diff(stops) / length * (1 - EVEN)).astype(int).tolist()
        pairs = zip(counts, itertools.pairwise(stops.tolist()), strict=True)
        parts = [np.linspace(a, b, count + 1)[:-1] for count, (a, b) in pairs]
        return cls.of(np.append(np.concatenate(parts), stops[-1]), switch_times)

    @classmethod
    def of(cls, edges: Array, switch_times: Array) -> Mesh:
        """The elements between edges (N + 1,) [s]."""
        return cls(edges, np.searchsorted(switch_times, (edges[:-1] + edges[1:]) / 2, side="right"))

    def beside(self, stops: Array) -> Indices:
        """The elements near stops (k,) [s] and near changes of the parameters, where a motion changes fastest."""
        changes = np.flatnonzero(np.diff(self.interval)) + 1
        edges = np.concatenate([changes, np.searchsorted(self.edges, stops)])
        return np.unique(np.clip(edges[:, None] + np.arange(-BESIDE, BESIDE), 0, len(self) - 1))

    def split(self, parts: Indices) -> Mesh:
        """Each element in as many even parts as stated (N,)."""
        owner = np.repeat(np.arange(len(self)), parts)
        number = np.arange(len(owner)) - np.repeat(np.cumsum(parts) - parts, parts)
        starts = self.edges[owner] + number / parts[owner] * self.lengths[owner]
        return Mesh(np.append(starts, self.edges[-1]), self.interval[owner])

    def with_more(self, before: Array, after: Array) -> Mesh:
        """With further elements of these lengths (k,) [s] before and after it, from the inside outward."""
        first, last = self.edges[0] - np.cumsum(before)[::-1], self.edges[-1] + np.cumsum(after)
        interval = np.pad(self.interval, (len(before), len(after)), mode="edge")
        return Mesh(np.concatenate([first, self.edges, last]), interval)
