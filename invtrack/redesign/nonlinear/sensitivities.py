"""How states on an element depend on its start and on the coefficients of its input."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array


def interpolation(known: Array, wanted: Array) -> Array:
    """From values at `known` (k,) to those of the polynomial through them at `wanted` (j,): (j, k)."""
    return np.asarray(
        np.stack(
            [
                np.prod([(wanted - other) / (own - other) for other in np.delete(known, i)], axis=0)
                if len(known) > 1
                else wanted**0
                for i, own in enumerate(known)
            ],
            axis=1,
        )
    )


def sensitivities(A: Array, B: Array, basis: Array, lengths: Array) -> Array:
    """d x / d [x at the start; coefficients] at the ends of the steps of classical RK4 (N, S + 1, n, n + s m).

    Args:
        A, B: of the dynamics along N elements, at the starts, middles and ends of the steps, (N, 2 S + 1, n, n) and
            (N, 2 S + 1, n, m).
        basis: the input's polynomials there (2 S + 1, s).
        lengths: of the elements (N,) [s].
    """
    N, instants, n, m = B.shape
    S, s = (instants - 1) // 2, basis.shape[1]
    result = np.empty((N, S + 1, n, n + s * m))
    V = np.zeros((N, n, n + s * m))
    V[:, :, :n] = np.eye(n)
    result[:, 0] = V
    h = (lengths / S)[:, None, None]

    def slope(instant: int, V: Array) -> Array:
        k = A[:, instant] @ V
        for i, value in enumerate(basis[instant]):
            k[:, :, n + i * m : n + (i + 1) * m] += value * B[:, instant]
        return np.asarray(k)

    for step in range(S):
        first = slope(2 * step, V)
        second = slope(2 * step + 1, V + h / 2 * first)
        third = slope(2 * step + 1, V + h / 2 * second)
        fourth = slope(2 * step + 2, V + h * third)
        V = V + h / 6 * (first + 2 * second + 2 * third + fourth)
        result[:, step + 1] = V
    return result
