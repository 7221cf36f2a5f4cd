"""Derivatives of a function by central differences with Richardson extrapolation."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Derivative:
    """A Jacobian (m, k) with an estimate (m, k) of each entry's error, and the jump (m, k) of each one-sided derivative.

    `jump` is the size of the right-hand minus the left-hand derivative: more than noise where the function has a kink.
    """

    jacobian: Array
    error: Array
    jump: Array


def differentiate(function: Callable[[Array], Array], steps: Array) -> Derivative:
    """The derivative at 0 of `function` (from (k,) to (m,)), with a step for each argument.

    With D(h) = (f(h) - f(-h)) / 2h the result is R(h) = (4 D(h) - D(2h)) / 3, good to order h^4. The error estimate is
    |R(h) - R(2h)| (some fifteen times the truncation error where that prevails) plus the jump and the rounding of f over h. With
    s(h) = f(h) - 2 f(0) + f(-h) and j(h) = (4 s(h) - s(2h)) / 2h the jump is (8 j(h) - j(2h)) / 7, of order h^5 where f is smooth;
    there it is a sample of the noise in f.
    """
    centre = function(np.zeros(len(steps)))
    columns = [_column(function, centre, i, steps) for i in range(len(steps))]
    jacobian, error, jump = (np.column_stack(parts) for parts in zip(*columns, strict=True))
    return Derivative(jacobian, error, jump)


def _column(function: Callable[[Array], Array], centre: Array, i: int, steps: Array) -> tuple[Array, Array, Array]:
    h = steps[i]
    direction = np.eye(len(steps))[i]
    ahead, behind = ([function(sign * factor * h * direction) for factor in (1, 2, 4)] for sign in (1, -1))
    D = [(f - b) / (2 * factor * h) for f, b, factor in zip(ahead, behind, (1, 2, 4), strict=True)]
    fine, coarse = ((4 * D[j] - D[j + 1]) / 3 for j in (0, 1))
    rounding = np.finfo(float).eps * np.max(np.abs([centre, *ahead, *behind]), axis=0) / h
    bend = [f - 2 * centre + b for f, b in zip(ahead, behind, strict=True)]
    jump_fine, jump_coarse = ((4 * bend[j] - bend[j + 1]) / (2 * (j + 1) * h) for j in (0, 1))
    jump = np.abs(8 * jump_fine - jump_coarse) / 7
    return fine, np.abs(fine - coarse) + jump + rounding, jump
