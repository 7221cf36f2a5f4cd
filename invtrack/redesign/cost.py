"""What a planned trajectory costs, by quadrature of its values alone."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.plans.plan import Plan
from invtrack.redesign.weights import ROUNDING, Weights, as_weights

Array = NDArray[np.float64]

CONVERGED = 1e-12
"""A panel is halved until that changes its part of the integral by no more than this share of the whole."""

NODES, NODE_WEIGHTS = np.polynomial.legendre.leggauss(10)

MOST_PANELS = 2**17
"""Panels that are halved at once, at most."""

AT_REST = 1e-12
"""A cost per second far outside the plan of no more than this share of its peak is rounding, not a cost that goes on for ever."""


def cost(plan: Plan, *, R: ArrayLike, Q_x: ArrayLike = 0.0, Q_y: ArrayLike) -> float:
    """Integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d) from the plan's start to its end.

    plan: the plan of any method. Weights as in `quadratic_redesign`. Infinite where the plan goes on costing something before
    its start or after its end; otherwise what lies there is below the plan's tolerance, unless its preactuation was limited.

    Raises RedesignError for weights that do not fit the plan's model.
    """
    weights = as_weights(plan.model, R=R, Q_x=Q_x, Q_y=Q_y)
    edges = _edges(plan)
    middle = (edges[:-1] + edges[1:]) / 2
    length = edges[-1] - edges[0]
    far = _deviations(plan, np.array([edges[0], edges[-1]]) + np.array([-10.0, 10.0]) * (length + 1.0), None)
    lasting = weights.rate(*far) - ROUNDING * weights.terms(*far)
    if np.max(lasting) > AT_REST * np.max(weights.rate(*_deviations(plan, middle, None))):
        return math.inf
    left, right = edges[:-1], edges[1:]
    whole, total = _integrals(plan, weights, left, right), 0.0
    while True:
        centre = (left + right) / 2
        left, right = np.column_stack([left, centre]).ravel(), np.column_stack([centre, right]).ravel()
        halves = _integrals(plan, weights, left, right)
        change = np.abs(halves[::2] + halves[1::2] - whole)
        unsettled = np.repeat(change > CONVERGED * (total + float(np.sum(halves))), 2)
        total += float(np.sum(halves[~unsettled]))
        left, right, whole = left[unsettled], right[unsettled], halves[unsettled]
        if len(whole) == 0 or len(whole) > MOST_PANELS:
            return total + float(np.sum(whole))


def _integrals(plan: Plan, weights: Weights, left: Array, right: Array) -> Array:
    """What each panel between left and right (m,) adds, by Gauss's rule: (m,)."""
    middle, half = (left + right) / 2, (right - left) / 2
    times = middle[:, None] + half[:, None] * NODES
    rate = weights.rate(*_deviations(plan, times.ravel(), np.repeat(middle, len(NODES)))).reshape(times.shape)
    return np.asarray(half * (rate @ NODE_WEIGHTS))


def _edges(plan: Plan) -> Array:
    """Breakpoints, and beside them times that lie the closer the nearer the manoeuvre: fast and slow modes decay there."""
    first, last = plan.breakpoints[0], plan.breakpoints[-1]
    shares = 2.0 ** -np.arange(12.0)
    before, after = first - plan.preactuation * shares, last + plan.postactuation * shares[::-1]
    return np.unique(np.concatenate([before, plan.breakpoints, after]))


def _deviations(plan: Plan, times: Array, inside: Array | None) -> tuple[Array, Array, Array]:
    """What is weighed: states, inputs from the operating point, and output errors."""
    at = plan(times, inside=inside)
    return at.x, at.u - plan.model.operating_point.u0, at.y - at.y_d
