"""Piecewise autonomous linear signals: the one representation of references."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.arguments import instance, items
from invtrack.arrays import Array, Indices, finite_number, increasing_times, real_numbers, whole_number
from invtrack.errors import TrajectoryError
from invtrack.references.generator import Generator, constant_generator

JUMP_TOLERANCE = 1e-9
"""A derivative counts as continuous where it jumps by less than this share of its largest value next to any breakpoint."""


HIGHEST_DERIVATIVE = 1000
"""No derivative of higher order is worked out: long before, most leave the range of floating-point numbers."""

GOLDEN = (5**0.5 - 1) / 2

SIZE_SHARES = (GOLDEN / 2 - 0.5, 0.0, GOLDEN - 0.5)
"""Where in each piece a derivative's size is looked for beside its ends, as shares of its length from its middle.

In the middle, where symmetric profiles have their peaks, and at shares of the golden ratio: a swing that passes through zero at the
ends and in the middle, after whole periods, does not do so there.
"""

SIZES_TOGETHER = 4
"""Sizes of so many derivatives, the value counted, are found at once, as all of them are asked for one after the other."""


@dataclass(frozen=True, eq=False, repr=False)
class PiecewiseSignal:
    """A signal of p channels that on each piece solves w' = S w, value = R w, so any derivative is R S^k w, exactly.

    Polynomials (nilpotent S), sinusoids, exponentials and their sums are all of this form. At a breakpoint the value from the left
    and from the right may differ: a time that lies on one belongs to the piece on its right unless `inside` says otherwise.
    Signals add up with `+` and `-`, also with numbers (one, or one for each channel), and are `scaled` with `*` and `/`.

    Args:
        breakpoints: t_0 < ... < t_m [s]. There are m + 2 pieces: piece 0 before t_0, piece j from t_(j-1) to t_j, piece m + 1 after
            t_m.
        generators: the distinct (S, R) that occur.
        kind: which generator each piece uses (m + 2,).
        anchors: w at the start of each piece, of piece 0 at its end (m + 2, q), padded with zeros to the largest q.

    Raises TrajectoryError where these do not fit each other, or are not finite.
    """

    breakpoints: Array
    generators: tuple[Generator, ...]
    kind: Indices
    anchors: Array

    def __post_init__(self) -> None:
        times = increasing_times("breakpoints", self.breakpoints)
        generators = tuple(items("generators", self.generators, expected="a list of Generator(S, R)", error=TrajectoryError))
        if not len(times):
            raise TrajectoryError("a signal needs breakpoints, at least one, got none")
        if not generators or not all(isinstance(g, Generator) and len(g.R) == len(generators[0].R) for g in generators):
            raise TrajectoryError("expected generators Generator(S, R) with the same number of channels, at least one")
        kind, anchors = real_numbers("kind", self.kind), real_numbers("the anchors of a signal", self.anchors)
        pieces = len(times) + 1
        if kind.shape != (pieces,) or anchors.ndim != 2 or len(anchors) != pieces:
            raise TrajectoryError(
                f"expected {pieces} pieces, got {len(np.atleast_1d(kind))} kinds and {len(np.atleast_1d(anchors))} anchors"
            )
        if not np.all(np.isin(kind, np.arange(len(generators)))) or anchors.shape[1] < max(len(g.S) for g in generators):
            raise TrajectoryError(
                f"expected kinds from 0 to {len(generators) - 1}, and anchors (m + 2, q) with q of the largest generator, "
                f"{max(len(g.S) for g in generators)}; got anchors {anchors.shape}"
            )
        if not np.all(np.isfinite(anchors)):
            raise TrajectoryError("the signal has values that are not finite")
        for index, generator in enumerate(generators):
            longest = float(np.max(np.diff(times)[kind[1:-1] == index], initial=0.0))
            if longest > generator.horizon:
                raise TrajectoryError(
                    f"a piece of {longest:.3g} s is too long: rounding of such times hides what it does beyond "
                    f"{generator.horizon:.3g} s; cut it into shorter ones"
                )
        for name, value in (
            ("breakpoints", times),
            ("generators", generators),
            ("kind", kind.astype(np.intp)),
            ("anchors", anchors),
        ):
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        first, last = self.manoeuvre
        return f"<signal of {self.n_channels} channel(s), {len(self.breakpoints) - 1} piece(s) from {first:.6g} s to {last:.6g} s>"

    @property
    def n_channels(self) -> int:
        """Number of channels p."""
        return len(self.generators[0].R)

    @property
    def manoeuvre(self) -> tuple[float, float]:
        """First and last breakpoint [s]: before and after, the signal holds still if it is a rest-to-rest motion."""
        return float(self.breakpoints[0]), float(self.breakpoints[-1])

    def locate(self, t: ArrayLike) -> Indices:
        """Index of the piece that holds each time; a breakpoint belongs to the piece on its right."""
        times = real_numbers("times [s]", t)
        if np.any(np.isnan(times)):
            raise TrajectoryError("times [s] must be numbers, got NaN among them")
        return np.searchsorted(self.breakpoints, times, side="right")

    def __call__(self, t: ArrayLike, *, derivative: int = 0, inside: ArrayLike | None = None) -> Array:
        """Values, or derivatives of the stated order, at times t (m,) or scalar: (m, p) or (p,).

        inside: times within the pieces meant, where t lies on a breakpoint and the side matters (for instance the middle of the
        interval to its left). Raises TrajectoryError for times that are not finite, a derivative that is no whole number, and where
        the signal is beyond the range of floating-point numbers.
        """
        times, within = finite_times(t, inside)
        order = whole_number("derivative", derivative, highest=HIGHEST_DERIVATIVE)
        rows = [generator.derivative(order) for generator in self.generators]
        with np.errstate(over="ignore", invalid="ignore"):
            result = self._values(rows, self.locate(within), times)
        if not np.all(np.isfinite(result)):
            at = times[~np.all(np.isfinite(result), axis=1)][0]
            raise TrajectoryError(
                f"the signal is beyond the range of floating-point numbers at t = {at:.6g} s; ask for times closer by"
            )
        return result[0] if np.ndim(t) == 0 else result

    def _values(self, rows: Sequence[Array], piece: Indices, times: Array) -> Array:
        """rows[kind] w(t) at times taken in the pieces stated, (m, k)."""
        result = np.empty((len(times), len(rows[0])))
        since = times - self.breakpoints[np.maximum(piece - 1, 0)]
        before = piece == 0
        for index, (generator, X) in enumerate(zip(self.generators, rows, strict=True)):
            ours = self.kind[piece] == index
            w = self.anchors[:, : len(generator.S)]
            for mask, direction in ((ours & ~before, 1.0), (ours & before, -1.0)):
                chosen = selection(mask)
                if chosen is None:
                    continue
                tau = np.maximum(direction * since[chosen], 0.0)
                if np.max(tau) > generator.horizon:
                    raise TrajectoryError(
                        f"the time {times[chosen][np.argmax(tau)]:.6g} s is {np.max(tau):.3g} s away from the signal's breakpoint: "
                        f"rounding of such times hides what it does beyond {generator.horizon:.3g} s; ask for times closer by"
                    )
                resolution = 4 * float(np.spacing(np.max(np.abs(times[chosen]))))
                result[chosen] = generator.propagator(direction).outputs(X, w, piece[chosen], tau, resolution=resolution)
        return result

    def sides(self, order: int) -> tuple[Array, Array]:
        """The derivative of the stated order at each breakpoint, from the left and from the right: (m + 1, p) each."""
        return self._from_states(self.end_anchors[:-1], self.kind[:-1], order), self._from_states(
            self.anchors[1:], self.kind[1:], order
        )

    def _from_states(self, w: Array, kind: Indices, order: int) -> Array:
        """R S^order w for generators' states w (m, q) of these kinds (m,): (m, p)."""
        result = np.empty((len(w), self.n_channels))
        with np.errstate(over="ignore", invalid="ignore"):
            for index, generator in enumerate(self.generators):
                chosen = selection(kind == index)
                if chosen is not None:
                    result[chosen] = w[chosen, : len(generator.S)] @ generator.derivative(order).T
        if not np.all(np.isfinite(result)):
            raise TrajectoryError(
                f"the derivative of order {order} of this signal is beyond the range of floating-point numbers; ask for a lower "
                "one, or stretch the motion"
            )
        return result

    def jumps(self, order: int) -> Array:
        """Jump of the derivative of the stated order at each breakpoint, as a share of that derivative's size: (m + 1, p)."""
        size, (left, right) = self.size(order), self.sides(order)
        return np.abs(right - left) / np.where(size > 0, size, 1.0)

    def size(self, order: int) -> Array:
        """Largest value of a derivative (p,) over ends of pieces and points within, or what rounding of lower ones leaves."""
        known = self._sizes
        order = whole_number("order", order, highest=HIGHEST_DERIVATIVE)
        if len(known) <= order:
            try:
                found = self._largest(range(len(known), max(order + 1, SIZES_TOGETHER)))
            except TrajectoryError:  # beyond the range of numbers, of a higher order than is asked for, perhaps
                found = self._largest(range(len(known), order + 1))
            for size in found:
                lower = known[-1] if known else np.zeros(self.n_channels)
                with np.errstate(over="ignore"):  # of a signal with a single breakpoint
                    left = 1e-3 * lower / max(self.manoeuvre[1] - self.manoeuvre[0], np.finfo(float).tiny)
                known.append(np.maximum(size, left))
        return known[order]

    def _largest(self, orders: range) -> Array:
        """Largest values of derivatives (k, p) over ends of pieces and points within; raises as a call does."""
        found = np.array([np.max(np.abs(self.sides(order)), axis=(0, 1)) for order in orders])
        inner, spread = self.inner_times()[1:-1], np.diff(self.breakpoints)
        if len(inner) == 0:
            return found
        rows = [np.vstack([generator.derivative(order) for order in orders]) for generator in self.generators]
        for share in SIZE_SHARES:
            with np.errstate(over="ignore", invalid="ignore"):
                values = np.abs(self._values(rows, np.arange(1, len(inner) + 1), inner + share * spread))
            if not np.all(np.isfinite(values)):
                raise TrajectoryError(
                    f"the signal, or a derivative up to order {orders[-1]}, is beyond the range of floating-point numbers "
                    "between its breakpoints; stretch the motion"
                )
            found = np.maximum(found, np.max(values, axis=0).reshape(found.shape))
        return found

    @cached_property
    def _sizes(self) -> list[Array]:
        """Sizes of the derivatives found so far, from order 0 on."""
        return []

    def smoothness(self, channel: int, highest: int) -> int:
        """How many derivatives of a channel, the value itself counted as one, are continuous; at most `highest` are tried."""
        channel = whole_number("channel", channel, highest=self.n_channels - 1)
        highest = whole_number("highest", highest)
        states = max(len(generator.S) for generator in self.generators)
        for order in range(min(highest, 2 * states)):  # two systems that agree so long agree for ever (Cayley, Hamilton)
            if np.any(self.jumps(order)[:, channel] > JUMP_TOLERANCE):
                return order
        return highest

    def inner_times(self) -> Array:
        """One time inside each piece: (m + 2,)."""
        return _inner_times(self.breakpoints)

    @cached_property
    def end_anchors(self) -> Array:
        """The generators' states w at each piece's end, of the last one, which has none, at its start; not to be written to."""
        result = self.anchors.copy()
        lengths = np.concatenate([[0.0], np.diff(self.breakpoints), [0.0]])
        for index, generator in enumerate(self.generators):
            chosen, q = self.kind == index, len(generator.S)
            result[chosen, :q] = generator.propagator(1.0).states(self.anchors[chosen, :q], lengths[chosen])
        result.setflags(write=False)
        return result

    def shifted(self, delay: float) -> PiecewiseSignal:
        """The same signal `delay` seconds later; as smooth as this one, although breakpoints are rounded anew.

        Raises TrajectoryError for a delay that is not finite, or so long that breakpoints fall together.
        """
        delay = finite_number("delay", delay, unit="s")
        with np.errstate(over="ignore", invalid="ignore"):
            times = self.breakpoints + delay
        if not np.all(np.isfinite(times)) or np.any(times[1:] <= times[:-1]):
            raise TrajectoryError(
                f"{delay:.6g} s later this signal's breakpoints, {np.min(np.diff(self.breakpoints), initial=np.inf):.3g} s apart, "
                "fall together or leave the range of floating-point numbers; choose a shorter delay"
            )
        # What was rounded, found exactly (Knuth's TwoSum), is how much later than at the anchor each piece now starts.
        moved = times - self.breakpoints
        late = -((self.breakpoints - (times - moved)) + (delay - moved))
        late = np.concatenate([late[:1], late])
        anchors = self.anchors.copy()
        for index, generator in enumerate(self.generators):
            chosen, q = self.kind == index, len(generator.S)
            w, tau = anchors[chosen, :q], late[chosen, np.newaxis]
            anchors[chosen, :q] = w + tau * (w + tau / 2 * (w @ generator.S.T)) @ generator.S.T
        return PiecewiseSignal(times, self.generators, self.kind, anchors)

    def scaled(self, gain: ArrayLike) -> PiecewiseSignal:
        """The signal times a number, each channel times its own (p,), or a matrix (k, p) times the signal.

        Raises TrajectoryError for anything else, and for products beyond the range of floating-point numbers.
        """
        factor = real_numbers("the gain of a signal", gain)
        fits = factor.ndim == 0 or (factor.ndim <= 2 and factor.size and factor.shape[-1] == self.n_channels)
        if not fits or not np.all(np.isfinite(factor)):
            raise TrajectoryError(
                f"expected finite numbers to multiply the signal with: one, one for each of its {self.n_channels} channels, or a "
                f"matrix (k, {self.n_channels}); got {factor.tolist()}"
            )
        matrix = factor if factor.ndim == 2 else factor * np.eye(self.n_channels)
        with np.errstate(over="ignore", invalid="ignore"):  # refused by the generator
            generators = tuple(Generator(g.S, matrix @ g.R) for g in self.generators)
        return PiecewiseSignal(self.breakpoints, generators, self.kind, self.anchors)

    def refined(self, times: ArrayLike) -> PiecewiseSignal:
        """The same signal with further breakpoints, at those of `times` (k,) [s] that are not yet among them."""
        extra = np.setdiff1d(finite_times(times, None)[0], self.breakpoints)
        if extra.size == 0:
            return self
        breakpoints = np.sort(np.concatenate([self.breakpoints, extra]))
        owner = self.locate(_inner_times(breakpoints))
        anchor_times = np.concatenate([breakpoints[:1], breakpoints])
        anchors = np.zeros((len(owner), self.anchors.shape[1]))
        for index, generator in enumerate(self.generators):
            chosen = self.kind[owner] == index
            rows = [np.eye(len(generator.S))] * len(self.generators)
            with np.errstate(over="ignore", invalid="ignore"):  # refused by the signal
                anchors[chosen, : len(generator.S)] = self._values(rows, owner[chosen], anchor_times[chosen])
        unmoved = np.isin(anchor_times, self.breakpoints)  # keep these to the last bit
        unmoved[0] = breakpoints[0] == self.breakpoints[0]
        anchors[unmoved] = self.anchors[owner[unmoved]]
        return PiecewiseSignal(breakpoints, self.generators, self.kind[owner], anchors)

    __array_ufunc__ = None  # so that numpy leaves `np.float64(2.0) * signal` to the signal

    def __mul__(self, gain: ArrayLike) -> PiecewiseSignal:
        """The signal `scaled`."""
        return self.scaled(gain)

    __rmul__ = __mul__

    def __truediv__(self, divisor: ArrayLike) -> PiecewiseSignal:
        """The signal divided by a number, or each channel by its own (p,). Raises TrajectoryError for 0 and anything else."""
        numbers = real_numbers("the divisor of a signal", divisor)
        with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
            gain = 1 / numbers
        if numbers.ndim > 1 or not np.all(np.isfinite(numbers)) or not np.all(np.isfinite(gain)):
            raise TrajectoryError(
                f"expected finite numbers other than zero to divide the signal by: one, or one for each of its {self.n_channels} "
                f"channels; got {numbers.tolist()}"
            )
        return self.scaled(gain)

    def __neg__(self) -> PiecewiseSignal:
        """The signal with the other sign."""
        return self.scaled(-1.0)

    def __add__(self, other: PiecewiseSignal | ArrayLike) -> PiecewiseSignal:
        """Sum of two signals with the same number of channels, or of a signal and constants: one, or one for each channel (p,).

        Raises TrajectoryError for anything else.
        """
        if not isinstance(other, PiecewiseSignal):
            offset = real_numbers("what is added to a signal", other)
            if offset.shape not in ((), (self.n_channels,)) or not np.all(np.isfinite(offset)):
                raise TrajectoryError(
                    f"expected a signal to add, or finite constants: one, or one for each of the {self.n_channels} channels; got "
                    f"{offset.tolist()}"
                )
            if not np.any(offset):
                return self
            other = constant_signal(np.broadcast_to(offset, self.n_channels), self.manoeuvre[0])
        if self.n_channels != other.n_channels:
            raise TrajectoryError(f"cannot add signals of {self.n_channels} and {other.n_channels} channels")
        return _side_by_side(self, other, lambda *rows: np.hstack(rows))

    __radd__ = __add__

    def __sub__(self, other: PiecewiseSignal | ArrayLike) -> PiecewiseSignal:
        """Difference of two signals, or of a signal and constants; see `+`."""
        return self + (-other if isinstance(other, PiecewiseSignal) else -real_numbers("what is subtracted from a signal", other))

    def __rsub__(self, other: ArrayLike) -> PiecewiseSignal:
        """Constants minus the signal."""
        return -self + other


def constant_signal(values: Array, at: float) -> PiecewiseSignal:
    """Constant values (p,), with one breakpoint [s]."""
    return PiecewiseSignal(
        np.array([at]), (constant_generator(len(values)),), np.zeros(2, dtype=np.intp), np.array([values, values])
    )


def finite_times(t: ArrayLike, inside: ArrayLike | None) -> tuple[Array, Array]:
    """Times (m,) [s], and as many within the pieces meant, by default the same. Raises TrajectoryError unless all are finite."""
    times = np.atleast_1d(real_numbers("times [s]", t))
    within = times if inside is None else np.atleast_1d(real_numbers("times inside pieces [s]", inside))
    if within.shape not in ((1,), times.shape):
        raise TrajectoryError(f"expected one time inside its piece for each of {times.shape} times, got {within.shape}")
    if times.ndim != 1 or not (np.all(np.isfinite(times)) and np.all(np.isfinite(within))):
        raise TrajectoryError(f"expected finite times (m,) [s], got {np.asarray(t).tolist()!r}")
    return times, np.broadcast_to(within, times.shape)


def require_signal(name: str, value: object) -> PiecewiseSignal:
    """The signal itself. Raises TrajectoryError for what is none."""
    return instance(
        name, value, PiecewiseSignal, expected="a signal, such as rest_to_rest(...) or constant(...)", error=TrajectoryError
    )


def channel_values(name: str, value: ArrayLike) -> Array:
    """One finite value for each channel (p,); a number stands for one channel. Raises TrajectoryError for anything else."""
    values = np.atleast_1d(real_numbers(name, value))
    if values.ndim != 1 or not len(values) or not np.all(np.isfinite(values)):
        raise TrajectoryError(f"{name} must be one finite value, or one for each channel (p,), got {values.tolist()}")
    return values


def _inner_times(edges: Array) -> Array:
    """One time inside each piece between, before and after the edges (m + 1,), also where these are neighbouring numbers."""
    with np.errstate(over="ignore"):
        middle = edges[:-1] + np.diff(edges) / 2
    middle = np.where(middle < edges[1:], middle, edges[:-1])
    return np.concatenate([[min(edges[0] - 1.0, np.nextafter(edges[0], -np.inf))], middle, [edges[-1] + 1.0]])


def selection(mask: NDArray[np.bool_]) -> slice | Indices | None:
    """Which entries a mask chooses: a slice where they are neighbours, which costs no copies; None where it chooses none."""
    chosen = mask.nonzero()[0]
    if chosen.size == 0:
        return None
    first, last = int(chosen[0]), int(chosen[-1])
    return slice(first, last + 1) if last - first + 1 == chosen.size else chosen


def stack(signals: Sequence[PiecewiseSignal]) -> PiecewiseSignal:
    """One signal whose channels are those of all `signals`, in their order: a reference for a plant with several outputs.

    Raises TrajectoryError for none, and for what is no signal.
    """
    expected = "a list of signals to stack, such as [rest_to_rest(...), constant(0.0)]"
    listed = items("signals", signals, expected=expected, error=TrajectoryError)
    if not listed:
        raise TrajectoryError("signals must be a list of signals to stack, at least one, got none")
    for i, signal in enumerate(listed):
        require_signal(f"signal {i} of those to stack", signal)
    result: PiecewiseSignal = listed[0]
    for signal in listed[1:]:
        result = _side_by_side(result, signal, scipy.linalg.block_diag)
    return result


def _side_by_side(first: PiecewiseSignal, second: PiecewiseSignal, join_rows: Callable[..., Array]) -> PiecewiseSignal:
    """Both signals' generators run in parallel; `join_rows(R_1, R_2)` makes the rows of their values."""
    breakpoints = np.union1d(first.breakpoints, second.breakpoints)
    first, second = first.refined(breakpoints), second.refined(breakpoints)
    shape = (len(first.generators), len(second.generators))
    distinct, kind = np.unique(np.ravel_multi_index((first.kind, second.kind), shape), return_inverse=True)
    generators, anchors = [], np.zeros((len(kind), first.anchors.shape[1] + second.anchors.shape[1]))
    for i, j in zip(*np.unravel_index(distinct, shape), strict=True):
        a, b = first.generators[i], second.generators[j]
        generators.append(Generator(scipy.linalg.block_diag(a.S, b.S), join_rows(a.R, b.R)))
        chosen = (first.kind == i) & (second.kind == j)
        q_a, q_b = len(a.S), len(b.S)
        anchors[chosen, :q_a] = first.anchors[chosen, :q_a]
        anchors[chosen, q_a : q_a + q_b] = second.anchors[chosen, :q_b]
    return PiecewiseSignal(breakpoints, tuple(generators), kind, anchors)
