"""Extra-insensitive input shapers, their constraints solved numerically for any damping and tolerance.

Source: W. Singhose, W. Seering, N. Singer, "Residual vibration reduction using vector diagrams to generate shaped inputs", ASME
Journal of Mechanical Design 116(2), 1994; W. Singhose, L. Porter, T. Tuttle, N. Singer, "Vibration reduction using multi-hump input
shapers", ASME Journal of Dynamic Systems, Measurement, and Control 119(2), 1997. They print closed forms for no damping and curve
fits for some; here the constraints are solved: amplitudes come out within 1e-3 of the fits, times within 1 % for damping ratios up
to 0.1.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy  # loads scipy.optimize at its first use

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import ControlError

DAMPING_STEP = 0.02
"""The solution is followed from the closed form for no damping in steps of the damping ratio of at most this."""

MET = 1e-10
"""Largest residual of the constraints with which a solution counts as one."""


@lru_cache(maxsize=256)
def extra_insensitive(humps: int, damping: float, tolerance: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Amplitudes and times of the impulses, the times in units of 1 / (natural frequency), of the shaper with 1 or 2 humps.

    Between two frequencies at which it leaves nothing, the residual vibration rises to `tolerance` and no further: once, at the
    modelled frequency, or twice, with nothing left at the modelled frequency between.

    Raises ControlError where there is none with positive amplitudes, as at high damping.
    """
    unknowns = _undamped(humps, tolerance)
    for zeta in np.linspace(0.0, damping, int(np.ceil(damping / DAMPING_STEP)) + 1)[1:].tolist():
        found = scipy.optimize.root(_constraints, unknowns, (humps, zeta, tolerance), tol=1e-14)
        unknowns = found.x
        if not np.max(np.abs(found.fun)) <= MET:
            break
    amplitudes, times, _ = _read(unknowns, humps)
    missed = np.max(np.abs(_constraints(unknowns, humps, damping, tolerance)))
    if not missed <= MET or np.any(amplitudes <= 0) or np.any(np.diff(times) <= 0):
        raise ControlError(
            f"no extra-insensitive shaper with {humps} hump(s) and positive impulses was found for a damping ratio of "
            f"{damping:.3g} and a tolerance of {tolerance:.3g}; take the kind ZVD, which there is for any damping"
        )
    return tuple(amplitudes.tolist()), tuple(times.tolist())


def _undamped(humps: int, tolerance: float) -> Array:
    """The unknowns without damping, in closed form."""
    V = tolerance
    if humps == 1:
        away = np.arccos((V - 1) / (V + 1)) / np.pi  # where half the period is that share of the modelled one, nothing is left
        return np.array([(1 + V) / 4, (1 - V) / 2, np.pi, 2 * np.pi, away, 2 - away])
    X = np.cbrt(V * V * (np.sqrt(1 - V * V) + 1))
    A_1 = (3 * X * X + 2 * X + 3 * V * V) / (16 * X)
    A_2 = 0.5 - A_1
    away, hump = (np.arccos(np.sqrt((3 * A_1 - A_2) / (share * A_1))) * 2 / np.pi for share in (4, 12))
    return np.array([A_1, A_2, A_2, np.pi, 2 * np.pi, 3 * np.pi, away, 2 - away, hump, 2 - hump])


def _read(unknowns: Array, humps: int) -> tuple[Array, Array, Array]:
    """Amplitudes (k,), times (k,), and the frequencies of the outer zeros and of what humps are not at the modelled one."""
    k = humps + 1
    return np.append(unknowns[:k], 1 - np.sum(unknowns[:k])), np.append(0.0, unknowns[k : 2 * k]), unknowns[2 * k :]


def _constraints(unknowns: Array, humps: int, damping: float, tolerance: float) -> Array:
    """What is zero: vibration at the zeros, its excess over the tolerance and its slope over frequency at the humps."""
    amplitudes, times, frequencies = _read(unknowns, humps)
    zeros = frequencies[:2] if humps == 1 else np.append(frequencies[:2], 1.0)
    at = np.ones(1) if humps == 1 else frequencies[2:]
    rate = damping + 1j * np.sqrt((1 - damping) * (1 + damping))
    left = _left(amplitudes, times, rate * zeros) * np.exp(-damping * zeros * times[-1])
    hump = _left(amplitudes, times, rate * at)
    slope = (_left(amplitudes * times, times, rate * at) * rate / hump).real - damping * times[-1]
    excess = np.abs(hump) * np.exp(-damping * at * times[-1]) - tolerance
    return np.concatenate([left.real, left.imag, excess, slope])


def _left(amplitudes: Array, times: Array, rates: ComplexArray) -> ComplexArray:
    """sum over i of amplitudes_i exp(rate times_i) for rates (k,)."""
    return np.asarray(np.exp(np.multiply.outer(rates, times)) @ amplitudes)
