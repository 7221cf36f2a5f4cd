"""Limits that act in a run: what they are called, how far a run or a plan goes beyond them, and the events that tell of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.results.result import Event

NOTICEABLE = 1e-6
"""A limit acts where it takes away more than this share of its own size; less is the rounding of a motion that ends on it."""

EPISODE_GAP = 0.01
"""Episodes of one limit are one where what lies between them is shorter than this share of the manoeuvre."""

MOST_EPISODES = 20
"""Of more episodes of one limit those that lie closest to each other are told as one."""


@dataclass(frozen=True)
class ActingLimit:
    """A limit, as messages and events call it.

    Args:
        text: its name, such as "forcerange of u" or "contact of floor and foot".
        unit: of how far something is beyond it.
        kind: "limit", or "contact".
    """

    text: str
    unit: str = ""
    kind: Literal["limit", "contact"] = "limit"


@dataclass(frozen=True, eq=False)
class Stretches:
    """When one limit acted.

    Args:
        first, last: the first step (inclusive) and the last (exclusive) of each time that it did, (k,), in the order of time.
        most: how far beyond the limit it went each time, in the limit's unit, (k,).
    """

    first: Indices
    last: Indices
    most: Array

    @classmethod
    def of_excess(cls, excess: Array, *, first: int = 0) -> Stretches:
        """Where an excess over a limit (N,) is not zero, in steps that count from `first`."""
        ends = np.flatnonzero(np.diff(excess != 0, prepend=False, append=False)).reshape(-1, 2)
        most = np.array([excess[begin:end].max() for begin, end in ends])
        return cls(first + ends[:, 0], first + ends[:, 1], most)

    @classmethod
    def joined(cls, parts: Sequence[Stretches]) -> Stretches:
        """Those of one part after the other."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("first", "last", "most")))

    def until(self, step: int) -> Stretches:
        """The part before this step."""
        kept = self.first < step
        return Stretches(self.first[kept], np.minimum(self.last[kept], step), self.most[kept])


def size_of(limits: Array) -> Array:
    """Size of each range (..., 2): its width, the magnitude of the finite end of one that is half open, 0 of one that is open."""
    low, high = limits[..., 0], limits[..., 1]
    finite = np.where(np.isfinite(limits), np.abs(limits), 0.0).max(axis=-1)
    with np.errstate(invalid="ignore"):
        width = high - low
    return np.where(np.isfinite(width) & (width > 0), width, finite)


def noticeable(excess: Array, size: Array) -> Array:
    """How far beyond limits of these sizes, zero where that is rounding, a small share of the size."""
    return np.where(excess > NOTICEABLE * size, excess, 0.0)


def clipped(u: Array, limits: Array) -> tuple[Array, Array]:
    """Inputs (k, p) within limits (p, 2), and how far they were beyond them, (k, p)."""
    within = np.clip(u, limits[:, 0], limits[:, 1])
    return within, noticeable(np.abs(u - within), size_of(limits))


def limit_events(acting: Mapping[ActingLimit, Stretches], time: Array, manoeuvre: tuple[float, float]) -> list[Event]:
    """One event for each episode of each limit: when it begins, how far it goes, and until when it lasts.

    time (N + 1,) [s] of the run's steps; manoeuvre (T_i, T_f) [s] sets how close two episodes are told as one.
    """
    run, whole = float(time[-1] - time[0]), manoeuvre[1] - manoeuvre[0]
    gap = EPISODE_GAP * (min(whole, run) if whole > 0 else run)
    events = []
    for limit, spans in acting.items():
        begins, ends, most = _episodes(time[spans.first], time[spans.last], spans.most, gap)
        for begin, end, amount in zip(begins.tolist(), ends.tolist(), most.tolist(), strict=True):
            until = "to the end of the run" if end >= time[-1] else f"until t = {end:.6g} s"
            far = f"{amount:.3g} {limit.unit}".rstrip()
            how = f"up to {far} deep" if limit.kind == "contact" else f"exceeded by up to {far}"
            events.append(Event(begin, limit.kind, f"{limit.text}, {how}, {until}", until=end))
    return events


def _episodes(begins: Array, ends: Array, most: Array, gap: float) -> tuple[Array, Array, Array]:
    """Spans of time [s], joined where they lie closer than `gap`, and until at most MOST_EPISODES are left."""
    if not len(begins):
        return begins, ends, most
    between = begins[1:] - ends[:-1]
    if len(between) >= MOST_EPISODES:
        gap = max(gap, float(np.sort(between)[-MOST_EPISODES]))
    heads = np.flatnonzero(np.concatenate([[True], between > gap]))
    tails = np.append(heads[1:], len(begins)) - 1
    return begins[heads], ends[tails], np.maximum.reduceat(most, heads)


def first_and_most(excess: Array, time: Sequence[float] | Array) -> tuple[float, float] | None:
    """When something is first beyond a limit, and by how much at most, of its excess (k,) at times (k,); None where it never is."""
    beyond = np.flatnonzero(excess > 0)
    return (float(time[beyond[0]]), float(excess.max())) if len(beyond) else None
