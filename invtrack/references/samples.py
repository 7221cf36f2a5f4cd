"""References through samples: interpolating splines that start and end at rest."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise

import numpy as np
import scipy  # loads scipy.interpolate at its first use
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, Indices, real_numbers, whole_number
from invtrack.errors import TrajectoryError
from invtrack.references.polynomials import polynomial_signal, state_units
from invtrack.references.signal import PiecewiseSignal

LARGEST_DEGREE = 99
"""A spline of higher degree through more than a few samples is rounding magnified, whatever they are."""

MISS_TOLERANCE = 1e-9
"""How far the spline may be off, as a share of its channel's motion: from the samples, and from the one through samples that are
not rounded. It is where they lie very unevenly, and where the degree is very high."""

LARGEST_EXCURSION = 100.0
"""How far it may go between samples, as a multiple of that motion; between evenly spaced ones it is a small multiple."""


def sampled_reference(times: ArrayLike, values: ArrayLike, *, degree: int = 5, smoothness: int | None = None) -> PiecewiseSignal:
    """The spline of any degree k through samples, held at the first and the last value before and after.

    times (m,) [s], increasing, evenly spaced or not; values (m, p), or (m,) for one channel. Derivatives 1 ... k - 1 are continuous
    between the ends. smoothness: how many derivatives vanish at both ends, from 0 to k // 2, the default; choose less where the
    samples do not begin and end at rest, then y^(i) = 0 there for i = (k + 1) // 2 ... k - 1 - smoothness instead. The polynomial
    pieces of an odd degree meet at the samples, and of all functions through the samples that rest in this sense at the ends this
    spline has the smallest integral of (y^((k+1)/2))^2; those of an even degree meet midway between them.

    A plant of relative degree r needs smoothness >= r - 1, so degree >= 2 r - 2. The distance to a smooth motion that rests in the
    same sense falls with the (k + 1)th power of the spacing; that of its r-th derivative with the (k + 1 - r)th.

    Differentiation amplifies noise: noise of size s in samples h apart gives about s / h^r in the r-th derivative, and samples good
    to rounding have s = 1e-16 of their size. See `reference_report`.

    Raises TrajectoryError where shapes do not fit, times do not increase, values are not finite, degree or smoothness is out of
    range, samples are too few, or they lie so unevenly, or the degree is so high, that rounding alone moves the spline by more than
    1e-9 of the motion (from degree 37 on for even spacing). Source: C. de Boor, A Practical Guide to Splines, 2001, ch. XIII.
    """
    t, y = require_samples(times, values)
    require_increasing(t, lambda i: f"sample {i}")
    smoothness = _require_possible(len(t), degree, smoothness)
    edges = _edges(t, degree)
    scale = float(np.max(state_units(np.diff(edges), degree)))  # a power of two, so that no knot is rounded
    offset = y[0]  # the spline is that of the motion, so that a large constant part costs no accuracy
    spline = _interpolant(t / scale, y - offset, degree, smoothness)
    starts = y[:-1] if degree % 2 else np.vstack([y[:1], offset + spline(edges[1:-1] / scale)])
    return spline_signal(spline, edges, scale, starts, y[-1])


def spline_signal(spline: scipy.interpolate.BSpline, edges: Array, scale: float, starts: Array, end: Array) -> PiecewiseSignal:
    """A spline as a signal, held at its ends before and after.

    Args:
        spline: the motion over t / scale.
        edges: of its polynomial pieces (m + 1,) [s].
        scale: a power of two [s].
        starts: value at each piece's start (m, p), which the spline itself may leave out a constant of.
        end: value after the last piece (p,).
    """
    degree, units = spline.k, state_units(np.diff(edges), spline.k)
    derivatives = np.zeros((*starts.shape, degree + 1))
    derivatives[:, :, 0] = starts
    for order in range(1, degree + 1):
        # Derivative after derivative from the coefficients' differences: its two neighbours at a knot see the same ones, so that
        # also derivatives full of noise are continuous to rounding of their own size.
        spline = spline.derivative()
        derivatives[:, :, order] = spline(edges[:-1] / scale) * ((units / scale) ** order)[:, np.newaxis]
    p = starts.shape[1]
    return polynomial_signal(edges, units, derivatives, (starts[0], end), rows=np.eye(p), offset=np.zeros(p))


def require_samples(times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """times (m,) and values (m, p), finite. Raises TrajectoryError where they are not, or do not fit each other."""
    t, y = real_numbers("times of the samples", times), real_numbers("values of the samples", values)
    y = y[:, None] if y.ndim == 1 else y
    if t.ndim != 1 or y.ndim != 2 or len(y) != len(t) or y.shape[1] == 0:
        raise TrajectoryError(
            f"expected times (m,) and values (m,) or (m, p) for the same m samples, got shapes {t.shape} and {np.shape(values)}"
        )
    for name, array in (("time", t[:, None]), ("value", y)):
        bad = np.flatnonzero(~np.all(np.isfinite(array), axis=1))
        if bad.size:
            raise TrajectoryError(
                f"sample {bad[0]} has a {name} that is not finite ({array[bad[0]].tolist()}); remove or repair it"
            )
    return t, y


def require_increasing(t: Array, place: Callable[[int], str]) -> None:
    """Raises TrajectoryError unless the times (m,) increase; place: what the message calls the sample of a number."""
    bad = np.flatnonzero(np.diff(t) <= 0)
    if bad.size:
        i = int(bad[0]) + 1
        raise TrajectoryError(
            f"{place(i)}: expected times that increase, got {t[i]:.17g} s after {t[i - 1]:.17g} s; sort the samples by "
            "time and drop repeated ones"
        )


def _require_possible(count: int, degree: int, smoothness: int | None) -> int:
    """The smoothness at the ends, once it and the number of samples are known to determine one spline."""
    degree = whole_number("degree", degree, lowest=1, highest=LARGEST_DEGREE)
    half = degree // 2
    smoothness = half if smoothness is None else whole_number(f"smoothness for degree {degree}", smoothness, highest=half)
    needed = max(2, (degree + 1) // 2 - 2 * smoothness)  # else a polynomial fits in between without any cost
    if count < needed:
        raise TrajectoryError(
            f"expected at least {needed} samples for a spline of degree {degree} with smoothness {smoothness}, got {count}; "
            "lower the degree or give more samples"
        )
    return smoothness


def _edges(t: Array, degree: int) -> Array:
    """Where the polynomial pieces meet: at the samples, for an even degree midway between them, and at both ends."""
    return t if degree % 2 else np.concatenate([t[:1], (t[:-1] + t[1:]) / 2, t[-1:]])


def _interpolant(t: Array, y: Array, degree: int, smoothness: int) -> scipy.interpolate.BSpline:
    """The spline through y (m, p) at times t (m,), y[0] = 0.

    At rest means that the outermost smoothness + 1 coefficients are equal: these are known to the last bit, and no equation for a
    vanishing derivative, with its large coefficients, disturbs the others.
    """
    edges, m, rest, p = _edges(t, degree), len(t), smoothness + 1, y.shape[1]
    n = len(edges) + degree - 1
    knots = np.concatenate([np.full(degree, t[0]), edges, np.full(degree, t[-1])])
    c = np.zeros((n, p + 1))
    c[n - rest :, :p] = y[-1]
    rows, first, natural = _equations(knots, t, degree, smoothness)
    right = np.zeros((len(rows), c.shape[1]))
    inner = slice(natural, natural + m - 2)
    right[inner, :p] = y[1:-1]
    # In one more channel the spline through samples that alternate between -1 and 1: between the samples none through samples of
    # size 1 goes further, as the matrix is totally positive, or nearly so (de Boor, ch. XIII).
    right[inner, p] = (-1.0) ** np.arange(m - 2)
    ends = np.flatnonzero(first + degree >= n - rest)  # rows in which coefficients occur that are known and not zero
    right[ends] -= np.einsum("ij,ijk->ik", rows[ends], c[first[ends, np.newaxis] + np.arange(degree + 1)])
    offset = first - rest - np.arange(len(rows))  # of each row's first coefficient from the diagonal
    entries = []
    for j in range(degree + 1):
        i = np.flatnonzero((first + j >= rest) & (first + j < n - rest) & (rows[:, j] != 0))
        entries.append((offset[i] + j, first[i] + j - rest, rows[i, j]))
    lower = -min(int(np.min(diagonal, initial=0)) for diagonal, _, _ in entries)
    upper = max(int(np.max(diagonal, initial=0)) for diagonal, _, _ in entries)
    banded = np.zeros((lower + upper + 1, len(rows)))
    for diagonal, column, values in entries:
        banded[upper - diagonal, column] = values
    try:
        if len(rows):
            c[rest : n - rest] = scipy.linalg.solve_banded((lower, upper), banded, right)
    except np.linalg.LinAlgError:
        c[:] = np.inf
    with np.errstate(invalid="ignore"):
        _require_well_posed(t, y, scipy.interpolate.BSpline(knots, c, degree))
    return scipy.interpolate.BSpline(knots, np.ascontiguousarray(c[:, :p]), degree)


def _equations(knots: Array, t: Array, degree: int, smoothness: int) -> tuple[Array, Indices, int]:
    """Rows (k, degree + 1), the first coefficient that each acts on (k,), and how many at either end are for natural ends.

    Those say that y^(i) = 0 for i = (degree + 1) // 2 ... degree - 1 - smoothness; the others are y at the inner samples.
    """
    start, end = (_natural_end(each, degree, smoothness) for each in (knots, -knots[::-1]))
    # The samples at the two ends, which are met already, are there because scipy takes no empty list of times.
    samples = scipy.interpolate.BSpline.design_matrix(t, knots, degree, extrapolate=True)
    values, columns = (each.reshape(-1, degree + 1)[1:-1] for each in (samples.data, samples.indices))
    rows = np.concatenate([start, values, end[::-1, ::-1]])
    first = np.concatenate([np.zeros(len(start)), columns[:, 0], np.full(len(end), len(knots) - 2 * degree - 2)])
    return rows, first.astype(np.intp), len(start)


def _natural_end(knots: Array, degree: int, smoothness: int) -> Array:
    """Rows (k, degree + 1) in the first coefficients: that the derivatives which are to vanish at a natural end do so.

    At high degrees the derivatives are nearly the same functions of the coefficients as one another. They are worked out in
    rational numbers, floating-point knots being such, and replaced with combinations that differ in a unit matrix.
    """
    orders = range((degree + 1) // 2, degree - smoothness)
    exact = [Fraction(knot) for knot in knots[: 2 * degree + 2].tolist()] if orders else []
    d = [[Fraction(int(i == j)) for j in range(degree + 1)] for i in range(degree + 1)]
    rows = []
    for order in range(1, orders.stop if orders else 1):
        spans = [exact[degree + 1 + i] - exact[order + i] for i in range(degree + 1 - order)]
        d = [[(b - a) / span for a, b in zip(*pair, strict=True)] for pair, span in zip(pairwise(d), spans, strict=True)]
        if order in orders:
            rows.append(d[0])
    for i in range(len(rows)):
        pivot = max(range(smoothness + 1, degree + 1), key=lambda j: abs(rows[i][j]))
        rows[i] = [value / rows[i][pivot] for value in rows[i]]
        for k in range(len(rows)):
            if k != i and rows[k][pivot]:
                factor = rows[k][pivot]
                rows[k] = [a - factor * b for a, b in zip(rows[k], rows[i], strict=True)]
    return np.array(rows, dtype=float).reshape(-1, degree + 1)


def _require_well_posed(t: Array, y: Array, spline: scipy.interpolate.BSpline) -> None:
    """Refuses a spline that misses samples or magnifies rounding; its last channel is through samples of size 1."""
    p = y.shape[1]
    motion = np.max(np.abs(y), axis=0)
    miss = np.abs(spline(t)[:, :p] - y)
    between = np.max(np.abs(spline((t[:-1] + t[1:]) / 2)), axis=0)
    magnified = float(between[p])
    misses = np.any(miss > MISS_TOLERANCE * motion) or np.any(between[:p] > LARGEST_EXCURSION * motion)
    if misses or not np.finfo(float).eps * magnified <= MISS_TOLERANCE:
        spacing = np.diff(t)
        raise TrajectoryError(
            f"through these samples there is no trustworthy spline of degree {spline.k}: between them it leaves their range far "
            f"behind, or magnifies rounding {magnified:.1e} times; the largest spacing is "
            f"{spacing.max() / spacing.min():.1e} times the smallest; lower the degree, or the smoothness at "
            "the ends where the samples do not rest there, or even out the times"
        )
