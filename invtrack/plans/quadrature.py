"""Integrals of a trajectory's values over all of time, by Gauss's rule on panels that get shorter towards breakpoints."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import Trajectory

TAIL_TIMES = 40.0
"""Time constants of its slowest mode over which a tail is looked at: e^-80 of the cost is left."""

MOST_PANELS = 4000
"""Panels at most; beyond, pieces are skipped evenly."""

MOST_HALVINGS = 40
"""Halvings of a piece towards either end, at most: layers that are thinner still are looked at in their tail only."""

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(8)


def quadrature_nodes(trajectory: Trajectory) -> tuple[Array, Indices, Array]:
    """Times (k,), their pieces and their shares in an integral over all of time, the denser the nearer to a breakpoint."""
    edges, paces = trajectory.breakpoints, trajectory.paces()
    last = len(edges)
    lengths = np.concatenate([[reach(trajectory.before)], np.diff(edges), [reach(trajectory.after)]])
    halvings = np.clip(np.ceil(np.log2(np.maximum(lengths * paces, 1.0))), 0, MOST_HALVINGS).astype(int)
    panels = np.where(lengths > 0, 2 * halvings + 2, 0)
    panels[[0, -1]] = np.where(lengths[[0, -1]] > 0, halvings[[0, -1]] + 1, 0)
    stride = max(1, int(np.sum(panels)) // MOST_PANELS)
    inner = np.arange(stride, last, stride)
    pieces, starts, ends, weights = [], [], [], []
    for chosen, both, times in ((np.array([0]), False, 1), (inner, True, stride), (np.array([last]), False, 1)):
        for count in np.unique(halvings[chosen]).tolist():
            alike = chosen[(halvings[chosen] == count) & (lengths[chosen] > 0)]
            shares = _halved(count, both=both)
            pieces.append(np.repeat(alike, len(shares) - 1))
            starts.append(np.multiply.outer(lengths[alike], shares[:-1]).ravel())
            ends.append(np.multiply.outer(lengths[alike], shares[1:]).ravel())
            weights.append(np.full(len(pieces[-1]), times))
    order = np.argsort(np.concatenate(pieces), kind="stable")
    piece, start, end, weight = (np.concatenate(each)[order] for each in (pieces, starts, ends, weights))
    since = ((start + end)[:, None] + (end - start)[:, None] * NODES) / 2
    at = np.where(piece == 0, edges[0], edges[np.maximum(piece - 1, 0)])[:, None] + np.where(piece == 0, -1.0, 1.0)[:, None] * since
    return at.ravel(), np.repeat(piece, len(NODES)), ((weight * (end - start) / 2)[:, None] * NODE_WEIGHTS).ravel()


def _halved(times: int, *, both: bool) -> Array:
    """Edges of panels over [0, 1], halved so many times towards the start (and towards the end)."""
    steps = np.concatenate([[0.0], 2.0 ** np.arange(-times, 1.0)])
    return np.concatenate([steps / 2, 1 - steps[-2::-1] / 2]) if both else steps


def reach(tail: Tail) -> float:
    """How far [s] a tail is looked at."""
    if not tail.departs:
        return 0.0
    rate = -tail.departure.growth
    return TAIL_TIMES / rate if rate > 0 else 0.0
