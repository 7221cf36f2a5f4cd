"""One interval of the plant within the manoeuvre: its two-sided system, carried over the reference's pieces in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.linear.propagation import forced_states
from invtrack.plans.two_sided import DrivenSystem, TwoSidedSystem


@dataclass(frozen=True, eq=False)
class Stretch:
    """One interval of the plant within the manoeuvre (no piece, where it lies outside) and the reference's pieces in it.

    v = [z_f at its start; z_b at its end] is unknown.

    Args:
        system: the two-sided system of the interval.
        driven: the driven systems, of all stretches.
        which: for each piece, the number of its driven system among these (k,).
        lengths: of the pieces (k,) [s].
        w_start, w_end: the reference's states at the pieces' starts and ends (k, q), padded to the largest q.
    """

    system: TwoSidedSystem
    driven: Sequence[DrivenSystem]
    which: Indices
    lengths: Array
    w_start: Array
    w_end: Array

    @cached_property
    def forced(self) -> tuple[Array, Array]:
        """z_f at the start of each piece and at the end (k + 1, n_f), z_b alike (k + 1, n_b), that the reference alone causes."""
        n_f, n_b = self.system.forward.size, self.system.backward.size
        forward, backward = self.system.propagators
        k = len(self.lengths)
        added_f = self._driven(0, np.zeros((k, n_f)), self.w_start, self.lengths)
        added_b = self._driven(1, np.zeros((k, n_b)), self.w_end, self.lengths)
        return (
            forced_states(forward, added_f, self.lengths),
            forced_states(backward, added_b[::-1], self.lengths[::-1])[::-1],
        )

    @cached_property
    def transitions(self) -> tuple[Array, Array]:
        """E_f with z_f at the end = E_f z_f(start) + forced, and E_b with z_b at the start = E_b z_b(end) + forced."""
        forward, backward = self.system.propagators
        return forward.matrix(self.lengths.sum()), backward.matrix(self.lengths.sum())

    @cached_property
    def peaks(self) -> Array:
        """The largest value of each of z_f and z_b that the reference alone causes (n_f + n_b,)."""
        forced_f, forced_b = self.forced
        found = [np.hstack([np.max(np.abs(z), axis=0, initial=0.0) for z in (forced_f, forced_b)])]
        for share in (1 / 3, 2 / 3):  # at the ends of pieces alone all may happen to pass through zero
            inner_f = self._driven(0, forced_f[:-1], self.w_start, share * self.lengths)
            inner_b = self._driven(1, forced_b[1:], self.w_end, share * self.lengths)
            found.append(np.hstack([np.max(np.abs(z), axis=0, initial=0.0) for z in (inner_f, inner_b)]))
        return np.asarray(np.max(found, axis=0))

    def states(self, v: Array) -> tuple[Array, Array]:
        """z_f at the start and z_b at the end of each piece, (k, n_f) and (k, n_b), for v = [z_f(start); z_b(end)]."""
        n_f, n_b = self.system.forward.size, self.system.backward.size
        forward, backward = self.system.propagators
        times = np.concatenate([[0.0], np.cumsum(self.lengths)])
        one = np.zeros(len(self.lengths), dtype=np.intp)
        carried_f = forward.outputs(np.eye(n_f), v[np.newaxis, :n_f], one, times[:-1])
        carried_b = backward.outputs(np.eye(n_b), v[np.newaxis, n_f:], one, times[-1] - times[1:])
        return self.forced[0][:-1] + carried_f, self.forced[1][1:] + carried_b

    def outer(self, v: Array) -> tuple[Array, Array]:
        """z_f at the end of the stretch and z_b at its start."""
        n_f, total = self.system.forward.size, np.array([self.lengths.sum()])
        forward, backward = self.system.propagators
        carried_f, carried_b = forward.states(v[np.newaxis, :n_f], total)[0], backward.states(v[np.newaxis, n_f:], total)[0]
        return carried_f + self.forced[0][-1], carried_b + self.forced[1][0]

    def _driven(self, part: int, z: Array, w: Array, lengths: Array) -> Array:
        """z of [z; w] carried over each piece's length, (k, n_z); part 0 is the forward, 1 the backward one."""
        n_z = z.shape[1]
        result = np.empty_like(z)
        for index in np.unique(self.which):
            chosen, driven = self.which == index, self.driven[index]
            q = len(driven.S)
            start = np.hstack([z[chosen], w[chosen, :q]])
            result[chosen] = driven.propagators[part].outputs(np.eye(n_z, n_z + q), start, np.arange(len(start)), lengths[chosen])
        return result
