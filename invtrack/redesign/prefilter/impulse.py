"""The prefilter as a convolution kernel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import RedesignError
from invtrack.redesign.prefilter.frequency_response import OptimalResponse
from invtrack.redesign.prefilter.reference_spectrum import FourierWindow

Array = NDArray[np.float64]

FAR = 1e6
"""Where a response is looked at for a direct feedthrough, in multiples of the bandwidth."""

FALLEN = 1e-3
"""A response that has fallen to this share by then has no direct feedthrough: the slowest fall is as 1 / w."""


@dataclass(frozen=True, eq=False)
class ImpulseResponse:
    """Kernels at times (m,) [s]: g_u (m, p, p), g_x (m, n, p), g_f (m, p, p), the optimum being g_u * y_d, g_x * y_d, g_f * y_d.

    Not causal: values before time 0 are what the optimum does ahead of the reference. At a jump at time 0 the sample is the mean of
    both sides. truncation_error: what doubling window and bandwidth change, as a share of each kernel's peak.
    """

    time: Array
    g_u: Array
    g_x: Array
    g_f: Array
    truncation_error: float

    def preview_time(self, level: float) -> float:
        """How long [s] before time 0 the kernel of some input first exceeds `level` of that input's peak; 0 where it never does."""
        size = np.max(np.abs(self.g_u), axis=2)  # (m, p)
        above = np.any(size > level * np.max(size, axis=0), axis=1) & (self.time < 0)
        return float(-self.time[above][0]) if np.any(above) else 0.0


def require_strictly_proper(response: OptimalResponse, bandwidth: float) -> None:
    """Raises RedesignError where the response does not fall off far above the bandwidth [rad/s]."""
    low, far = (np.max(np.abs(response(bandwidth * np.array(w)).stacked), axis=(0, 2)) for w in ([0.01, 0.1, 1.0], [FAR]))
    if np.any(far > FALLEN * low):
        raise RedesignError(
            "the kernel contains an impulse, because the optimum does not fall off at high frequencies (a direct feedthrough D, or "
            "an input that costs nothing there); use apply, which needs no kernel, or give weight R to the input"
        )


def impulse_samples(response: OptimalResponse, window: FourierWindow) -> Array:
    """Samples of [g_u; g_x; g_f] (samples, (p + n + p) p) on a window about time 0.

    The kernels may jump or have kinks at time 0, so that their transforms fall slowly. What the transform is at the band's edge is
    taken out as a two-sided exponential, whose kernel is known: j b w / (c^2 + w^2) belongs to -b sgn(t) exp(-c |t|) / 2, and
    b / (c^2 + w^2) to b exp(-c |t|) / (2 c).
    """
    w = window.frequencies
    G = response(w).stacked.reshape(len(w), -1)
    edge = w[-1]
    c = 40.0 / window.length * np.sqrt(window.harmonics / 40.0 + 1.0)  # dies out within the window, far below the band's edge
    odd, even = G[-1].imag * (c**2 + edge**2) / edge, G[-1].real * (c**2 + edge**2)
    shape = 1.0 / (c**2 + w**2)[:, None]
    rest = (G - (even + 1j * odd * w[:, None]) * shape) * np.exp(1j * w * window.start)[:, None]
    t = window.sample_times[:, None]
    decay = np.exp(-c * np.abs(t))
    return np.asarray(window.synthesize(rest) + decay * (even / (2 * c) - odd * np.sign(t) / 2))
