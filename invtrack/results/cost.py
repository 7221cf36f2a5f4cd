"""What a run cost, by the weights of a redesign."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers, real_weight, shown
from invtrack.errors import InvtrackError
from invtrack.results.result import RunResult, Signal, require_run


def run_cost(
    result: RunResult,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    u_0: ArrayLike = 0.0,
    x_0: ArrayLike = 0.0,
    wanted: ArrayLike | None = None,
) -> float:
    """Integral over the run of (u - u_0)'R (u - u_0) + (x - x_0)'Q_x (x - x_0) + (y - y_d)'Q_y (y - y_d), of what was recorded.

    u is the input applied, which holds over each step, and x the deviation from the operating point; both of them and y are as
    recorded, so feedback and disturbances count. Trapezoidal rule: an error of the order of the step squared.

    Args:
        result: the run.
        R, Q_x, Q_y: weights (p, p), (n, n) and (p, p); a number stands for that multiple of the identity.
        u_0: input at rest (p,). Where jumps of the plant move it, that of each step (N, p): for a model
            `model.rest_inputs[model.interval(middle)]` with the times `middle` in the middle of the steps.
        x_0: state at rest (n,), or that of each step (N, n), `model.rest_states[model.interval(middle)]`.
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
    u = result.applied.values - _at_rest("u_0", u_0, result.applied)
    state, x_rest = result.state.values, _at_rest("x_0", x_0, result.state, steps=len(u))
    missed = _quadratic("Q_y", Q_y, output - y_d)
    sides = [_quadratic("Q_x", Q_x, x - x_rest) + miss for x, miss in ((state[:-1], missed[:-1]), (state[1:], missed[1:]))]
    return float(np.diff(result.time) @ (_quadratic("R", R, u) + (sides[0] + sides[1]) / 2))


def _at_rest(name: str, value: ArrayLike, signal: Signal, *, steps: int | None = None) -> Array:
    """What a signal is counted from: a number, one for each channel (k,), or those of each step (N, k)."""
    rest, shape = real_numbers(name, value, error=InvtrackError), signal.values.shape
    each_step = (shape[0] if steps is None else steps, shape[1])
    if rest.shape not in ((), shape[1:], each_step) or not np.all(np.isfinite(rest)):
        raise InvtrackError(
            f"{name} must be a finite number for each of {signal.channels}, or those of each of the {each_step[0]} steps, got "
            f"shape {rest.shape}, {shown(rest)}"
        )
    return rest


def _quadratic(name: str, weight: ArrayLike, values: Array) -> Array:
    """values' weight values of each sample, (m,)."""
    channels = values.shape[1]
    matrix = real_weight(name, weight, channels, error=InvtrackError)
    return np.asarray(np.einsum("mi,ij,mj->m", values, matrix, values))
