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
    spans = [_halved(reach(trajectory.before), paces[0], both=False)]
    spans += [_halved(length, pace, both=True) for length, pace in zip(np.diff(edges), paces[1:-1], strict=True)]
    spans.append(_halved(reach(trajectory.after), paces[-1], both=False))
    stride = max(1, sum(map(len, spans)) // MOST_PANELS)
    times, pieces, shares = [], [], []
    for j, span in enumerate(spans):
        if 0 < j < last and j % stride:
            continue
        starts, ends = span[:-1], span[1:]
        since = ((starts + ends)[:, None] + (ends - starts)[:, None] * NODES).ravel() / 2
        times.append(edges[0] - since if j == 0 else edges[j - 1] + since)
        pieces.append(np.full(len(since), j))
        shares.append(((ends - starts)[:, None] / 2 * NODE_WEIGHTS).ravel() * (stride if 0 < j < last else 1))
    return np.concatenate(times), np.concatenate(pieces), np.concatenate(shares)


def _halved(length: float, pace: float, *, both: bool) -> Array:
    """Edges of panels over [0, length], halved towards the start (and towards the end) down to one time constant."""
    if length <= 0:
        return np.zeros(1)
    times = int(np.clip(np.ceil(np.log2(max(length * pace, 1.0))), 0, MOST_HALVINGS))
    steps = np.concatenate([[0.0], 2.0 ** np.arange(-times, 1.0)])
    if not both:
        return length * steps
    return length * np.concatenate([steps / 2, 1 - steps[-2::-1] / 2])


def reach(tail: Tail) -> float:
    """How far [s] a tail is looked at."""
    if not tail.departs:
        return 0.0
    rate = -tail.departure.growth
    return TAIL_TIMES / rate if rate > 0 else 0.0
