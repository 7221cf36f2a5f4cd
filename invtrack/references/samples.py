"""References through samples: interpolating splines that start and end at rest."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import scipy  # loads scipy.interpolate at its first use
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers
from invtrack.errors import FileError, TrajectoryError
from invtrack.files import read_table
from invtrack.references.profiles import piecewise_polynomial
from invtrack.references.signal import PiecewiseSignal

DEGREES = (1, 3, 5, 7)

MISS_TOLERANCE = 1e-9
"""How far the spline may miss a sample, as a share of its channel's motion: it does where samples lie very unevenly."""

LARGEST_EXCURSION = 100.0
"""How far it may go between samples, as a multiple of that motion; between evenly spaced ones it is a small multiple."""


def sampled_reference(times: ArrayLike, values: ArrayLike, *, degree: int = 5, smoothness: int | None = None) -> PiecewiseSignal:
    """The spline of odd degree k through samples, held at the first and the last value before and after.

    times (m,) [s], increasing, evenly spaced or not; values (m, p), or (m,) for one channel. Derivatives 1 ... k - 1 are continuous
    between the ends. smoothness: how many derivatives vanish at both ends, from 0 to (k - 1)/2, the default; choose less where the
    samples do not begin and end at rest, then y^(i) = 0 there for i = (k + 1)/2 ... k - 1 - smoothness instead. Of all functions
    through the samples that rest in this sense at the ends, it has the smallest integral of (y^((k+1)/2))^2.

    A plant of relative degree r needs smoothness >= r - 1, so degree >= 2 r - 1. The distance to a smooth motion that rests in the
    same sense falls with the (k + 1)th power of the spacing; that of its r-th derivative with the (k + 1 - r)th.

    Differentiation amplifies noise: noise of size s in samples h apart gives about s / h^r in the r-th derivative, and samples good
    to rounding have s = 1e-16 of their size. See `reference_report`.

    Raises TrajectoryError where shapes do not fit, times do not increase, values are not finite, degree or smoothness is out of
    range, samples are too few, or they lie too unevenly. Source: C. de Boor, A Practical Guide to Splines, 2001, ch. XIII.
    """
    t, y = _samples(times, values)
    _require_increasing(t, lambda i: f"sample {i}")
    smoothness = _require_possible(len(t), degree, smoothness)
    # One time scale for all pieces keeps one generator; a power of two, so that no knot is rounded.
    scale = 2.0 ** float(np.rint(np.log2(np.median(np.diff(t)))))
    offset = y[0]  # the spline is that of the motion, so that a large constant part costs no accuracy
    spline = _interpolant(t / scale, y - offset, degree, smoothness)
    anchors = np.zeros((len(t) + 1, y.shape[1] * (degree + 1)))
    taylor = anchors[1:-1].reshape(len(t) - 1, y.shape[1], degree + 1)
    taylor[:, :, 0] = y[:-1]
    for order in range(1, degree + 1):
        # Derivative after derivative from the coefficients' differences: its two neighbours at a knot see the same ones, so that
        # also derivatives full of noise are continuous to rounding of their own size.
        spline = spline.derivative()
        taylor[:, :, order] = spline(t[:-1] / scale) / math.factorial(order)
    anchors[0, : y.shape[1]], anchors[-1, : y.shape[1]] = y[0], y[-1]
    template = piecewise_polynomial(t[[0, -1]], [np.zeros((y.shape[1], degree + 1))], time_scale=scale)
    kind = np.full(len(t) + 1, template.kind[1], dtype=np.intp)
    kind[[0, -1]] = template.kind[0]
    return PiecewiseSignal(t, template.generators, kind, anchors)


def load_reference(
    path: str | Path,
    *,
    time: str = "time",
    channels: Sequence[str] | None = None,
    degree: int = 5,
    smoothness: int | None = None,
) -> PiecewiseSignal:
    """`sampled_reference` of the columns of a CSV file with a header row; lines that begin with # are skipped.

    A column is named by its whole header text or by what stands there before its unit: "tip" finds "tip [m]".

    Args:
        path: the file.
        time: the column of times [s].
        channels: the columns of values, in the order of the plant's outputs; None: all others.
        degree, smoothness: as for `sampled_reference`.

    Raises FileError as `sampled_reference` does, and, naming file and line, where a row has another number of cells than the
    header, a cell is not a finite number, times do not increase or are not in seconds, or a column is not there.
    """

    def choose(header: Sequence[str]) -> list[int]:
        first = _column(path, header, time)
        if _name_and_unit(header[first])[1] not in ("", "s"):
            raise FileError(f"{path}: expected times in seconds, got the column {header[first]!r}; convert it to [s]")
        others = [i for i in range(len(header)) if i != first]
        return [first, *(others if channels is None else [_column(path, header, name) for name in channels])]

    table = read_table(path, choose)
    if len(table.columns) < 2:
        raise FileError(f"{path}: expected at least one column of values beside {time!r}, got none")
    t, values = table.values[:, 0], table.values[:, 1:]
    try:
        _require_increasing(t, lambda i: f"line {table.lines[i]}")
        return sampled_reference(t, values, degree=degree, smoothness=smoothness)
    except TrajectoryError as error:
        raise FileError(f"{path}: {error}") from error


def _samples(times: ArrayLike, values: ArrayLike) -> tuple[Array, Array]:
    """times (m,) and values (m, p), finite."""
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


def _require_increasing(t: Array, place: Callable[[int], str]) -> None:
    bad = np.flatnonzero(np.diff(t) <= 0)
    if bad.size:
        i = int(bad[0]) + 1
        raise TrajectoryError(
            f"{place(i)}: expected times that increase, got {t[i]:.17g} s after {t[i - 1]:.17g} s; sort the samples by "
            "time and drop repeated ones"
        )


def _require_possible(count: int, degree: int, smoothness: int | None) -> int:
    """The smoothness at the ends, once it and the number of samples are known to determine one spline."""
    if degree not in DEGREES:
        raise TrajectoryError(f"degree must be one of {list(DEGREES)}, got {degree}")
    half = (degree - 1) // 2
    smoothness = half if smoothness is None else smoothness
    if smoothness not in range(half + 1):
        raise TrajectoryError(f"smoothness must be a whole number from 0 to {half} for degree {degree}, got {smoothness}")
    needed = max(2, half + 1 - 2 * smoothness)  # else a polynomial of degree `half` fits in between without any cost
    if count < needed:
        raise TrajectoryError(
            f"expected at least {needed} samples for a spline of degree {degree} with smoothness {smoothness}, got {count}; "
            "lower the degree or give more samples"
        )
    return smoothness


def _interpolant(t: Array, y: Array, degree: int, smoothness: int) -> scipy.interpolate.BSpline:
    half = (degree - 1) // 2
    orders = [*range(1, smoothness + 1), *range(half + 1, degree - smoothness)]
    conditions = [(order, np.zeros(y.shape[1])) for order in orders]
    try:
        ends = (conditions, list(conditions)) if conditions else None
        spline = scipy.interpolate.make_interp_spline(t, y, k=degree, bc_type=ends)
    except np.linalg.LinAlgError:
        well_posed = False
    else:
        # At rest means that the outermost coefficients are equal: made so to the last bit, not to rounding.
        spline.c[: smoothness + 1], spline.c[len(spline.c) - smoothness - 1 :] = y[0], y[-1]
        motion = np.max(np.abs(y), axis=0)
        excursion = np.abs(spline((t[:-1] + t[1:]) / 2))
        well_posed = bool(
            np.all(np.abs(spline(t) - y) <= MISS_TOLERANCE * motion) and np.all(excursion <= LARGEST_EXCURSION * motion)
        )
    if not well_posed:
        spacing = np.diff(t)
        raise TrajectoryError(
            f"the samples lie too unevenly for a spline of degree {degree}: it misses them, or leaves their range far behind "
            f"between them; the largest spacing is {spacing.max() / spacing.min():.1e} times the smallest; lower the degree or "
            "even out the times"
        )
    return spline


def _column(path: str | Path, header: Sequence[str], wanted: str) -> int:
    """Number of the column with this header text, or with this text before its unit."""
    matches = [i for i, text in enumerate(header) if text == wanted]
    matches = matches or [i for i, text in enumerate(header) if _name_and_unit(text)[0] == wanted]
    if len(matches) != 1:
        found = f"{len(matches)} columns" if matches else "no column"
        raise FileError(f"{path} has {found} named {wanted!r}; its columns are: {', '.join(header)}")
    return matches[0]


def _name_and_unit(text: str) -> tuple[str, str]:
    """("tip", "m") from "tip [m]"; the unit is empty where none is given."""
    name, bracket, unit = text.rpartition("[")
    return (name.strip(), unit[:-1].strip()) if bracket and unit.endswith("]") else (text, "")
