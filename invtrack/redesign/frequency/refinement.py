"""Doubling the window and the bandwidth until neither changes the result."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import RedesignError
from invtrack.redesign.frequency.fourier_window import FourierWindow

Array = NDArray[np.float64]

MAX_HARMONICS = 2**18
"""Windows with more frequencies than this are not tried."""

QUIET_CHANNEL = 1e-6
"""A channel whose peak is below this share of the largest of its kind is measured against that share."""


def refine(
    samples: Callable[[FourierWindow], Array], window: FourierWindow, times: Array | None, tolerance: float, groups: Sequence[int]
) -> tuple[Array, Array, float]:
    """(times (m,), values (m, c), truncation error) of a signal whose samples on any window are known.

    The error is the largest change at these times when the window is made twice as long plus the one when the bandwidth is doubled,
    relative to the channel's peak over the window; `groups` says how many channels are of one kind (inputs, states, outputs).

    Raises RedesignError where it stays above `tolerance` with as many frequencies as are tried.
    """
    values = samples(window)
    while True:
        at = np.linspace(window.start, window.end, 2 * window.harmonics + 1) if times is None else times
        here, peak = window.interpolate(values, at), _peaks(values, groups)
        longer, wider = window.lengthened(), window.widened()
        longer_values, wider_values = samples(longer), samples(wider)
        window_error = float(np.max(np.abs(longer.interpolate(longer_values, at) - here) / peak))
        bandwidth_error = float(np.max(np.abs(wider.interpolate(wider_values, at) - here) / peak))
        if window_error + bandwidth_error <= tolerance:
            return at, here, window_error + bandwidth_error
        if longer.harmonics > MAX_HARMONICS:
            raise RedesignError(
                f"the redesign is truncated by {window_error:.1e} (window of {window.length:.4g} s) and {bandwidth_error:.1e} "
                f"(bandwidth of {2 * np.pi * window.harmonics / window.length:.4g} rad/s) of its peak, more than the tolerance "
                f"{tolerance:.1e}, and {MAX_HARMONICS} frequencies are not enough for less; accept a larger tolerance, use a "
                "smoother reference or more input weight R, or, with constant weights, the redesign in the time domain"
            )
        window, values = (longer, longer_values) if window_error > bandwidth_error else (wider, wider_values)


def _peaks(values: Array, groups: Sequence[int]) -> Array:
    """Largest |value| of each channel, or the share of its kind's largest that counts for quiet ones: (c,)."""
    peak: Array = np.max(np.abs(values), axis=0)
    per_kind = len(peak) // sum(groups)
    for part in np.split(peak, np.cumsum(groups)[:-1] * per_kind):
        largest = np.max(part, initial=0.0)
        part[:] = np.maximum(part, QUIET_CHANNEL * largest) if largest > 0 else 1.0
    return peak
