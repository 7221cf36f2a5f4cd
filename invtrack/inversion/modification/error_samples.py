"""Times and weights at which the error of a modified inverse is weighed: quadrature over all of time."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.signals.nominal import TwoSidedTrajectory
from invtrack.signals.piecewise import PiecewiseSignal

Array = NDArray[np.float64]

NODES = 4
"""Gauss points per panel."""

PANELS = 400
"""Panels in each stretch (before, during and after the manoeuvre) at most."""

TIME_CONSTANTS = 9.0
"""How many time constants of the slowest pole placed are looked at before and after the manoeuvre: its square is then 1e-8."""


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """Quadrature nodes (m,) [s], the pieces of the trajectory they lie in, and weights (m,): the integral of f is weights @ f."""

    times: Array
    pieces: NDArray[np.intp]
    weights: Array

    def errors(self, trajectory: TwoSidedTrajectory, reference: PiecewiseSignal, scale: Array) -> Array:
        """sqrt(weight) (y - y_d) / scale, (m, p): its sum of squares is the integral of the squared error."""
        p = len(scale)
        rows = len(trajectory.generators[0].X_b)
        y = trajectory(self.times, self.pieces, slice(rows - p, rows))
        return np.sqrt(self.weights)[:, None] * (y - reference(self.times)) / scale


def error_samples(breakpoints: Array, poles: NDArray[np.complex128]) -> ErrorSamples:
    """Samples that resolve the poles placed, over the manoeuvre and TIME_CONSTANTS of the slowest of them on both sides."""
    tail = TIME_CONSTANTS / float(np.min(np.abs(poles.real)))
    panel = 1.0 / float(np.max(np.abs(poles)))
    start, end = float(breakpoints[0]), float(breakpoints[-1])
    edges = [np.linspace(start - tail, start, _count(tail, panel) + 1)]
    whole = max(end - start, np.finfo(float).tiny)
    for a, b in itertools.pairwise(breakpoints):
        count = int(np.ceil(min(_count(b - a, panel), PANELS * (b - a) / whole)))
        edges.append(np.linspace(a, b, max(count, 1) + 1))
    edges.append(np.linspace(end, end + tail, _count(tail, panel) + 1))
    starts, ends = np.concatenate([e[:-1] for e in edges]), np.concatenate([e[1:] for e in edges])
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    times = ((starts + ends) / 2)[:, None] + ((ends - starts) / 2)[:, None] * nodes
    pieces = np.searchsorted(breakpoints, (starts + ends) / 2, side="right")
    return ErrorSamples(times.ravel(), np.repeat(pieces, NODES), (((ends - starts) / 2)[:, None] * weights).ravel())


def _count(length: float, panel: float) -> int:
    return int(min(max(np.ceil(length / panel), 8), PANELS))
