"""The call of quadratic_redesign that serves where an inverse does not, or hardly: what refusals and remarks name."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array


def redesign_call(motion: Array, inputs: Array, *, held: Array, error: float) -> str:
    """The call, with weights to one digit at which outputs and inputs count in their own sizes, and whether it needs more.

    Args:
        motion: size of each output's motion (p,).
        inputs: size of each input's (p,), as departures from the operating point.
        held: inputs that hold the outputs where they end (p,): a quadratic cost needs them to be zero.
        error: output error, as a share of the motion, that is to weigh as much as an input at its size.
    """
    R, Q_y = (error / _sizes(inputs)) ** 2, 1 / _sizes(motion) ** 2
    call = f"invtrack.quadratic_redesign(model, reference, R={_weight(R)}, Q_y={_weight(Q_y)})"
    if np.any(np.abs(held) > 1e-9 * np.max(np.abs(inputs), initial=0.0)):
        call += ", for a reference that ends where holding the output takes no input,"
    return call


def _sizes(values: Array) -> Array:
    """Sizes, the largest for those that are zero."""
    largest = float(np.max(values, initial=0.0))
    return np.where(values > 1e-9 * largest, values, largest if largest > 0 else 1.0)


def _weight(weights: Array) -> str:
    texts = [f"{weight:.1g}" for weight in weights]
    return texts[0] if len(set(texts)) == 1 else f"np.diag([{', '.join(texts)}])"
