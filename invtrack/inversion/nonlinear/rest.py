"""Equilibria of nonlinear dynamics with given outputs, followed along a path of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.plans.dynamics import Dynamics

ITERATIONS = 30

SHORTEST = 2.0**-20
"""Where no larger share of a step reduces the residual, it is as small as rounding allows, or there is no equilibrium."""

RESIDUAL = 1e-9
"""Rates and outputs of an equilibrium, as a share of the terms that cancel in them."""

ROUNDING = 1e-12
"""Where no more is left, as a share of the terms that cancel, a step that does not reduce it shows that it is rounding."""

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
    vehicle stands) stays; of a step that does not reduce the residual a smaller share is taken.
    """
    point, u, n = near.point[None], near.inputs[None], dynamics.size

    def residual(point: Array, u: Array) -> Array:
        rates, reached = dynamics.evaluate(point, u)
        return np.concatenate([rates[0], dynamics.output_difference(reached[0], outputs)])

    left = residual(point, u)
    for _ in range(ITERATIONS):
        found = dynamics.derivatives(point, u)
        J = np.block([[found.A[0], found.B[0]], [found.C[0], found.D[0]]])
        if not (np.all(np.isfinite(J)) and np.all(np.isfinite(left))):
            return None
        rows = _largest(J, axis=1)
        columns = _largest(J / rows[:, None], axis=0)
        step = scipy.linalg.lstsq(J / rows[:, None] / columns, -left / rows, cond=CUT)[0] / columns
        terms = np.abs(J) @ np.concatenate([np.ones(n), np.maximum(np.abs(u[0]), 1.0)])
        worst = float(np.max(np.abs(left) / np.where(terms > 0, terms, 1.0)))
        share, least = 1.0, 1.0 if worst <= ROUNDING else SHORTEST
        while share >= least:
            moved, inputs = dynamics.retract(point, share * step[None, :n]), u + share * step[None, n:]
            after = residual(moved, inputs)
            if np.linalg.norm(after / rows) < np.linalg.norm(left / rows):
                break
            share /= 2
        if share < least:
            break
        point, u, left = moved, inputs, after
    return Rest(point[0], u[0], worst) if worst <= RESIDUAL else None


def rests_along(dynamics: Dynamics, outputs: Array, near: Rest) -> list[Rest | None]:
    """The equilibria with outputs (k, p) one after the other, each searched for from the last one found."""
    found: list[Rest | None] = []
    for wanted in outputs:
        rest = rest_with(dynamics, wanted, near)
        near = near if rest is None else rest
        found.append(rest)
    return found


def _largest(J: Array, axis: int) -> Array:
    """Largest entry of each row or column, 1 for those without any."""
    size = np.max(np.abs(J), axis=axis)
    return np.where(size > 0, size, 1.0)
