"""Trajectories from the Fourier transform of their rate, on a window long enough for them to come to rest inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.interpolate import make_interp_spline

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

OVERSAMPLING = 4
"""Samples per half period of the highest harmonic, for the interpolation between them."""

SPLINE_MARGIN = 30
"""Samples kept beyond the times asked for: the spline's end conditions have died out over them."""


@dataclass(frozen=True)
class FourierWindow:
    """Times start ... start + length [s] and the frequencies w_k = 2 pi k / length, k = 0 ... harmonics."""

    start: float
    length: float
    harmonics: int

    @classmethod
    def covering(cls, start: float, end: float, bandwidth: float) -> FourierWindow:
        """The window from start to end [s] with frequencies up to `bandwidth` [rad/s] at least."""
        return cls(start, end - start, int(np.ceil(bandwidth * (end - start) / (2 * np.pi))))

    @property
    def end(self) -> float:
        """Last time [s]."""
        return self.start + self.length

    @property
    def frequencies(self) -> Array:
        """w_k [rad/s], (harmonics + 1,)."""
        return np.asarray(2 * np.pi / self.length * np.arange(self.harmonics + 1.0))

    def lengthened(self) -> FourierWindow:
        """Twice as long about the same middle, with the same bandwidth."""
        return FourierWindow(self.start - self.length / 2, 2 * self.length, 2 * self.harmonics)

    def widened(self) -> FourierWindow:
        """With twice the bandwidth."""
        return FourierWindow(self.start, self.length, 2 * self.harmonics)

    @property
    def sample_times(self) -> Array:
        """Evenly spaced times over the window, both ends included."""
        return np.linspace(self.start, self.end, self._samples + 1)

    @property
    def _samples(self) -> int:
        return int(scipy.fft.next_fast_len(2 * OVERSAMPLING * (self.harmonics + 1), real=True))

    def synthesize(self, spectrum: ComplexArray) -> Array:
        """Samples at `sample_times` of the signal with this Fourier transform at w_k (from the start): (samples, c)."""
        count = self._samples
        periodic = scipy.fft.irfft(spectrum / self.length, n=count, axis=0) * count
        return np.concatenate([periodic, periodic[:1]])

    def integrate(self, rate: ComplexArray, initial: Array) -> Array:
        """Samples at `sample_times` of the signal that starts at `initial` (c,) and whose rate has this transform at w_k.

        The bin at w = 0 is the whole change over the window, a straight line in the integral; all else is periodic, and so there is
        no wrap-around from where the signal ends to where it began.
        """
        w = self.frequencies
        change = rate[0].real
        periodic = rate.copy()
        periodic[1:] /= 1j * w[1:, None]
        periodic[0] = 0.0
        samples = self.synthesize(periodic)
        return np.asarray(initial + np.linspace(0.0, 1.0, len(samples))[:, None] * change + samples - samples[0])

    def interpolate(self, samples: Array, times: Array) -> Array:
        """Values at any times (m,); beyond the window those at its ends: (m, c)."""
        grid = self.sample_times
        inside = np.clip(times, self.start, self.end)
        first, last = np.searchsorted(grid, [inside.min(), inside.max()])
        kept = slice(max(int(first) - SPLINE_MARGIN, 0), int(last) + SPLINE_MARGIN)
        spline = make_interp_spline(grid[kept], samples[kept], k=5)
        return np.asarray(spline(inside))
