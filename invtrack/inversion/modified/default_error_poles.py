"""Where the poles of the output's error go where nobody says: about as fast as the zeros moved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from invtrack.arrays import Array, ComplexArray

PACE = 1.25
"""Modulus of the default error poles, in units of the largest modulus to which a zero is moved.

Measured with the least-error design on the two-disc rig (slews of 1 to 20 s), its passive variant, HE3, the cantilever and a
hovering vehicle: between 1 and 1.5 the largest error is at most 1.7 times (mostly 1.3 times) what the best choice between 0.25
and 5 reaches, whatever the duration. Slower poles leave up to 40 times that error; faster ones ask for up to twice the input and
gain little.
"""

SETTLED = 10.0
"""Modulus of the error poles times the manoeuvre's duration, where no zero is moved and they do not matter much."""


def default_error_poles(degrees: Sequence[int], targets: ComplexArray, duration: float) -> ComplexArray:
    """A Butterworth pattern for the chain of each output (rho,) [rad/s]: (s / w)^(2 r) = -(-1)^r, left of the axis.

    Args:
        degrees: relative degree r of each output (p,).
        targets: where zeros are moved, in all intervals [rad/s].
        duration: of the manoeuvre [s].
    """
    size = float(np.max(np.abs(targets), initial=0.0))
    w = PACE * size if size > 0 else SETTLED / duration if duration > 0 else 1.0
    return np.concatenate([w * butterworth(r) for r in degrees]).astype(complex)


def butterworth(order: int) -> ComplexArray:
    """Poles (order,) of the Butterworth filter with a cut-off at 1 rad/s, each pair's conjugates beside each other."""
    angles: Array = np.pi / 2 * (1 + (2 * np.arange(order // 2) + 1) / order)
    upper = np.exp(1j * angles)
    pairs = np.column_stack([upper, upper.conj()]).ravel()
    return np.append(pairs, -1.0) if order % 2 else pairs
