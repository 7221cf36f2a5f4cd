"""What noisy samples say within a band of frequencies: least-squares splines that start and end at rest."""

from __future__ import annotations

import math

import numpy as np
import scipy  # loads scipy.interpolate and scipy.sparse at their first use
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_number, real_vector, whole_number
from invtrack.errors import TrajectoryError
from invtrack.references.polynomials import power_of_two_below
from invtrack.references.samples import LARGEST_DEGREE, require_increasing, require_samples, spline_signal
from invtrack.references.signal import PiecewiseSignal

SAMPLES_PER_PIECE = 2
"""Least number of samples, on an average, that each polynomial piece is fitted to."""

SINGULAR = 1e-13
"""Share of their largest below which a diagonal entry of the normal equations' factor counts as zero."""


def smoothed_reference(
    times: ArrayLike,
    values: ArrayLike,
    *,
    band: float,
    start: ArrayLike | None = None,
    degree: int = 7,
    smoothness: int | None = None,
) -> PiecewiseSignal:
    """The spline with even pieces that comes nearest to samples, in the sense of least squares: what they say within a band.

    Pieces of the length pi / band follow what is slower than `band` and average over what is faster, such as noise: of white noise
    a share of about (pieces / samples)^(1/2) remains. Derivatives 1 ... degree - 1 are continuous, and it is held at its ends,
    where `smoothness` derivatives vanish; the values there are fitted, too, but for a start that is known.

    Args:
        times: (m,), increasing, evenly spaced or not [s].
        values: (m, p), or (m,) for one channel.
        band: the highest frequency that it is to follow [rad/s].
        start: the value (p,) at its start, where that is known.
        degree: of the polynomial pieces, from 1 on.
        smoothness: how many derivatives vanish at both ends, from 0 to degree - 1, the default. A plant of relative degree r needs
            r - 1 or more.

    Raises TrajectoryError where shapes do not fit, times do not increase, values are not finite, or the band asks for pieces
    without enough samples in each of them. Source: C. de Boor, A Practical Guide to Splines, 2001, ch. XIV.
    """
    t, y = require_samples(times, values)
    require_increasing(t, lambda i: f"sample {i}")
    band = real_number("band", band, unit="rad/s", error=TrajectoryError)
    if not (math.isfinite(band) and band > 0):
        raise TrajectoryError(f"band must be a positive number [rad/s], got {band}")
    degree = whole_number("degree", degree, lowest=1, highest=LARGEST_DEGREE)
    rest = whole_number("smoothness", degree - 1 if smoothness is None else smoothness, highest=degree - 1)
    pieces = max(1, math.ceil((t[-1] - t[0]) * band / math.pi * (1 - 1e-9))) if len(t) > 1 else 1
    pieces = max(pieces, 2 * rest + 2 - degree)  # else the ends leave nothing to fit
    if len(t) < SAMPLES_PER_PIECE * pieces:
        raise TrajectoryError(
            f"a band of {band:g} rad/s means {pieces} polynomial pieces over {t[-1] - t[0]:.6g} s, too many for {len(t)} samples, "
            f"of which each needs {SAMPLES_PER_PIECE}; take a lower band or more samples"
        )
    edges = np.linspace(t[0], t[-1], pieces + 1)
    scale = power_of_two_below((t[-1] - t[0]) / pieces)
    knots = np.concatenate([np.full(degree, edges[0]), edges, np.full(degree, edges[-1])]) / scale
    offset = y.mean(axis=0) if start is None else real_vector("start", start, [f"channel {i}" for i in range(y.shape[1])])
    c = _fitted(t / scale, y - offset, knots, degree, rest, started=start is not None)
    if c is None:
        raise TrajectoryError(
            f"a band of {band:g} rad/s means pieces of {(t[-1] - t[0]) / pieces:.4g} s, and some have too few samples; take "
            "a lower band, or samples that lie more evenly"
        )
    spline = scipy.interpolate.BSpline(knots, c, degree)
    starts = np.vstack([c[:1], spline(edges[1:-1] / scale)])
    return spline_signal(spline, edges, scale, starts + offset, c[-1] + offset)


def _fitted(t: Array, y: Array, knots: Array, degree: int, rest: int, *, started: bool) -> Array | None:
    """Coefficients (n, p) of the spline nearest to samples y (m, p), None where they do not determine it.

    The outermost rest + 1 at either end are equal; started: those at the start are zero.
    """
    n = len(knots) - degree - 1
    design = scipy.interpolate.BSpline.design_matrix(t, knots, degree)
    owner = np.clip(np.arange(n) - rest, 0, n - 2 * rest - 1)  # coefficients that are one unknown
    tie = scipy.sparse.csr_array((np.ones(n), (np.arange(n), owner)))
    tied = (scipy.sparse.csr_array(design) @ tie)[:, int(started) :]
    normal = scipy.sparse.dia_array(tied.T @ tied)
    width = int(np.max(np.abs(normal.offsets)))
    banded = np.zeros((width + 1, normal.shape[0]))
    for offset, diagonal in zip(normal.offsets, normal.data, strict=True):
        if offset >= 0:
            banded[width - offset] = diagonal
    try:
        factor = scipy.linalg.cholesky_banded(banded)
    except np.linalg.LinAlgError:
        return None
    if np.min(factor[-1]) ** 2 <= SINGULAR * np.max(factor[-1]) ** 2:
        return None
    found = scipy.linalg.cho_solve_banded((factor, False), tied.T @ y)
    return np.asarray(np.vstack([np.zeros((int(started), y.shape[1])), found])[owner])
