"""What a run really cost, in the terms of quadratic redesign."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import InvtrackError
from invtrack.results.result import RunResult

Array = NDArray[np.float64]


def run_cost(
    result: RunResult,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    u_0: ArrayLike = 0.0,
    wanted: ArrayLike | None = None,
) -> float:
    """Integral over the run of (u - u_0)'R (u - u_0) + x'Q_x x + (y - y_d)'Q_y (y - y_d), of what was measured.

    R (p, p), Q_x (n, n), Q_y (p, p); a number stands for that multiple of the identity. u: the input applied, which holds over each
    step; x: deviations from the operating point; both of them and y as recorded, so feedback and disturbances count. u_0 (p,):
    input at the operating point. wanted (N + 1, p): y_d at the run's times, where it is not the reference that the controller was
    given (a plan for another reference still has to answer for the one that is wanted). Trapezoidal rule: an error of the order
    of the step squared.

    Raises InvtrackError for weights or a reference of the wrong shape, and for a run that diverged.
    """
    if result.status == "diverged":
        raise InvtrackError(f"run {result.name!r} diverged ({result.message}): its cost is not defined; take a smaller timestep")
    output = result.output.values
    y_d = result.reference.values if wanted is None else np.asarray(wanted, dtype=float)
    if y_d.shape != output.shape:
        raise InvtrackError(
            f"wanted has shape {y_d.shape}, expected {output.shape}: a value per sample and output of {result.name!r}"
        )
    u = result.applied.values - np.asarray(u_0, dtype=float)
    step = np.diff(result.time)
    moving = _quadratic("Q_x", Q_x, result.state.values) + _quadratic("Q_y", Q_y, output - y_d)
    return float(step @ (_quadratic("R", R, u) + (moving[:-1] + moving[1:]) / 2))


def _quadratic(name: str, weight: ArrayLike, values: Array) -> Array:
    """values' weight values of each sample, (m,)."""
    channels = values.shape[1]
    matrix: Array = np.asarray(weight, dtype=float)
    matrix = matrix * np.eye(channels) if matrix.ndim == 0 else matrix
    if matrix.shape != (channels, channels):
        raise InvtrackError(f"{name} must be a number or a ({channels}, {channels}) matrix, got shape {matrix.shape}")
    return np.asarray(np.einsum("mi,ij,mj->m", values, matrix, values))
