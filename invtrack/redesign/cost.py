"""What a planned trajectory costs, by quadrature of its values alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.redesign.weights import Weights, as_weights
from invtrack.signals.nominal import NominalTrajectory

Array = NDArray[np.float64]

CONVERGED = 1e-12
"""Panels are halved until the integral changes by less than this share of itself."""

MOST_PANELS = 2**21
"""Panels in all, at most."""

AT_REST = 1e-12
"""A cost per second far outside the plan of no more than this share of its peak is rounding, not a cost that goes on for ever."""


def cost(nominal: NominalTrajectory, *, R: ArrayLike, Q_x: ArrayLike = 0.0, Q_y: ArrayLike) -> float:
    """Integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d) from the plan's start to its end.

    nominal: the plan of any method. Weights as in `quadratic_redesign`. Infinite where the plan goes on costing something before
    its start or after its end; otherwise what lies there is below the plan's tolerance, unless its preactuation was limited.

    Raises RedesignError for weights that do not fit the plan's model.
    """
    weights = as_weights(nominal.model, R=R, Q_x=Q_x, Q_y=Q_y)
    edges = _edges(nominal)
    middle = (edges[:-1] + edges[1:]) / 2
    length = edges[-1] - edges[0]
    far = _rate(nominal, weights, np.array([edges[0], edges[-1]]) + np.array([-10.0, 10.0]) * (length + 1.0), None)
    if np.max(far) > AT_REST * np.max(_rate(nominal, weights, middle, None)):
        return math.inf
    nodes, node_weights = np.polynomial.legendre.leggauss(10)
    previous, per_piece = math.nan, 2
    while True:
        shares = (np.arange(per_piece)[:, None] + (nodes + 1) / 2) / per_piece
        times = edges[:-1, None] + np.diff(edges)[:, None] * shares.ravel()
        rate = _rate(nominal, weights, times.ravel(), np.repeat(middle, shares.size)).reshape(times.shape)
        total = float(np.diff(edges) @ (rate @ np.tile(node_weights, per_piece))) / (2 * per_piece)
        per_piece *= 2
        if abs(total - previous) <= CONVERGED * total or per_piece * len(middle) > MOST_PANELS // len(nodes):
            return total
        previous = total


def _edges(nominal: NominalTrajectory) -> Array:
    """Breakpoints, and beside them times that lie the closer the nearer the manoeuvre: fast and slow modes decay there."""
    first, last = nominal.breakpoints[0], nominal.breakpoints[-1]
    shares = 2.0 ** -np.arange(12.0)
    before, after = first - nominal.preactuation * shares, last + nominal.postactuation * shares[::-1]
    return np.unique(np.concatenate([before, nominal.breakpoints, after]))


def _rate(nominal: NominalTrajectory, weights: Weights, times: Array, inside: Array | None) -> Array:
    """Cost per second (m,)."""
    at = nominal(times, inside=inside)
    return weights.rate(at.x, at.u - nominal.model.systems[0].operating_point.u0, at.y - at.y_d)
