"""What a reference asks for: peaks of its derivatives, how smooth it is, and whether its samples carry these derivatives at all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.arguments import texts
from invtrack.arrays import Array, whole_number
from invtrack.channels import Channels
from invtrack.errors import TrajectoryError
from invtrack.layout import aligned
from invtrack.references.generator import Generator
from invtrack.references.signal import HIGHEST_DERIVATIVE, JUMP_TOLERANCE, PiecewiseSignal, require_signal

COLUMNS = ("order", "peak", "continuous", "change from piece to piece")

FEWEST_PIECES = 16
"""With fewer pieces a change from piece to piece is the shape of the motion, not noise in samples."""

ROUGH = 1.0
"""A derivative that changes from piece to piece by more than this share of its own rms is rough: for one that changes at random it
is 1.4, for a sinusoid with s pieces per period 2 sin(pi / s), so 1 at 6 pieces per period."""


@dataclass(frozen=True, eq=False)
class ReferenceReport:
    """Derivative content of a reference with p channels, for derivatives of order 0 ... `highest`.

    Args:
        channels: names and units.
        span: first and last breakpoint [s].
        pieces: how many lie between these.
        spacing: length of the shortest and of the longest piece [s].
        peaks: largest size of each derivative (highest + 1, p).
        roughness: rms change of each derivative between neighbouring pieces, relative to its own rms (highest + 1, p); NaN with
            fewer than 16 pieces, 0 for a derivative that is zero.
        continuous: how many derivatives of each channel, the value itself counted as one, are continuous (at most highest + 1).
        rest: how many derivatives of each channel, from the first on, vanish at the first and at the last breakpoint, on both sides
            of it.
    """

    channels: Channels
    span: tuple[float, float]
    pieces: int
    spacing: tuple[float, float]
    peaks: Array
    roughness: Array
    continuous: tuple[int, ...]
    rest: tuple[tuple[int, int], ...]

    @property
    def highest(self) -> int:
        """Highest order reported on."""
        return len(self.peaks) - 1

    def first_rough(self, channel: int) -> int | None:
        """Lowest order from which on the derivatives change as much from piece to piece as they are large, or None."""
        rough = np.flatnonzero(self.roughness[:, channel] > ROUGH)
        return int(rough[0]) if rough.size else None

    def __str__(self) -> str:
        spacing = f"of {self.spacing[0]:.4g} s to {self.spacing[1]:.4g} s" if self.pieces else "at rest throughout"
        lines = [f"Reference from {self.span[0]:.6g} s to {self.span[1]:.6g} s, {self.pieces} piece(s) {spacing}"]
        for i, (name, unit) in enumerate(zip(self.channels.names, self.channels.units, strict=True)):
            rows = []
            for order, (peak, rough) in enumerate(zip(self.peaks[:, i], self.roughness[:, i], strict=True)):
                size = f"{peak:.4g} {derivative_unit(unit, order)}"
                change = "-" if np.isnan(rough) else f"{rough:.2g} of its rms"
                rows.append((str(order), size, "yes" if order < self.continuous[i] else "no", change))
            lines += [name, *aligned(COLUMNS, rows)]
            lines += [f"  {self._rest_sentence(place, self.rest[i][place])}" for place in (0, 1)]
            lines += self._noise_sentence(i)
        return "\n".join(lines)

    def _rest_sentence(self, place: int, vanishing: int) -> str:
        verb = ("starts", "ends")[place]
        if vanishing == 0:
            return f"{verb} in motion: the first derivative does not vanish there"
        orders = "derivative 1 vanishes" if vanishing == 1 else f"derivatives 1 to {vanishing} vanish"
        return f"{verb} at rest: {orders} there"

    def _noise_sentence(self, channel: int) -> list[str]:
        order = self.first_rough(channel)
        if order is None:
            return []
        return [
            f"  from order {order} on it changes mostly from sample to sample: noise that differentiation amplifies, or a motion "
            "that the samples do not resolve; smooth the samples, or take fewer of them if their noise is only rounding"
        ]


def reference_report(
    reference: PiecewiseSignal, *, highest: int = 4, channels: Channels | Sequence[str] | None = None
) -> ReferenceReport:
    """Peaks, smoothness, rest and roughness of a reference; `print` shows them as text.

    highest: highest order of derivative; the inverse of a plant of relative degree r uses orders up to r. channels: names and units
    of the reference's channels, such as `model.outputs` of the plant that is to follow it, or names alone. Peaks are taken over
    both ends and three points of each piece, so that a peak between them can be missed by a little.

    Raises TrajectoryError where `highest` is no whole number from 1 on, or the number of channels is another one.
    """
    p = require_signal("reference", reference).n_channels
    highest = whole_number("highest", highest, lowest=1, highest=HIGHEST_DERIVATIVE)
    if channels is None:
        channels = Channels.numbered("y", p)
    elif not isinstance(channels, Channels):
        channels = Channels(texts("channels", channels, expected="Channels, or a list of their names", error=TrajectoryError))
    if len(channels) != p:
        raise TrajectoryError(f"the reference has {p} channel(s), got names for {len(channels)}: {channels}")
    edges = reference.breakpoints
    lengths = np.diff(edges)
    left, right, inner = _derivatives(reference, highest)
    peaks = np.max([np.max(np.abs(values), axis=0) for values in (left, right, *inner) if len(values)], axis=0)
    # What differentiation leaves of the rounding of lower orders is no size to measure jumps by.
    size = peaks.copy()
    for order in range(1, highest + 1 if lengths.size else 0):
        size[order] = np.maximum(size[order], 1e-3 * size[order - 1] / lengths.sum())
    small = JUMP_TOLERANCE * np.where(size > 0, size, 1.0)
    smooth = np.all(np.abs(right - left) <= small, axis=0)
    still = np.maximum(np.abs(left), np.abs(right))[[0, -1]] <= small
    return ReferenceReport(
        channels=channels,
        span=reference.manoeuvre,
        pieces=len(lengths),
        spacing=(float(lengths.min(initial=np.inf)), float(lengths.max())) if lengths.size else (0.0, 0.0),
        peaks=peaks,
        roughness=_roughness(inner),
        continuous=tuple(_leading(smooth[:, i]) for i in range(p)),
        rest=tuple((_leading(still[0, 1:, i]), _leading(still[1, 1:, i])) for i in range(p)),
    )


def derivative_unit(unit: str, order: int) -> str:
    """Unit of a derivative by time: "m", "m/s", "m/s^2"; "1/s" for a signal without unit."""
    if order == 0:
        return unit
    return f"{unit or '1'}/s" + (f"^{order}" if order > 1 else "")


def _derivatives(reference: PiecewiseSignal, highest: int) -> tuple[Array, Array, list[Array]]:
    """All derivatives (., highest + 1, p): left and right of each breakpoint, and inside each piece at three points."""
    # One signal with the derivatives as further channels, so that each state is propagated once for all of them.
    orders = range(highest + 1)
    generators = tuple(Generator(g.S, np.vstack([g.derivative(k) for k in orders])) for g in reference.generators)
    stacked = PiecewiseSignal(reference.breakpoints, generators, reference.kind, reference.anchors)
    edges = reference.breakpoints
    lengths, middle = np.diff(edges), (edges[:-1] + edges[1:]) / 2
    within = np.concatenate([edges[:1] - 1.0, middle, edges[-1:] + 1.0])
    shape = (-1, highest + 1, reference.n_channels)
    left = stacked(edges, inside=within[:-1]).reshape(shape)
    right = stacked(edges, inside=within[1:]).reshape(shape)
    inner = [stacked(middle + share * lengths, inside=middle).reshape(shape) for share in (-1 / 3, 0.0, 1 / 3)]
    return left, right, inner


def _roughness(inner: list[Array]) -> Array:
    """rms difference between neighbouring pieces at like points of them, relative to the rms: (orders, p)."""
    if len(inner[0]) < FEWEST_PIECES:
        return np.full(inner[0].shape[1:], np.nan)
    square = np.sum([np.mean(values**2, axis=0) for values in inner], axis=0)
    change = np.sum([np.mean(np.diff(values, axis=0) ** 2, axis=0) for values in inner], axis=0)
    ratio: Array = np.sqrt(change / np.where(square > 0, square, 1.0))
    return ratio


def _leading(flags: NDArray[np.bool_]) -> int:
    """How many flags from the first on are set."""
    return int(np.argmin(flags)) if not np.all(flags) else len(flags)
