"""The least input by collocation: an equality-constrained least squares problem that knows nothing of inverses or costates."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import scipy.linalg
import scipy.sparse as sp
from numpy.typing import ArrayLike
from scipy.sparse.linalg import spsolve

from invtrack.arrays import Array
from invtrack.linear.state_space import StateSpace


def least_input(
    models: Sequence[StateSpace],
    switch_times: Sequence[float],
    R: Array,
    wanted: Callable[[ArrayLike, int], Array],
    degree: int,
    window: tuple[float, float],
    steps: int,
    start: Array,
    end: tuple[Array, Array],
    u_rest: Callable[[float], Array] | None = None,
) -> tuple[Array, Array]:
    """Times (N,) in the middle of steps, and inputs (N, m) held over them, of least integral of (u - u_rest)'R (u - u_rest).

    The implicit midpoint rule for x' = A x + B u, of second order, with the derivative of order `degree` of each output as wanted
    in the middle of each step, and lower ones at a jump as far as they are other functions of the state after it.

    Args:
        models: of each interval.
        switch_times: [s].
        R: weight of the inputs.
        wanted: derivative of the outputs of an order, (p,) at a time and (k, p) at times.
        degree: the relative degree, the same for all outputs; 0 for a feedthrough of full row rank.
        window: first and last time [s].
        steps: their number N.
        start: state there.
        end: rows (k, n) and values (k,) of what the state is to be at the end.
        u_rest: the input from which the cost is counted; zero unless stated.
    """
    n, m = models[0].B.shape
    t = np.linspace(*window, steps + 1)
    h, middle = t[1] - t[0], (t[:-1] + t[1:]) / 2
    interval = np.searchsorted(switch_times, middle)
    first_u, highest_wanted = (steps + 1) * n, wanted(middle, degree)
    blocks: list[tuple[Array, int, int]] = []
    values: list[Array] = []
    row = 0

    def equation(value: Array, *terms: tuple[Array, int]) -> None:
        nonlocal row
        blocks.extend((matrix, row, column) for matrix, column in terms)
        values.append(np.atleast_1d(value))
        row += len(values[-1])

    for k in range(steps):
        system, eye = models[interval[k]], np.eye(n)
        x, x_next, u = k * n, (k + 1) * n, first_u + k * m
        equation(np.zeros(n), (eye / h - system.A / 2, x_next), (-eye / h - system.A / 2, x), (-system.B, u))
        highest = system.C @ np.linalg.matrix_power(system.A, degree)
        gains = system.C @ np.linalg.matrix_power(system.A, degree - 1) @ system.B if degree else system.D
        equation(highest_wanted[k], (highest / 2, x), (highest / 2, x_next), (gains, u))
        if k and interval[k] != interval[k - 1]:
            before, after = (outputs_and_derivatives(models[j], degree) for j in (interval[k - 1], interval[k]))
            other = ~np.all(np.isclose(before, after), axis=1)
            asked = np.concatenate([wanted(t[k], order) for order in range(degree)])
            if np.any(other):
                equation(asked[other], (after[other], x))
    equation(start, (np.eye(n), 0))
    equation(end[1], (end[0], steps * n))
    entries = [(block[i, j], r + i, c + j) for block, r, c in blocks for i, j in [np.nonzero(block)]]
    data, rows, columns = (np.concatenate(part) for part in zip(*entries, strict=True))
    conditions = sp.csc_matrix((data, (rows, columns)), shape=(row, first_u + steps * m))
    weight = sp.block_diag([sp.csc_matrix((first_u, first_u)), sp.kron(sp.eye(steps), R)])
    pull = np.zeros(first_u + steps * m)
    if u_rest is not None:
        pull[first_u:] = (np.array([u_rest(time) for time in middle]) @ R).ravel()
    system = sp.bmat([[weight, conditions.T], [conditions, None]]).tocsc()
    solution = spsolve(system, np.concatenate([pull, *values]))
    return middle, solution[first_u : first_u + steps * m].reshape(steps, m)


def outputs_and_derivatives(system: StateSpace, degree: int) -> Array:
    """Rows (degree p, n) of the outputs, of their first derivatives, and so on."""
    rows = [system.C @ np.linalg.matrix_power(system.A, order) for order in range(degree)]
    return np.vstack(rows) if rows else np.zeros((0, len(system.A)))


def unseen(system: StateSpace, degree: int) -> Array:
    """Orthonormal rows of what is left of the state where outputs and derivatives are as they are."""
    return np.asarray(scipy.linalg.null_space(outputs_and_derivatives(system, degree)).T)
