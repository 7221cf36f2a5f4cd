"""Equilibria of nonlinear dynamics with given outputs, followed along a path of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.plans.dynamics import Dynamics

ITERATIONS = 30

SETTLED = 1e-12
"""The last step of the search, as a share of the largest it took (or of 1 in radians and metres)."""

RESIDUAL = 1e-9
"""Rates and outputs of an equilibrium, as a share of the terms that cancel in them."""

CUT = 1e-9
"""Singular values below this share of the largest are directions that the conditions leave open."""


@dataclass(frozen=True, eq=False)
class Rest:
    """An equilibrium: a point, the inputs that hold it, and what is left of its rates and outputs, as a share of their terms."""

    point: Array
    inputs: Array
    residual: float


def rest_with(dynamics: Dynamics, outputs: Array, near: Rest) -> Rest | None:
    """The equilibrium with these outputs (p,) that Gauss-Newton finds from a near one; None where it finds none.

    f(x, u) = 0, h(x, u) = y: each step is the shortest one to first order, in scaled units, so that what is left open (where a
    vehicle stands) stays.
    """
    point, u, n = near.point[None], near.inputs[None], dynamics.size
    longest = 1.0
    for _ in range(ITERATIONS):
        found = dynamics.derivatives(point, u)
        residual = np.concatenate([found.rates[0], dynamics.output_difference(found.outputs[0], outputs)])
        J = np.block([[found.A[0], found.B[0]], [found.C[0], found.D[0]]])
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(residual))):
            return None
        rows = np.max(np.abs(J), axis=1)
        rows = np.where(rows > 0, rows, 1.0)
        scaled = J / rows[:, None]
        columns = np.max(np.abs(scaled), axis=0)
        columns = np.where(columns > 0, columns, 1.0)
        step = scipy.linalg.lstsq(scaled / columns, -residual / rows, cond=CUT)[0]
        size = float(np.max(np.abs(step)))
        longest = max(longest, size)
        if size > 1.0:  # a posture may be far, but the linear model of it is not to be trusted further
            step /= size
        point, u = dynamics.retract(point, (step / columns)[None, :n]), u + (step / columns)[None, n:]
        if size <= SETTLED * longest:
            break
    rates, reached = dynamics.evaluate(point, u)
    left = np.abs(np.concatenate([rates[0], dynamics.output_difference(reached[0], outputs)]))
    terms = np.abs(J) @ np.concatenate([np.ones(n), np.maximum(np.abs(u[0]), 1.0)])
    share = float(np.max(left / np.where(terms > 0, terms, 1.0)))
    return Rest(point[0], u[0], share) if share <= RESIDUAL else None


def rests_along(dynamics: Dynamics, outputs: Array, near: Rest) -> list[Rest | None]:
    """The equilibria with outputs (k, p) one after the other, each searched for from the last one found."""
    found: list[Rest | None] = []
    for wanted in outputs:
        rest = rest_with(dynamics, wanted, near)
        near = near if rest is None else rest
        found.append(rest)
    return found
