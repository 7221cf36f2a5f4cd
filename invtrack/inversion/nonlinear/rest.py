"""Equilibria of nonlinear dynamics with given outputs, followed along a path of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.plans.dynamics import Derivatives, Dynamics

ITERATIONS = 30

SHORTEST = 2.0**-20
"""Where no larger share of a step reduces the residual, it is as small as rounding allows, or there is no equilibrium."""

RESIDUAL = 1e-9
"""Rates and outputs of an equilibrium, as a share of the terms that cancel in them."""

ROUNDING = 1e-12
"""Where no more is left, as a share of the terms that cancel, a step that does not reduce it shows that it is rounding."""

MOST_ROWS = 8
"""Of a path that is followed from equilibrium to equilibrium, at once."""

STRAIGHT = 0.1
"""Equilibria lie as foretold where they are off by no more than this share of the way from the last one."""

CUT = 1e-9
"""Singular values below this share of the largest are directions that the conditions leave open."""


@dataclass(frozen=True, eq=False)
class Rest:
    """An equilibrium: a point, the inputs that hold it, and what is left of its rates and outputs, as a share of their terms."""

    point: Array
    inputs: Array
    residual: float
    _derivatives: list[tuple[Dynamics, Derivatives]] = field(default_factory=list, repr=False)

    def derivatives(self, dynamics: Dynamics) -> Derivatives:
        """Of the dynamics there, one state and input."""
        for known, found in self._derivatives:
            if known is dynamics:
                return found
        self._derivatives.append((dynamics, dynamics.derivatives(self.point[None], self.inputs[None])))
        return self._derivatives[-1][1]


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


def rest_at_end(dynamics: Dynamics, path: Array, near: Rest) -> tuple[Rest | None, int]:
    """The equilibrium at the end of a path of outputs, to which that near its start leads; and to which row it is followed.

    From row to row; rows are left out where equilibria lie as the line through the last two foretells.

    Args:
        dynamics: of which.
        path: outputs along it (k, p).
        near: an equilibrium near that with the first of them.
    """
    begin = rest_with(dynamics, path[0], near)
    found, step, last = [(0, begin or near)], 1, len(path) - 1
    while found[-1][0] < last:
        row = min(last, found[-1][0] + step)
        guess = _foretold(dynamics, found, row)
        rest = rest_with(dynamics, path[row], guess)
        if rest is None and step == 1:
            return None, found[-1][0]
        if rest is None:
            step = 1
            continue
        straight = _apart(dynamics, rest, guess) <= STRAIGHT * _apart(dynamics, rest, found[-1][1])
        step = min(2 * step, MOST_ROWS) if straight else 1
        found = [found[-1], (row, rest)]
    return found[-1][1], last


def _foretold(dynamics: Dynamics, found: Sequence[tuple[int, Rest]], row: int) -> Rest:
    """Where the line through the last two leads, at a row of the path."""
    if len(found) < 2:
        return found[-1][1]
    (a, old), (b, new) = found
    ratio = (row - b) / (b - a)
    moved = ratio * dynamics.difference(new.point[None], old.point[None])
    return Rest(dynamics.retract(new.point[None], moved)[0], new.inputs + ratio * (new.inputs - old.inputs), new.residual)


def _apart(dynamics: Dynamics, one: Rest, other: Rest) -> float:
    """Distance of two equilibria, inputs as shares of their size."""
    inputs = (one.inputs - other.inputs) / np.maximum(1.0, np.abs(one.inputs))
    return float(np.linalg.norm(np.concatenate([dynamics.difference(one.point[None], other.point[None])[0], inputs])))


def _largest(J: Array, axis: int) -> Array:
    """Largest entry of each row or column, 1 for those without any."""
    size = np.max(np.abs(J), axis=axis)
    return np.where(size > 0, size, 1.0)
