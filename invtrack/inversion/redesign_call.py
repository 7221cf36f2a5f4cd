"""The call of quadratic_redesign that serves where an inverse does not, or hardly: what refusals and remarks name."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.signal import PiecewiseSignal

REDESIGN_ERROR = 1e-3
"""Where a refusal names quadratic_redesign: output error, as a share of the motion, that weighs as much as the peak input."""


def call_for(plant: SwitchedSystem, reference: PiecewiseSignal) -> str:
    """The call for a plant that has no inverse: inputs are as large as a least squares fit asks at the pace of the manoeuvre.

    reference: deviations from the operating point.
    """
    system, (start, end) = plant.systems[0], reference.manoeuvre
    motion = np.maximum(reference.size(0), np.abs(reference(end + 1.0)))
    s = 1j * np.pi / (end - start if end > start else 1.0)
    gains = system.C @ np.linalg.solve(s * np.eye(system.n_states) - system.A, system.B) + system.D
    size = _sizes(motion)
    inputs = np.linalg.pinv(gains / size[:, None]) @ (motion / size)
    return redesign_call(motion, np.abs(inputs), held=np.zeros(plant.n_inputs), error=REDESIGN_ERROR)


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
