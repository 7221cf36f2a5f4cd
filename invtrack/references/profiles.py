"""Reference motions by name: rest to rest, polynomials by pieces, an autonomous system switched on for a while."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from numpy.polynomial import Polynomial
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers, require_duration
from invtrack.errors import TrajectoryError
from invtrack.references.signal import Generator, PiecewiseSignal, constant_generator


def rest_to_rest(
    start: ArrayLike, end: ArrayLike, duration: float, *, smoothness: int = 2, start_time: float = 0.0
) -> PiecewiseSignal:
    """The polynomial of lowest degree from `start` to `end` whose first `smoothness` derivatives vanish at both ends.

    Args:
        start, end: values (p,) or scalar, held before and after.
        duration: how long the motion takes [s].
        smoothness: the degree is 2 smoothness + 1: 1 gives the cubic, 2 the quintic of minimum jerk, 3 degree seven. The inverse of
            a plant of relative degree r needs smoothness >= r - 1, and has a continuous input from r on.
        start_time: when the motion begins [s].

    Raises TrajectoryError for a duration that is not positive or a smoothness outside 0 ... 6.
    """
    y_0, y_f = np.atleast_1d(np.asarray(start, dtype=float)), np.atleast_1d(np.asarray(end, dtype=float))
    if y_0.shape != y_f.shape or y_0.ndim != 1:
        raise TrajectoryError(f"start and end must have the same channels, got shapes {y_0.shape} and {y_f.shape}")
    require_duration("duration", duration)
    if smoothness not in range(7):  # from 7 on, rounding of the coefficients shows as jumps at the end
        raise TrajectoryError(f"smoothness must be a whole number from 0 to 6 (degree 1 to 13), got {smoothness}")
    # The slope of the unit step is (s (1 - s))^smoothness, up to a factor.
    slope = Polynomial([0.0, 1.0, -1.0]) ** smoothness
    step = slope.integ() / slope.integ()(1.0)
    coefficients = np.outer(y_f - y_0, step.coef)
    coefficients[:, 0] += y_0
    return piecewise_polynomial([start_time, start_time + duration], [coefficients], time_scale=duration, held=(y_0, y_f))


def piecewise_polynomial(
    breakpoints: ArrayLike,
    coefficients: Sequence[ArrayLike],
    *,
    time_scale: float = 1.0,
    held: tuple[ArrayLike, ArrayLike] | None = None,
) -> PiecewiseSignal:
    """Polynomials by pieces: on piece j the value is sum_i c_j[:, i] ((t - t_j) / time_scale)^i, held still before and after.

    breakpoints (m + 1,) [s]; coefficients: m arrays (p, degree_j + 1), ascending (a vector counts as one channel). held: values
    before and after; by default those at the two ends.

    Raises TrajectoryError where numbers do not fit.
    """
    times = np.asarray(breakpoints, dtype=float).reshape(-1)
    pieces = [np.atleast_2d(np.asarray(c, dtype=float)) for c in coefficients]
    if len(pieces) != len(times) - 1 or not pieces:
        raise TrajectoryError(f"expected one polynomial between each two of {len(times)} breakpoints, got {len(pieces)}")
    p, degree = pieces[0].shape[0], max(c.shape[1] for c in pieces) - 1
    require_duration("time_scale", time_scale)
    if any(c.shape[0] != p for c in pieces):
        raise TrajectoryError(f"all pieces must have the same number of channels, got {[c.shape[0] for c in pieces]}")
    # w_i = the value's i-th Taylor coefficient, in units of time_scale, so that all entries are of the size of the value.
    shift: Array = np.diag(np.arange(1.0, degree + 1), k=1) / time_scale
    first = np.zeros((1, degree + 1))
    first[0, 0] = 1.0
    taylor = Generator(scipy.linalg.block_diag(*[shift] * p), scipy.linalg.block_diag(*[first] * p))
    anchors = np.zeros((len(times) + 1, p * (degree + 1)))
    for j, c in enumerate(pieces):
        anchors[j + 1].reshape(p, degree + 1)[:, : c.shape[1]] = c
    last = ((times[-1] - times[-2]) / time_scale) ** np.arange(pieces[-1].shape[1])
    y_0, y_f = held if held is not None else (pieces[0][:, 0], pieces[-1] @ last)
    for place, value in ((0, np.asarray(y_0, dtype=float)), (-1, np.asarray(y_f, dtype=float))):
        if value.shape not in ((), (p,)):
            raise TrajectoryError(f"held must give {p} value(s) before and after, got shape {value.shape}")
        anchors[place, :p] = value
    kind = np.full(len(times) + 1, 1, dtype=np.intp)
    kind[[0, -1]] = 0
    return PiecewiseSignal(times, (constant_generator(p), taylor), kind, anchors)


def autonomous(S: ArrayLike, R: ArrayLike, w_0: ArrayLike, *, start: float, end: float) -> PiecewiseSignal:
    """The output R w of w' = S w, w(start) = w_0, on [start, end]; held at its first value before and at its last value after.

    Covers sinusoids, exponentials and polynomials: the exosystems of Devasia, Paden, Rossi 1996, eq. 13.

    Args:
        S, R, w_0: (q, q), (p, q) and (q,).
        start, end: between which the output moves [s].

    Raises TrajectoryError where shapes do not fit or end is not after start.
    """
    S_, R_ = np.atleast_2d(np.asarray(S, dtype=float)), np.atleast_2d(np.asarray(R, dtype=float))
    w = np.atleast_1d(np.asarray(w_0, dtype=float))
    q = len(w)
    if S_.shape != (q, q) or R_.shape[1] != q:
        raise TrajectoryError(f"w_0 has {q} entries, so S must be ({q}, {q}) and R (p, {q}); got {S_.shape} and {R_.shape}")
    if not end > start:
        raise TrajectoryError(f"end must be after start, got start {start} and end {end}")
    p = R_.shape[0]
    running = PiecewiseSignal(np.array([start]), (Generator(S_, R_),), np.zeros(2, dtype=np.intp), np.array([w, w]))
    anchors = np.zeros((3, max(p, q)))
    anchors[0, :p], anchors[1, :q], anchors[2, :p] = R_ @ w, w, running(end)
    kind = np.array([0, 1, 0], dtype=np.intp)
    return PiecewiseSignal(np.array([start, end], dtype=float), (constant_generator(p), Generator(S_, R_)), kind, anchors)


def raised_cosine(peak: float, *, period: float = 2 * np.pi, cycles: int = 1, start_time: float = 0.0) -> PiecewiseSignal:
    """peak / 2 (1 - cos(2 pi (t - start_time) / period)) for whole cycles, zero before and after: to `peak` and back.

    peak: in the output's unit; period, start_time [s]. Its second derivative jumps at both ends. With a peak of 2 and a period of
    2 pi it is the reference of Devasia, Paden, Rossi 1996, section 5.

    Raises TrajectoryError for a period that is not positive, or cycles that are no whole number from 1 on.
    """
    if not (period > 0 and cycles >= 1 and float(cycles).is_integer()):
        raise TrajectoryError(f"period must be positive and cycles a whole number from 1 on, got {period} and {cycles}")
    omega = 2 * np.pi / period
    S = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, omega], [0.0, -omega, 0.0]])  # 1, cos, sin
    end = start_time + cycles * period
    signal = autonomous(S, peak / 2 * np.array([[1.0, -1.0, 0.0]]), np.array([1.0, 1.0, 0.0]), start=start_time, end=end)
    anchors = signal.anchors.copy()
    anchors[2] = 0.0  # at rest exactly, not to rounding
    return PiecewiseSignal(signal.breakpoints, signal.generators, signal.kind, anchors)


def constant(value: ArrayLike, *, at: float = 0.0) -> PiecewiseSignal:
    """A signal that always has the same value (p,) or scalar; `at` [s] is where its (idle) breakpoint lies.

    Raises TrajectoryError for values of another shape.
    """
    values = np.atleast_1d(real_numbers("the value of a constant signal", value))
    if values.ndim != 1 or not len(values):
        raise TrajectoryError(f"expected one value, or one for each channel (p,), got {values.tolist()}")
    return PiecewiseSignal(
        np.array([at]), (constant_generator(len(values)),), np.zeros(2, dtype=np.intp), np.array([values, values])
    )
