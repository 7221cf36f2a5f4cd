"""One interval of the plant within the manoeuvre: its two-sided system, carried over the reference's pieces in it."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.linear.propagation import forced_states
from invtrack.plans.two_sided import DrivenSystem, TwoSidedSystem

WITHIN = (1 / 3, 2 / 3)
"""Where within a piece peaks are looked for, too, as shares of its length: at its ends all may happen to pass through zero."""

LOOKED_WITHIN = 4096
"""In how many pieces at most, spread evenly over those of a stretch."""


@dataclass(frozen=True, eq=False)
class DrivenPieces:
    """The pieces of a reference within the manoeuvre, each with the driven two-sided system that holds in it.

    Args:
        driven: the driven systems.
        which: for each piece, the number of its driven system among these (k,).
        lengths: of the pieces (k,) [s].
        w_start, w_end: the reference's states at the pieces' starts and ends (k, q), padded to the largest q.
    """

    driven: Sequence[DrivenSystem]
    which: Indices
    lengths: Array
    w_start: Array
    w_end: Array

    def some(self, chosen: Indices) -> DrivenPieces:
        """These pieces only."""
        return DrivenPieces(self.driven, self.which[chosen], self.lengths[chosen], self.w_start[chosen], self.w_end[chosen])

    def carried(self, part: int, z: Array, share: float = 1.0) -> Array:
        """z (k, n) carried over this share of each piece's length under the reference's drive; part 0: forward, 1: backward.

        n: the largest number of states of that part; rows of systems with fewer are padded.
        """
        w, result = (self.w_start, self.w_end)[part], np.zeros_like(z)
        for index in np.flatnonzero(np.bincount(self.which)).tolist():
            driven, chosen = self.driven[index], np.flatnonzero(self.which == index)
            n, q = (driven.system.forward.size, driven.system.backward.size)[part], len(driven.S)
            start = np.hstack([z[chosen, :n], w[chosen, :q]])
            each, lengths = np.arange(len(chosen)), share * self.lengths[chosen]
            result[chosen, :n] = driven.propagators[part].outputs(np.eye(n, n + q), start, each, lengths)
        return result


@dataclass(frozen=True, eq=False)
class Stretch:
    """One interval of the plant within the manoeuvre (no piece, where it lies outside) and the reference's pieces in it.

    v = [z_f at its start; z_b at its end] is unknown.

    Args:
        system: the two-sided system of the interval.
        lengths: of the pieces (k,) [s].
        forced: z_f at the start of each piece and at the end (k + 1, n_f), z_b alike (k + 1, n_b), that the reference alone causes.
        peaks: the largest value of each of z_f and z_b that the reference alone causes (n_f + n_b,).
    """

    system: TwoSidedSystem
    lengths: Array
    forced: tuple[Array, Array]
    peaks: Array

    def outer(self, v: Array) -> tuple[Array, Array]:
        """z_f at the end of the stretch and z_b at its start."""
        n_f, total = self.system.forward.size, np.array([self.lengths.sum()])
        forward, backward = self.system.propagators
        carried_f, carried_b = forward.states(v[np.newaxis, :n_f], total)[0], backward.states(v[np.newaxis, n_f:], total)[0]
        return carried_f + self.forced[0][-1], carried_b + self.forced[1][0]


def stretches(systems: Sequence[TwoSidedSystem], owner: Indices, pieces: DrivenPieces) -> list[Stretch]:
    """The stretch of each interval: systems of the intervals (N + 1,), and in which of these each piece lies (k,).

    What the pieces have in common is worked out for all stretches at once.
    """
    edges = np.searchsorted(owner, np.arange(len(systems) + 1))
    within = [slice(first, last) for first, last in itertools.pairwise(edges.tolist())]
    looked = [np.arange(each.start, each.stop, -(-(each.stop - each.start) // LOOKED_WITHIN) or 1) for each in within]
    some, first = pieces.some(np.concatenate(looked)), np.cumsum([0, *map(len, looked)]).tolist()
    forced: list[list[Array]] = [[], []]
    peaks = []
    for part in (0, 1):
        sizes = [(system.forward.size, system.backward.size)[part] for system in systems]
        rest = np.zeros((len(owner), max(sizes)))
        added, since = pieces.carried(part, rest), rest.copy()
        for system, n, chosen in zip(systems, sizes, within, strict=True):
            forced[part].append(_forced(system, part, added[chosen, :n], pieces.lengths[chosen]))
            since[chosen, :n] = forced[part][-1][1:] if part else forced[part][-1][:-1]
        since = since[np.concatenate(looked)]
        largest = np.max([np.abs(some.carried(part, since, share)) for share in WITHIN], axis=0)
        peaks.append(
            [
                np.maximum(np.max(np.abs(z), axis=0, initial=0.0), np.max(largest[start:stop, :n], axis=0, initial=0.0))
                for z, n, (start, stop) in zip(forced[part], sizes, itertools.pairwise(first), strict=True)
            ]
        )
    return [
        Stretch(system, pieces.lengths[chosen], (z_f, z_b), np.concatenate([peak_f, peak_b]))
        for system, chosen, z_f, z_b, peak_f, peak_b in zip(systems, within, *forced, *peaks, strict=True)
    ]


def transitions(found: Sequence[Stretch], part: int) -> list[Array]:
    """E of each stretch: z_f at its end = E z_f(start) + forced, or, of part 1, z_b at its start = E z_b(end) + forced."""
    result: dict[int, Array] = {}
    for members in recurring([id(stretch.system) for stretch in found]):
        lengths = np.array([found[k].lengths.sum() for k in members])
        result.update(zip(members, found[members[0]].system.propagators[part].matrices(lengths), strict=True))
    return [result[k] for k in range(len(found))]


def recurring(keys: Sequence[Hashable]) -> list[list[int]]:
    """The numbers of those that share a key, for each key in turn."""
    numbers: dict[Hashable, list[int]] = {}
    for number, key in enumerate(keys):
        numbers.setdefault(key, []).append(number)
    return list(numbers.values())


def _forced(system: TwoSidedSystem, part: int, added: Array, lengths: Array) -> Array:
    """z at the start of each piece and at the end (k + 1, n), from zero where the part starts, `added` (k, n) over each piece."""
    if part:
        return forced_states(system.propagators[1], added[::-1], lengths[::-1])[::-1]
    return forced_states(system.propagators[0], added, lengths)


def piece_states(found: Sequence[Stretch], values: Sequence[Array]) -> tuple[Array, Array]:
    """z_f at the start and z_b at the end of every piece, (k, n_f) and (k, n_b), padded to the largest numbers of states.

    found: the stretches; values: v = [z_f(start); z_b(end)] of each. Those with one system are worked out at once.
    """
    counts = np.array([len(stretch.lengths) for stretch in found])
    elapsed = [np.append(0.0, np.cumsum(stretch.lengths)) for stretch in found]
    since = (
        np.concatenate([times[:-1] for times in elapsed]),
        np.concatenate([times[-1] - times[1:] for times in elapsed]),
    )
    owner = np.repeat(np.arange(len(found)), counts)
    alike = recurring([id(stretch.system) for stretch in found])
    result = []
    for part in (0, 1):
        z = np.zeros((len(owner), max((stretch.system.forward.size, stretch.system.backward.size)[part] for stretch in found)))
        for members in alike:
            system = found[members[0]].system
            n_f, propagator = system.forward.size, system.propagators[part]
            place = np.full(len(found), -1)
            place[members] = np.arange(len(members))
            chosen = np.flatnonzero(place[owner] >= 0)
            start = np.array([values[number][n_f:] if part else values[number][:n_f] for number in members])
            carried = propagator.outputs(np.eye(propagator.size), start, place[owner[chosen]], since[part][chosen])
            own = [found[number].forced[part] for number in members]
            z[chosen, : propagator.size] = carried + np.concatenate([each[1:] if part else each[:-1] for each in own])
        result.append(z)
    return result[0], result[1]
