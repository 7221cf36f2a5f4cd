"""What a run cost, by the weights of a redesign."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers, real_weight
from invtrack.errors import InvtrackError
from invtrack.results.result import RunResult, require_run


def run_cost(
    result: RunResult,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    u_0: ArrayLike = 0.0,
    wanted: ArrayLike | None = None,
) -> float:
    """Integral over the run of (u - u_0)'R (u - u_0) + x'Q_x x + (y - y_d)'Q_y (y - y_d), of what was recorded.

    u is the input applied, which holds over each step, and x the deviation from the operating point; both of them and y are as
    recorded, so feedback and disturbances count. Trapezoidal rule: an error of the order of the step squared.

    Args:
        result: the run.
        R, Q_x, Q_y: weights (p, p), (n, n) and (p, p); a number stands for that multiple of the identity.
        u_0: input at the operating point (p,).
        wanted: y_d at the run's times (N + 1, p), where it is not the reference that the controller was given (a plan for another
            reference still has to answer for the one that is wanted).

    Raises InvtrackError for weights or a reference of the wrong shape, and for a run that diverged.
    """
    require_run(result)
    if result.status == "diverged":
        raise InvtrackError(f"run {result.name!r} diverged ({result.message}): its cost is not defined; take a smaller timestep")
    output = result.output.values
    y_d = result.reference.values if wanted is None else real_numbers("wanted", wanted, error=InvtrackError)
    if y_d.shape != output.shape or not np.all(np.isfinite(y_d)):
        raise InvtrackError(
            f"wanted has shape {y_d.shape}, expected {output.shape}: a finite value per sample and output of {result.name!r}"
        )
    rest = real_numbers("u_0", u_0, error=InvtrackError)
    if rest.shape not in ((), result.applied.values.shape[1:]) or not np.all(np.isfinite(rest)):
        raise InvtrackError(f"u_0 must be a finite number for each of the inputs {result.applied.channels}, got {rest.tolist()}")
    u = result.applied.values - rest
    step = np.diff(result.time)
    moving = _quadratic("Q_x", Q_x, result.state.values) + _quadratic("Q_y", Q_y, output - y_d)
    return float(step @ (_quadratic("R", R, u) + (moving[:-1] + moving[1:]) / 2))


def _quadratic(name: str, weight: ArrayLike, values: Array) -> Array:
    """values' weight values of each sample, (m,)."""
    channels = values.shape[1]
    matrix = real_weight(name, weight, channels, error=InvtrackError)
    return np.asarray(np.einsum("mi,ij,mj->m", values, matrix, values))
