"""L of a modified inverse by least squares: terms in the derivatives of the wanted output that leave the poles where they are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from invtrack.inversion.modification.design_problem import DesignProblem, Solved
from invtrack.inversion.modification.dynamics import ModifiedDynamics, derivative_columns

Array = NDArray[np.float64]

NO_EFFECT = 1e-12
"""A term of L changes nothing where its error is below this share of the largest term's; least squares leaves it at zero."""

SMALLEST_RATIO = 1e-3
"""Combinations of terms whose effect is below this share of the strongest are left out: they would take large terms for little,
as where the references of two outputs are nearly the same, and cost accuracy."""


def best_weights(responses: Array, error: Array) -> Array:
    """Weights w (k,), as small as possible, with which error (m,) + responses (m, k) @ w has the least sum of squares."""
    size = np.linalg.norm(responses, axis=0)
    kept, weights = size > NO_EFFECT * np.max(size, initial=0.0), np.zeros(len(size))
    if np.any(kept):
        weights[kept] = np.linalg.lstsq(responses[:, kept] / size[kept], -error, rcond=SMALLEST_RATIO)[0] / size[kept]
    return weights


@dataclass(frozen=True)
class _Entry:
    """One entry of L, in the intervals that share it; unit: what it is measured in, so that v has the size of its output."""

    intervals: list[int]
    row: int
    column: int
    unit: float

    def added(self, L: Sequence[Array], weight: float) -> list[Array]:
        result = [matrix.copy() for matrix in L]
        for k in self.intervals:
            result[k][self.row, self.column] += weight * self.unit
        return result


def with_least_squares(problem: DesignProblem, plain: Solved) -> Solved:
    """L with the least integral square error: the error is affine in L, so one response per entry and least squares give it."""
    name = f"{plain.name} with L"
    entries = _entries(problem, plain.dynamics)
    if not entries:
        return replace(plain, name=name)
    start, best = problem.errors(plain.solution), list(plain.L)
    responses = np.array([problem.errors(problem.solve(plain.dynamics, entry.added(plain.L, 1.0))) - start for entry in entries])
    for entry, weight in zip(entries, best_weights(responses.T, start), strict=True):
        best = entry.added(best, float(weight))
    solution = problem.solve(plain.dynamics, best)
    error = float(np.sum(problem.errors(solution) ** 2))
    return replace(plain, name=name, L=best, solution=solution, integral_square_error=error)


def _entries(problem: DesignProblem, dynamics: Sequence[ModifiedDynamics]) -> list[_Entry]:
    """Entries that act on derivatives of outputs that move."""
    scale = problem.output_scale
    return [
        _Entry(shared, row, column, float(scale[row] / scale[i]))
        for shared in _shared_intervals(problem, dynamics)
        for i, _, column in derivative_columns(dynamics[shared[0]].split.internal.form)
        if problem.active[i]
        for row in range(len(scale))
    ]


def _shared_intervals(problem: DesignProblem, dynamics: Sequence[ModifiedDynamics]) -> list[list[int]]:
    """Intervals with moved zeros, by the modified inverse that they share. In the others the output stays exact until disturbed."""
    groups: dict[int, list[int]] = {}
    for k, (part, d) in enumerate(zip(problem.parts, dynamics, strict=True)):
        if len(part.targets):
            groups.setdefault(id(d), []).append(k)
    return list(groups.values())
