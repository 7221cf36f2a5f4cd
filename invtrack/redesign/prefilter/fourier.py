"""Between time and frequency: windows, the transforms of references on them, and signals refined until nothing changes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.fft and scipy.interpolate at their first use

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.errors import RedesignError
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal

OVERSAMPLING = 4
"""Samples per half period of the highest harmonic, for the interpolation between them."""

SPLINE_MARGIN = 30
"""Samples kept beyond the times asked for: the spline's end conditions have died out over them."""

PROMPT_HARMONICS = 2**13
"""Up to this many frequencies a window is refined in any case; they take a second or two."""

MAX_HARMONICS = 2**17
"""Windows with more frequencies than this are not refined further."""

USELESS = 1e-2
"""A signal that is truncated by more than this share of its peak is not handed out, unless it was asked for."""

NOT_ALONE = 0.1
"""What makes up more than this share of the truncation error is named among its reasons."""

QUIET_CHANNEL = 1e-6
"""A channel whose peak is below this share of the largest of its kind is measured against that share."""

QUADRATURE_FACTOR = 2.0
"""Below this many times the norm of a piece's S the transform is found by quadrature: (S - jw)^-1 may be singular there."""

PANEL_ANGLE = 8.0
"""Largest panel length times the fastest frequency in it; 16 Gauss points are then exact to rounding."""

SAME_LENGTH_DIGITS = 12
"""Pieces whose lengths agree to this many digits of the longest share their integral."""

BLOCK = 2_000_000
"""Phases e^(-jwt) that are held in memory at once."""


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

    @property
    def bandwidth(self) -> float:
        """Highest frequency [rad/s]."""
        return 2 * np.pi * self.harmonics / self.length

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
        spline = scipy.interpolate.make_interp_spline(grid[kept], samples[kept], k=5)
        return np.asarray(spline(inside))


class OncePerFrequency:
    """A function of frequency that is evaluated once at each: the grids of windows lengthened and widened contain one another's."""

    def __init__(self, function: Callable[[Array], ComplexArray]) -> None:
        """function: from frequencies (m,) to values (m, ...)."""
        self._function = function
        self._w: Array = np.zeros(0)
        self._values: ComplexArray | None = None

    def __call__(self, w: Array) -> ComplexArray:
        """Values at frequencies w (m,), which increase."""
        fresh = np.setdiff1d(w, self._w, assume_unique=True)
        if self._values is None:
            self._w, self._values = fresh, self._function(fresh)
        elif fresh.size:
            both = np.concatenate([self._w, fresh])
            order = np.argsort(both)
            self._w, self._values = both[order], np.concatenate([self._values, self._function(fresh)])[order]
        return np.asarray(self._values[np.searchsorted(self._w, w)])


@dataclass(frozen=True, eq=False)
class Refined:
    """A signal as good as it gets: values (m, c) at times (m,), its truncation error as a share of each peak, and remarks."""

    times: Array
    values: Array
    truncation_error: float
    remarks: tuple[str, ...]


def refine(
    samples: Callable[[FourierWindow], Array], window: FourierWindow, times: Array | None, tolerance: float, groups: Sequence[int]
) -> Refined:
    """A signal whose samples on any window are known, with windows made longer and wider until that changes nothing.

    The error is the largest change at these times when the window is made twice as long plus the one when the bandwidth is doubled,
    relative to the channel's peak over the window; both changes are made to the values, so that it bounds what is left of them
    wherever doubling at least halves it. It does so even for a spectrum that jumps, whose error falls as one over the window's
    length. Such a spectrum reaches no small tolerance at any price: beyond PROMPT_HARMONICS, refinement goes on only while the
    measured convergence leads to the tolerance within MAX_HARMONICS. Otherwise the values come with what has been attained.

    Args:
        samples: gives the signal's values (samples, c) at the `sample_times` of a window.
        window: the one to begin with.
        times: where the signal is wanted (m,) [s]; None: all over the window.
        tolerance: truncation error from which on no refinement is wanted.
        groups: how many channels are of one kind (inputs, states, outputs).

    Raises RedesignError where the attained error is above both `tolerance` and USELESS.
    """
    if window.harmonics > PROMPT_HARMONICS:  # far-apart time scales: let the measured error say how much bandwidth it takes
        window = FourierWindow(window.start, window.length, PROMPT_HARMONICS)
    values, before = samples(window), [np.inf, np.inf]
    while True:
        at = np.linspace(window.start, window.end, 2 * window.harmonics + 1) if times is None else times
        finer = (window.lengthened(), window.widened())
        finer_values = [samples(each) for each in finer]
        here, peak = window.interpolate(values, at), _peaks(values, groups)
        changes = [each.interpolate(value, at) - here for each, value in zip(finer, finer_values, strict=True)]
        errors = [float(np.max(np.abs(change) / peak)) for change in changes]
        error = sum(errors)
        if error <= tolerance:
            return Refined(at, here + changes[0] + changes[1], error, ())
        if window.harmonics >= PROMPT_HARMONICS and _doublings(errors, before, tolerance) > np.log2(
            MAX_HARMONICS / window.harmonics
        ):
            break
        longer = int(errors[1] > errors[0])
        before[longer] = errors[longer]
        window, values = finer[longer], finer_values[longer]
    attained = (
        f"truncated by {error:.1e} of its peak, more than the tolerance {tolerance:.1e}: twice the window ({window.length:.4g} s) "
        f"still changes it by {errors[0]:.1e}, twice the bandwidth ({window.bandwidth:.4g} rad/s) by {errors[1]:.1e}"
    )
    if error > USELESS:
        raise RedesignError(
            f"the redesign is {attained}, and refinement does not lead below {USELESS:g}; use "
            + ("weights that change less abruptly with frequency" if errors[0] > errors[1] else "a smoother reference")
            + ", more input weight R, or, with constant weights, quadratic_redesign"
        )
    reasons = (
        "it dies out slowly in time, as where a weight changes abruptly with frequency",
        "its spectrum falls off slowly, as where a reference is not smooth",
    )
    why = (reason for reason, each in zip(reasons, errors, strict=True) if each > NOT_ALONE * error)
    return Refined(at, here + changes[0] + changes[1], error, ("; ".join([attained, *why]),))


def _doublings(errors: Sequence[float], before: Sequence[float], tolerance: float) -> float:
    """How many more doublings of window and bandwidth, in all, lead to the tolerance if each does what the last one did.

    before: the errors before the last doubling of each kind, infinite where there was none: then one may be enough.
    """
    wanted, total = tolerance / 2, 0.0
    for now, earlier in zip(errors, before, strict=True):
        if now > wanted:
            gain = np.log(earlier / now)
            total += np.inf if gain <= 0 else float(max(1.0, np.ceil(np.log(now / wanted) / gain)))
    return total


def _peaks(values: Array, groups: Sequence[int]) -> Array:
    """Largest |value| of each channel, or the share of its kind's largest that counts for quiet ones: (c,)."""
    peak: Array = np.max(np.abs(values), axis=0)
    per_kind = len(peak) // sum(groups)
    for part in np.split(peak, np.cumsum(groups)[:-1] * per_kind):
        largest = np.max(part, initial=0.0)
        part[:] = np.maximum(part, QUIET_CHANNEL * largest) if largest > 0 else 1.0
    return peak


def rate_spectrum(reference: PiecewiseSignal, w: Array, origin: float) -> ComplexArray:
    """Integral of y_d'(t) exp(-jw (t - origin)) dt at frequencies w (m,) [rad/s], jumps of y_d included: (m, p).

    On a piece w' = S w, y_d = R w it is R S (S - jw)^-1 [exp(-jwt) w(t)] between the piece's ends.
    """
    ends = reference.breakpoints
    inner = np.concatenate([[ends[0] - 1.0], (ends[:-1] + ends[1:]) / 2, [ends[-1] + 1.0]])
    jumps = reference(ends, inside=inner[1:]) - reference(ends, inside=inner[:-1])
    result = _sum_of_phases(w, ends - origin, jumps)
    for index, generator in enumerate(reference.generators):
        norm = float(np.linalg.norm(generator.S, 2))
        pieces = np.flatnonzero(reference.kind[1:-1] == index) + 1  # piece j from t_(j-1) to t_j
        if norm > 0 and pieces.size:
            slow = np.abs(w) < QUADRATURE_FACTOR * norm
            if np.any(slow):
                result[slow] += _by_quadrature(reference, index, pieces, w[slow], origin)
            result[~slow] += _by_resolvent(reference, index, pieces, w[~slow], origin)
    return result


def _by_quadrature(reference: PiecewiseSignal, index: int, pieces: Indices, w: Array, origin: float) -> ComplexArray:
    """With the integral of R S exp((S - jw) tau) over a piece, which pieces of the same length share."""
    generator = reference.generators[index]
    starts = reference.breakpoints[pieces - 1]
    lengths = reference.breakpoints[pieces] - starts
    _, first, owner = np.unique(np.round(lengths / lengths.max(), SAME_LENGTH_DIGITS), return_index=True, return_inverse=True)
    result = np.zeros((len(w), reference.n_channels), dtype=complex)
    for group, length in enumerate(lengths[first]):
        ours = pieces[owner == group]
        v = _sum_of_phases(w, starts[owner == group] - origin, reference.anchors[ours, : len(generator.S)])
        result += np.einsum("mpq,mq->mp", _transfer(generator, float(length), w), v)
    return result


def _transfer(generator: Generator, length: float, w: Array) -> ComplexArray:
    """Integral of R S exp((S - jw) tau) over 0 < tau < length by Gauss's rule on panels: (m, p, q)."""
    q = len(generator.S)
    fastest = float(np.linalg.norm(generator.S, 2)) + float(np.max(np.abs(w), initial=0.0))
    panels = int(np.ceil(length * fastest / PANEL_ANGLE))
    nodes, weights = np.polynomial.legendre.leggauss(16)
    half = length / panels / 2
    tau = (half * (2 * np.arange(panels)[:, None] + 1 + nodes)).ravel()
    column = np.repeat(np.arange(q), len(tau))
    rows = generator.propagator(1.0).outputs(generator.derivative(1), np.eye(q), column, np.tile(tau, q))  # (q k, p)
    weighted = rows.reshape(q, len(tau), -1) * (half * np.tile(weights, panels))[:, None]
    flat = _sum_of_phases(w, tau, weighted.transpose(1, 2, 0).reshape(len(tau), -1))
    return flat.reshape(len(w), -1, q)


def _by_resolvent(reference: PiecewiseSignal, index: int, pieces: Indices, w: Array, origin: float) -> ComplexArray:
    generator = reference.generators[index]
    q = len(generator.S)
    starts, ends = reference.breakpoints[pieces - 1], reference.breakpoints[pieces]
    first = reference.anchors[pieces, :q]
    last = generator.propagator(1.0).states(first.copy(), ends - starts)
    v = _sum_of_phases(w, np.concatenate([ends, starts]) - origin, np.concatenate([last, -first]))
    solved = np.linalg.solve(generator.S - 1j * w[:, None, None] * np.eye(q), v[:, :, None])[:, :, 0]
    return np.asarray(solved @ generator.derivative(1).T)


def _sum_of_phases(w: Array, times: Array, values: Array) -> ComplexArray:
    """Sum over i of exp(-jw t_i) values_i for times (k,) and values (k, c): (m, c)."""
    result = np.zeros((len(w), values.shape[1]), dtype=complex)
    rows = max(1, BLOCK // max(len(w), 1))
    for first in range(0, len(times), rows):
        part = slice(first, first + rows)
        result += np.exp(-1j * np.outer(w, times[part])) @ values[part]
    return result
