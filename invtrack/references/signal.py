"""Piecewise autonomous linear signals: the one representation of references."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array, Indices, increasing_times, real_numbers
from invtrack.errors import TrajectoryError
from invtrack.linear.propagation import Propagator

JUMP_TOLERANCE = 1e-9
"""A derivative counts as continuous where it jumps by less than this share of its largest value next to any breakpoint."""


@dataclass(frozen=True, eq=False)
class Generator:
    """The autonomous system w' = S w, value = R w behind a piece of a signal: S (q, q), R (p, q)."""

    S: Array
    R: Array

    def derivative(self, order: int) -> Array:
        """R S^order (p, q): the row that gives the derivative of that order."""
        row: Array = self.R @ np.linalg.matrix_power(self.S, order)
        return row

    def propagator(self, direction: float) -> Propagator:
        """exp(S tau), or exp(-S tau) for a negative direction."""
        return self._propagators[0 if direction > 0 else 1]

    @cached_property
    def _propagators(self) -> tuple[Propagator, Propagator]:
        return Propagator(self.S), Propagator(-self.S)


def constant_generator(p: int) -> Generator:
    """Generator of constant values: w' = 0, value = w."""
    return Generator(np.zeros((p, p)), np.eye(p))


@dataclass(frozen=True, eq=False)
class PiecewiseSignal:
    """A signal of p channels that on each piece solves w' = S w, value = R w, so any derivative is R S^k w, exactly.

    breakpoints: t_0 < ... < t_m [s]. There are m + 2 pieces: piece 0 before t_0, piece j from t_(j-1) to t_j, piece m + 1 after
    t_m. generators: the distinct (S, R) that occur; kind (m + 2,): which generator each piece uses; anchors (m + 2, q): w at the
    start of each piece, of piece 0 at its end (padded with zeros to the largest q). Polynomials (nilpotent S), sinusoids,
    exponentials and their sums are all of this form. At a breakpoint the value from the left and from the right may differ: a
    time that lies on one belongs to the piece on its right unless `inside` says otherwise.
    """

    breakpoints: Array
    generators: tuple[Generator, ...]
    kind: Indices
    anchors: Array

    def __post_init__(self) -> None:
        pieces = len(self.breakpoints) + 1
        if not len(increasing_times("breakpoints", self.breakpoints)):
            raise TrajectoryError("a signal needs breakpoints, at least one, got none")
        if self.kind.shape != (pieces,) or len(self.anchors) != pieces:
            raise TrajectoryError(f"expected {pieces} pieces, got {len(self.kind)} kinds and {len(self.anchors)} anchors")
        if not np.all(np.isfinite(self.anchors)):
            raise TrajectoryError("the signal has values that are not finite")

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
        return np.searchsorted(self.breakpoints, np.asarray(t, dtype=float), side="right")

    def __call__(self, t: ArrayLike, *, derivative: int = 0, inside: ArrayLike | None = None) -> Array:
        """Values, or derivatives of the stated order, at times t (m,) or scalar: (m, p) or (p,).

        inside: times within the pieces meant, where t lies on a breakpoint and the side matters (for instance the middle of the
        interval to its left). Raises TrajectoryError for times that are not finite, or a derivative that is no whole number.
        """
        times, within = finite_times(t, inside)
        if not isinstance(derivative, (int, np.integer)) or derivative < 0:
            raise TrajectoryError(f"derivative must be a whole number from 0 on, got {derivative!r}")
        piece = self.locate(within)
        rows = [generator.derivative(derivative) for generator in self.generators]
        result = self._values(rows, piece, times)
        return result[0] if np.ndim(t) == 0 else result

    def _values(self, rows: list[Array], piece: Indices, times: Array) -> Array:
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
                resolution = 4 * float(np.spacing(np.max(np.abs(times[chosen]))))
                result[chosen] = generator.propagator(direction).outputs(X, w, piece[chosen], tau, resolution=resolution)
        return result

    def jumps(self, order: int) -> Array:
        """Jump of the derivative of the stated order at each breakpoint, as a share of that derivative's size: (m + 1, p)."""
        left = self(self.breakpoints, derivative=order, inside=self.inner_times()[:-1])
        right = self(self.breakpoints, derivative=order, inside=self.inner_times()[1:])
        size = self.size(order)
        return np.abs(right - left) / np.where(size > 0, size, 1.0)

    def size(self, order: int) -> Array:
        """Largest value of a derivative over points within the pieces (p,), or what rounding of the lower ones leaves."""
        known = self._sizes
        while len(known) <= order:
            times, spread = self.inner_times(), np.concatenate([[0.0], np.diff(self.breakpoints), [0.0]]) / 3
            size = np.zeros(self.n_channels)
            for share in (-1.0, 0.0, 1.0):
                values = self(times + share * spread, derivative=len(known), inside=times)
                size = np.maximum(size, np.max(np.abs(values), axis=0))
            lower = known[-1] if known else np.zeros(self.n_channels)
            known.append(np.maximum(size, 1e-3 * lower / max(self.manoeuvre[1] - self.manoeuvre[0], np.finfo(float).tiny)))
        return known[order]

    @cached_property
    def _sizes(self) -> list[Array]:
        """Sizes of the derivatives found so far, from order 0 on."""
        return []

    def smoothness(self, channel: int, highest: int) -> int:
        """How many derivatives of a channel, the value itself counted as one, are continuous; at most `highest` are tried."""
        for order in range(highest):
            if np.any(self.jumps(order)[:, channel] > JUMP_TOLERANCE):
                return order
        return highest

    def inner_times(self) -> Array:
        """One time inside each piece: (m + 2,)."""
        ends = self.breakpoints
        return np.concatenate([[ends[0] - 1.0], (ends[:-1] + ends[1:]) / 2, [ends[-1] + 1.0]])

    def end_anchors(self) -> Array:
        """The generators' states w at the end of each piece; for the last one, which has no end, at its start."""
        result = self.anchors.copy()
        lengths = np.concatenate([[0.0], np.diff(self.breakpoints), [0.0]])
        for index, generator in enumerate(self.generators):
            chosen, q = self.kind == index, len(generator.S)
            result[chosen, :q] = generator.propagator(1.0).states(self.anchors[chosen, :q], lengths[chosen])
        return result

    def shifted(self, delay: float) -> PiecewiseSignal:
        """The same signal `delay` seconds later."""
        return PiecewiseSignal(self.breakpoints + delay, self.generators, self.kind, self.anchors)

    def scaled(self, gain: ArrayLike) -> PiecewiseSignal:
        """The signal times a number, each channel times its own (p,), or a matrix (k, p) times the signal.

        Raises TrajectoryError for anything else.
        """
        gain = real_numbers("the gain of a signal", gain)
        if not np.all(np.isfinite(gain)) or gain.ndim > 2 or gain.shape[-1:] not in ((), (self.n_channels,)):
            raise TrajectoryError(
                f"expected finite numbers to multiply the signal with: one, one for each of its {self.n_channels} channels, or a "
                f"matrix (k, {self.n_channels}); got {gain.tolist()}"
            )
        matrix = np.asarray(gain, dtype=float) * np.eye(self.n_channels) if np.ndim(gain) < 2 else np.asarray(gain, dtype=float)
        generators = tuple(Generator(g.S, matrix @ g.R) for g in self.generators)
        return PiecewiseSignal(self.breakpoints, generators, self.kind, self.anchors)

    def refined(self, times: ArrayLike) -> PiecewiseSignal:
        """The same signal with further breakpoints, at those of `times` that are not yet among them."""
        extra = np.setdiff1d(np.asarray(times, dtype=float).reshape(-1), self.breakpoints)
        if extra.size == 0:
            return self
        breakpoints = np.sort(np.concatenate([self.breakpoints, extra]))
        owner = self.locate(
            np.concatenate([[breakpoints[0] - 1.0], (breakpoints[:-1] + breakpoints[1:]) / 2, [breakpoints[-1] + 1.0]])
        )
        anchor_times = np.concatenate([breakpoints[:1], breakpoints])
        anchors = np.zeros((len(owner), self.anchors.shape[1]))
        for index, generator in enumerate(self.generators):
            chosen = self.kind[owner] == index
            rows = [np.eye(len(generator.S))] * len(self.generators)
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

    def __neg__(self) -> PiecewiseSignal:
        """The signal with the other sign."""
        return self.scaled(-1.0)

    def __sub__(self, other: PiecewiseSignal) -> PiecewiseSignal:
        """Difference of two signals with the same number of channels."""
        return self + -_signal(other)

    def __add__(self, other: PiecewiseSignal) -> PiecewiseSignal:
        """Sum of two signals with the same number of channels. Raises TrajectoryError for anything else."""
        if self.n_channels != _signal(other).n_channels:
            raise TrajectoryError(f"cannot add signals of {self.n_channels} and {other.n_channels} channels")
        return _side_by_side(self, other, lambda *rows: np.hstack(rows))


def finite_times(t: ArrayLike, inside: ArrayLike | None) -> tuple[Array, Array]:
    """Times (m,) [s], and as many within the pieces meant, by default the same. Raises TrajectoryError unless all are finite."""
    times = np.atleast_1d(real_numbers("times [s]", t))
    within = times if inside is None else np.broadcast_to(real_numbers("times inside pieces [s]", inside), times.shape)
    if times.ndim != 1 or not (np.all(np.isfinite(times)) and np.all(np.isfinite(within))):
        raise TrajectoryError(f"expected finite times (m,) [s], got {np.asarray(t).tolist()!r}")
    return times, within


def _signal(other: object) -> PiecewiseSignal:
    if not isinstance(other, PiecewiseSignal):
        raise TrajectoryError(f"expected a signal, such as rest_to_rest(...) or constant(...), got {type(other).__name__}")
    return other


def selection(mask: NDArray[np.bool_]) -> slice | Indices | None:
    """Which entries a mask chooses: a slice where they are neighbours, which costs no copies; None where it chooses none."""
    chosen = np.flatnonzero(mask)
    if chosen.size == 0:
        return None
    first, last = int(chosen[0]), int(chosen[-1])
    return slice(first, last + 1) if last - first + 1 == chosen.size else chosen


def stack(signals: Sequence[PiecewiseSignal]) -> PiecewiseSignal:
    """One signal whose channels are those of all `signals`, in their order: a reference for a plant with several outputs.

    Raises TrajectoryError for none, and for what is no signal.
    """
    if isinstance(signals, PiecewiseSignal) or not len(signals):
        raise TrajectoryError(
            "expected a list of signals to stack, such as [rest_to_rest(...), constant(0.0)], with at least one of them"
        )
    for signal in signals:
        _signal(signal)
    result = signals[0]
    for signal in signals[1:]:
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
