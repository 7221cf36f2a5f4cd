"""Reference motions by name: rest to rest, polynomials by pieces, an autonomous system switched on for a while."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, get_args

import numpy as np
from numpy.polynomial.polynomial import polyval
from numpy.typing import ArrayLike

from invtrack.arguments import items, one_of
from invtrack.arrays import Array, finite_number, increasing_times, real_matrix, real_numbers, require_duration, whole_number
from invtrack.errors import TrajectoryError
from invtrack.references.bernstein import bernstein_derivatives, graded_breakpoints, pieces_for
from invtrack.references.generator import Generator, constant_generator
from invtrack.references.polynomials import from_bernstein, from_power, polynomial_signal, power_of_two_below
from invtrack.references.signal import PiecewiseSignal, channel_values, constant_signal

LARGEST_SMOOTHNESS = 100
"""Beyond it the highest derivatives of a rest-to-rest motion approach the end of the range of floating-point numbers."""

Basis = Literal["power", "bernstein"]


def rest_to_rest(
    start: ArrayLike, end: ArrayLike, duration: float, *, smoothness: int = 2, start_time: float = 0.0
) -> PiecewiseSignal:
    """The polynomial of lowest degree from `start` to `end` whose first `smoothness` derivatives vanish at both ends.

    The unit step of smoothness k has the slope (s (1 - s))^k (2 k + 1)! / k!^2, so its Bernstein coefficients are k + 1 zeros and
    k + 1 ones. From smoothness 3 on it is cut into about k / 2 pieces, so that each derivative is good to 1e-12 of its peak.

    Args:
        start, end: values (p,) or scalar, held before and after.
        duration: how long the motion takes [s].
        smoothness: the degree is 2 smoothness + 1: 1 gives the cubic, 2 the quintic of minimum jerk, 3 degree seven. The inverse of
            a plant of relative degree r needs smoothness >= r - 1, and has a continuous input from r on.
        start_time: when the motion begins [s].

    Raises TrajectoryError for values that are not finite or of different shapes, a duration that is not positive, or a smoothness
    that is no whole number from 0 to 100. Source: G. Farin, Curves and Surfaces for CAGD, 2002, ch. 5.
    """
    y_0, y_f = channel_values("start", start), channel_values("end", end)
    if y_0.shape != y_f.shape:
        raise TrajectoryError(f"start and end must have the same channels, got shapes {y_0.shape} and {y_f.shape}")
    require_duration("duration", duration)
    duration, start_time = float(duration), finite_number("start_time", start_time, unit="s")
    k = whole_number("smoothness", smoothness, highest=LARGEST_SMOOTHNESS)
    pieces = pieces_for(k)  # not those for the degree: of the slope's k-th derivative, a polynomial of degree k
    edges = graded_breakpoints(start_time, start_time + duration, pieces)
    shortest = float(np.min(np.diff(edges)))
    unit = power_of_two_below(min(shortest / 2, (edges[-1] - edges[0]) / 4))
    step = bernstein_derivatives([0] * (k + 1) + [1] * (k + 1), edges, unit)
    with np.errstate(over="ignore"):  # refused by the generator
        rows = (y_f - y_0)[:, np.newaxis]
    return polynomial_signal(edges, np.full(pieces, unit), step[:, np.newaxis], (y_0, y_f), rows=rows, offset=y_0)


def piecewise_polynomial(
    breakpoints: ArrayLike,
    coefficients: Sequence[ArrayLike],
    *,
    basis: Basis = "power",
    time_scale: float = 1.0,
    held: tuple[ArrayLike, ArrayLike] | None = None,
) -> PiecewiseSignal:
    """Polynomials of any degree by pieces, held still before and after.

    On piece j, from t_j to t_(j+1), the value is, with coefficients c_0 ... c_d (p,),
    "power": sum over i of c_i ((t - t_j) / time_scale)^i;
    "bernstein": sum over i of c_i C(d, i) s^i (1 - s)^(d - i), s = (t - t_j) / (t_(j+1) - t_j): a Bezier curve.

    A power series is as good as the sizes of its terms let it be: beyond degree 10 or so they are often much larger than their sum.
    Bernstein coefficients are of the size of the values, whatever the degree; a piece of degree d >= 3 is cut into about d / 2.

    Args:
        breakpoints: t_0 ... t_m (m + 1,) [s].
        coefficients: for each of the m pieces (p, d + 1), d its degree; a vector counts as one channel.
        basis: "power" or "bernstein".
        time_scale: of the power series [s].
        held: values before and after, (p,) or scalar; by default those at the two ends.

    Raises TrajectoryError where numbers do not fit or are not finite. Source: R. Farouki, "The Bernstein polynomial basis: a
    centennial retrospective", Computer Aided Geometric Design 29, 2012.
    """
    times = increasing_times("breakpoints", breakpoints)
    given = _coefficients(coefficients, len(times))
    require_duration("time_scale", time_scale)
    one_of("basis", basis, get_args(Basis), error=TrajectoryError)
    if basis == "bernstein":
        if time_scale != 1.0:
            raise TrajectoryError("Bernstein coefficients belong to each piece's own length; leave out time_scale")
        edges, units, derivatives = from_bernstein(times, given)
        ends = given[0][:, 0], given[-1][:, -1]
    else:
        edges, units, derivatives = times, *from_power(np.diff(times), given, float(time_scale))
        with np.errstate(over="ignore", invalid="ignore"):  # refused below
            ends = given[0][:, 0], np.asarray(polyval((times[-1] - times[-2]) / time_scale, given[-1].T))
    p = len(given[0])
    y_0, y_f = ends if held is None else _held(held, p)
    return polynomial_signal(edges, units, derivatives, (y_0, y_f), rows=np.eye(p), offset=np.zeros(p))


def autonomous(S: ArrayLike, R: ArrayLike, w_0: ArrayLike, *, start: float, end: float) -> PiecewiseSignal:
    """The output R w of w' = S w, w(start) = w_0, on [start, end]; held at its first value before and at its last value after.

    Covers sinusoids, exponentials and polynomials: the exosystems of Devasia, Paden, Rossi 1996, eq. 13.

    Args:
        S, R, w_0: (q, q), (p, q) and (q,).
        start, end: between which the output moves [s].

    Raises TrajectoryError where shapes do not fit or end is not after start.
    """
    S_, R_, w = real_matrix("S", S), real_matrix("R", R), channel_values("w_0", w_0)
    start, end = finite_number("start", start, unit="s"), finite_number("end", end, unit="s")
    q = len(w)
    if S_.shape != (q, q) or R_.shape[1] != q:
        raise TrajectoryError(f"w_0 has {q} entries, so S must be ({q}, {q}) and R (p, {q}); got {S_.shape} and {R_.shape}")
    if not end > start:
        raise TrajectoryError(f"end must be after start, got start {start} and end {end}")
    moving = Generator(S_, R_)
    running = PiecewiseSignal(np.array([start]), (moving,), np.zeros(2, dtype=np.intp), np.array([w, w]))
    p = len(R_)
    anchors = np.zeros((3, max(p, q)))
    anchors[0, :p], anchors[1, :q], anchors[2, :p] = running(start), w, running(end)
    kind = np.array([0, 1, 0], dtype=np.intp)
    return PiecewiseSignal(np.array([start, end]), (constant_generator(p), moving), kind, anchors)


def raised_cosine(peak: float, *, period: float = 2 * np.pi, cycles: int = 1, start_time: float = 0.0) -> PiecewiseSignal:
    """peak / 2 (1 - cos(2 pi (t - start_time) / period)) for whole cycles, zero before and after: to `peak` and back.

    peak: in the output's unit; period, start_time [s]. Its second derivative jumps at both ends. With a peak of 2 and a period of
    2 pi it is the reference of Devasia, Paden, Rossi 1996, section 5.

    Raises TrajectoryError for a period that is not positive, or cycles that are no whole number from 1 on.
    """
    peak, start_time = finite_number("peak", peak), finite_number("start_time", start_time, unit="s")
    require_duration("period", period)
    cycles, period = whole_number("cycles", cycles, lowest=1, highest=2**53), float(period)
    end = start_time + cycles * period
    if not start_time < end < np.inf:
        raise TrajectoryError(
            f"{cycles} period(s) of {period} s from {start_time} s on end beyond the range of times, or where they start"
        )
    omega = 2 * np.pi / period
    S = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, omega], [0.0, -omega, 0.0]])  # 1, cos, sin
    anchors = np.zeros((3, 3))  # held at zero exactly, not to rounding
    anchors[1, :2] = 1.0
    generators = (constant_generator(1), Generator(S, peak / 2 * np.array([[1.0, -1.0, 0.0]])))
    return PiecewiseSignal(np.array([start_time, end]), generators, np.array([0, 1, 0], dtype=np.intp), anchors)


def constant(value: ArrayLike, *, at: float = 0.0) -> PiecewiseSignal:
    """A signal that always has the same value (p,) or scalar; `at` [s] is where its (idle) breakpoint lies.

    Raises TrajectoryError for values of another shape or not finite.
    """
    return constant_signal(channel_values("value", value), finite_number("at", at, unit="s"))


def _coefficients(coefficients: Sequence[ArrayLike], count: int) -> list[Array]:
    """One matrix (p, degree + 1) of finite numbers for each piece between `count` breakpoints."""
    expected = "a list of one array (p, degree + 1) for each piece"
    listed = items("coefficients", coefficients, expected=expected, error=TrajectoryError)
    given = [np.atleast_2d(real_numbers(f"the coefficients of piece {j}", c)) for j, c in enumerate(listed)]
    if len(given) != count - 1 or not given:
        raise TrajectoryError(f"expected one polynomial between each two of {count} breakpoints, got {len(given)}")
    for j, c in enumerate(given):
        if c.ndim != 2 or not c.size or not np.all(np.isfinite(c)):
            raise TrajectoryError(
                f"expected finite coefficients (p, degree + 1) for piece {j}, or a vector for one channel, got {c.tolist()}"
            )
    if any(len(c) != len(given[0]) for c in given):
        raise TrajectoryError(f"all pieces must have the same number of channels, got {[len(c) for c in given]}")
    return given


def _held(held: tuple[ArrayLike, ArrayLike], p: int) -> tuple[Array, Array]:
    pair = items("held", held, expected="a pair of the values before and after", error=TrajectoryError)
    if len(pair) != 2:
        raise TrajectoryError(f"held must be the values before and after, two of them, got {len(pair)}")
    values = [channel_values(f"held {place} the motion", value) for place, value in zip(("before", "after"), pair, strict=True)]
    for value in values:
        if value.shape not in ((1,), (p,)):
            raise TrajectoryError(f"held must give {p} value(s) before and after, got shape {value.shape}")
    return np.broadcast_to(values[0], p), np.broadcast_to(values[1], p)
