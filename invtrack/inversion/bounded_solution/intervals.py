"""The inverse over one interval of the plant: how it carries its boundary values, and what the reference adds."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.inversion.bounded_solution.pieces import InversePiece
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.propagation import Propagator, forced_states
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Interval:
    """One interval of the plant within the manoeuvre: v_k = [z_s at its start; z_u at its end] is unknown.

    z_s at the end is E_s z_s(start) + p_s, z_u at the start is E_u z_u(end) + p_u. forced_s, forced_u: the particular parts at the
    start and at the end of each of the interval's pieces, whose numbers are `pieces`; peak: the largest value they take.
    """

    pieces: NDArray[np.intp]
    E_s: Array
    p_s: Array
    E_u: Array
    p_u: Array
    forced_s: Array
    forced_u: Array
    peak: float

    def boundary_parts(self, split: SplitDynamics, value: Array, edges: Array) -> tuple[Array, Array]:
        """What v_k = value contributes to z_s at the start and to z_u at the end of each piece: (pieces, n_s), (pieces, n_u)."""
        n_s = len(split.A_s)
        since = edges[self.pieces - 1] - edges[self.pieces[:1] - 1]
        until = edges[self.pieces[-1:]] - edges[self.pieces]
        one = np.zeros(len(self.pieces), dtype=np.intp)
        forward, backward = split.propagators
        return (
            forward.outputs(np.eye(n_s), value[np.newaxis, :n_s], one, since),
            backward.outputs(np.eye(len(value) - n_s), value[np.newaxis, n_s:], one, until),
        )


def make_interval(
    pieces: NDArray[np.intp],
    split: SplitDynamics,
    reference: PiecewiseSignal,
    inverses: Sequence[InversePiece],
    kind: NDArray[np.intp],
    end_anchors: Array,
) -> Interval:
    """The interval that consists of the reference's pieces stated (none, where it lies outside the manoeuvre)."""
    lengths = np.diff(reference.breakpoints)[pieces - 1]
    forward, backward = split.propagators
    ours = [(kind[pieces] == index, inverses[index].inside.propagators) for index in np.unique(kind[pieces])]
    start_w, end_w = reference.anchors[pieces], end_anchors[pieces]
    n_s, n_u = len(split.A_s), len(split.A_u)
    added_s = _driven([(chosen, both[0]) for chosen, both in ours], np.zeros((len(pieces), n_s)), start_w, lengths)
    added_u = _driven([(chosen, both[1]) for chosen, both in ours], np.zeros((len(pieces), n_u)), end_w, lengths)
    forced_s = forced_states(forward, added_s, lengths)
    forced_u = forced_states(backward, added_u[::-1], lengths[::-1])[::-1]
    peak = max(np.max(np.abs(z), initial=0.0) for z in (forced_s, forced_u))
    for share in (1 / 3, 2 / 3):  # at the ends of pieces alone all may happen to pass through zero
        inner_s = _driven([(chosen, both[0]) for chosen, both in ours], forced_s[:-1], start_w, share * lengths)
        inner_u = _driven([(chosen, both[1]) for chosen, both in ours], forced_u[1:], end_w, share * lengths)
        peak = max(peak, *(np.max(np.abs(z), initial=0.0) for z in (inner_s, inner_u)))
    total = np.array([lengths.sum()])
    return Interval(
        pieces=pieces,
        E_s=_transition(forward, n_s, total),
        p_s=forced_s[-1],
        E_u=_transition(backward, n_u, total),
        p_u=forced_u[0],
        forced_s=forced_s[:-1],
        forced_u=forced_u[1:],
        peak=float(peak),
    )


def _driven(kinds: Sequence[tuple[NDArray[np.bool_], Propagator]], z: Array, w: Array, lengths: Array) -> Array:
    """z of [z; w] carried over each piece's length by the propagator of its kind, (pieces, n_z)."""
    n_z = z.shape[1]
    result = np.empty_like(z)
    for chosen, propagator in kinds:
        q = propagator.size - n_z
        start = np.hstack([z[chosen], w[chosen, :q]])
        result[chosen] = propagator.outputs(np.eye(n_z, n_z + q), start, np.arange(len(start)), lengths[chosen])
    return result


def _transition(propagator: Propagator, n: int, length: Array) -> Array:
    """exp(A length) (n, n)."""
    return propagator.states(np.eye(n), np.repeat(length, n)).T
