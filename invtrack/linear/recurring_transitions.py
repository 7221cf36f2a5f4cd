"""Transitions over times that recur to within rounding, such as the pieces of a reference through evenly spaced samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.linear.transition_powers import TransitionPowers, exponential_less_one

RECURS = 1e-6
"""Times recur that differ by less than this share of themselves, and of a node distance: three terms of a series lead from one to
the other, and the first one left out is below 1e-17 of the first, entry by entry, of chains of integrators, too."""

NEARLY = 1e-9
"""For those that differ by no more than this share two terms will do."""

OFTEN = 16
"""A time is remembered that recurs this often in one call, and as often as there are states: its transition costs as much."""

SAMPLE = 256
"""How many times of a call are looked at."""

MOST, MOST_ENTRIES = 64, 2**20
"""How many transitions are remembered, and how many entries they may have."""


@dataclass(frozen=True, eq=False)
class Recurring:
    """Which remembered distance is the nearest to each of some (m,), how far off each is, and whether that is near enough."""

    which: Indices
    remainder: Array
    near: NDArray[np.bool_]

    @property
    def chosen(self) -> Recurring:
        """Those that are near enough alone."""
        return Recurring(self.which[self.near], self.remainder[self.near], self.near[self.near])


class RecurringTransitions:
    """exp(M h d) of a matrix M (q, q), whose powers are known, at distances d that recur, in scaled coordinates."""

    def __init__(self, powers: TransitionPowers) -> None:
        self._powers, q = powers, len(powers.matrix)
        self._most = min(MOST, MOST_ENTRIES // max(q, 1) ** 2)
        self._distances, self._transitions = np.zeros(0), list[Array]()

    def matrix(self, distance: float) -> Array:
        """exp(M h distance) (q, q)."""
        nearest = self._nearest(np.array([distance]))
        if not nearest.near[0]:
            found = self._transition(distance)
            self._remember(distance, found)
            return found
        off = nearest.remainder[0]
        found, step = self._transitions[nearest.which[0]], self._powers.matrix * (self._powers.step * off)
        return np.asarray(found + found @ (step + step @ step / 2)) if off else found

    def recurring(self, distances: Array) -> Recurring | None:
        """Which of the distances (m,) recur, None for too few of them; those that recur in this call are remembered."""
        q = len(self._powers.matrix)
        if not len(self._distances) and len(distances) < max(OFTEN, q):
            return None
        nearest = self._nearest(distances)
        left = np.flatnonzero(~nearest.near)[:SAMPLE]
        if len(left) >= OFTEN and len(distances) >= max(OFTEN, q) and len(self._distances) < self._most:
            sample = np.sort(distances[left])
            new = sample[np.append(True, np.diff(sample) > RECURS * np.minimum(sample[1:], 1.0))]
            if len(new) * OFTEN <= len(left) and len(new) * max(OFTEN, q) <= len(distances):
                for distance in new.tolist():
                    self._remember(distance, self._transition(distance))
                nearest = self._nearest(distances)
        return nearest if 2 * np.count_nonzero(nearest.near) > len(distances) else None

    def values(self, X: Array, v: Array, owner: Indices, distances: Recurring) -> Array:
        """X exp(M h distance_i) v[owner_i], (m, k), at distances that are near: X (k, q) in scaled coordinates, v (g, q) not."""
        which, remainder = distances.which, distances.remainder
        M, result = self._powers.matrix * self._powers.step, np.empty((len(which), len(X)))
        for index in np.flatnonzero(np.bincount(which)).tolist():
            chosen = np.flatnonzero(which == index) if len(self._distances) > 1 else slice(None)
            off, states = remainder[chosen, np.newaxis], v.take(owner[chosen], axis=0)
            farthest = float(np.max(np.abs(off))) / max(min(self._distances[index], 1.0), np.finfo(float).tiny)
            rows = [X @ self._transitions[index]]
            for order in range(1, 1 + (farthest > 0) + (farthest > NEARLY)):
                rows.append(rows[-1] @ M / order)
            found = states @ (rows[-1] / self._powers.scale).T
            for row in reversed(rows[:-1]):
                found *= off
                found += states @ (row / self._powers.scale).T
            result[chosen] = found
        return result

    def _nearest(self, distances: Array) -> Recurring:
        if not len(self._distances):
            return Recurring(np.zeros(len(distances), dtype=np.intp), distances, np.zeros(len(distances), dtype=bool))
        if len(self._distances) == 1:
            which = np.zeros(len(distances), dtype=np.intp)
        else:
            which = np.searchsorted((self._distances[:-1] + self._distances[1:]) / 2, distances)
        remainder = distances - self._distances[which]
        return Recurring(which, remainder, np.abs(remainder) <= RECURS * np.minimum(self._distances, 1.0)[which])

    def _remember(self, distance: float, transition: Array) -> None:
        if len(self._distances) < self._most:
            place = int(np.searchsorted(self._distances, distance))
            self._distances = np.insert(self._distances, place, distance)
            self._transitions.insert(place, transition)

    def _transition(self, distance: float) -> Array:
        """exp(M h distance), by the binary digits of its whole part and a series for the rest."""
        count = round(distance)
        result = np.eye(len(self._powers.matrix))
        result += exponential_less_one(self._powers.matrix * (self._powers.step * (distance - count)))
        for bit in range(count.bit_length()):
            if count >> bit & 1:
                result = self._powers.digit(bit) @ result
        return result
