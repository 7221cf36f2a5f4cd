"""The outputs that are known so far, in periods of the planner and the stretches that these consist of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.preview.chain_driven import Carrier
from invtrack.preview.law import PreviewLaw
from invtrack.references.generator import Generator
from invtrack.references.signal import PiecewiseSignal


@dataclass(frozen=True, eq=False)
class Stretch:
    """A stretch of time within a period of the planner, in one interval of the plant and one piece of the reference.

    Args:
        interval: of the plant.
        generator: of the reference, as deviation from the interval's rest.
        start, end: [s].
        w_start, w_end: the generator's state there.
        zeta: the outputs and their derivatives at the end, absolute, and 1 (q + 1,).
        carrier: what the stretch does.
        psi: phi(start) = exp(-A_b L) phi(end) + psi.
        Phi: (n_b, n_f) at its start and at its end; None where it is zero.
    """

    interval: int
    generator: Generator
    start: float
    end: float
    w_start: Array
    w_end: Array
    zeta: Array
    carrier: Carrier
    psi: Array
    Phi: tuple[Array, Array] | None


class Deviations:
    """Generators of a reference as deviation from the rest of each interval, made once each."""

    def __init__(self, law: PreviewLaw) -> None:
        self._law = law
        self._made: dict[tuple[Generator, int], Generator] = {}

    def of(self, generator: Generator, interval: int) -> Generator:
        """R w less the output at rest: w has a 1 appended where that is not zero."""
        y_0 = self._law.intervals[interval].plant.operating_point.y0
        if not np.any(y_0):
            return generator
        key = (generator, interval)
        if key not in self._made:
            if len(self._made) >= 512:
                self._made.clear()
            self._made[key] = Generator(np.pad(generator.S, (0, 1)), np.column_stack([generator.R, -y_0]))
        return self._made[key]


def stretches(law: PreviewLaw, deviations: Deviations, reference: PiecewiseSignal, start: float, end: float) -> list[Stretch]:
    """The stretches of a reference between two times [s], cut at its breakpoints and at the plant's jumps."""
    jumps, edges = (_between(times, start, end) for times in (law.plant.switch_times, reference.breakpoints))
    (interval, inner), (piece, cuts) = jumps, edges
    found = []
    while True:
        until = min([end, *inner[:1], *cuts[:1]])
        found.append(_stretch(law, deviations, reference, piece, interval, start, until))
        if until == end:
            return found
        if inner and inner[0] == until:
            interval, inner = interval + 1, inner[1:]
        if cuts and cuts[0] == until:
            piece, cuts = piece + 1, cuts[1:]
        start = until


def _between(times: Array, start: float, end: float) -> tuple[int, list[float]]:
    """The number of the piece, between these times, that begins or goes on at the start, and the times before the end."""
    first, last = int(times.searchsorted(start, side="right")), int(times.searchsorted(end, side="left"))
    return first, times[first:last].tolist()


def _stretch(
    law: PreviewLaw, deviations: Deviations, reference: PiecewiseSignal, piece: int, interval: int, start: float, end: float
) -> Stretch:
    """That within one piece of the reference and one interval of the plant.

    Args:
        law: what is planned.
        deviations: generators.
        reference, piece: the signal and which of its pieces.
        interval: of the plant.
        start, end: [s].
    """
    own = reference.generators[reference.kind[piece]]
    w = state_at(reference, piece, start)
    each, generator = law.intervals[interval], deviations.of(own, interval)
    if generator is not own:
        w = np.append(w, 1.0)
    carrier = each.carrier(generator, end - start)
    w_end = carrier.turn @ w
    zeta = np.append(carrier.zeta @ w_end + each.rest, 1.0)
    psi = -carrier.g @ w
    Phi = law.slope(interval, end)
    both = None
    if Phi is not None:
        psi += carrier.decay_b @ (Phi @ (carrier.f @ w))
        both = carrier.decay_b @ Phi @ carrier.decay_f, Phi
    return Stretch(interval, generator, start, end, w, w_end, zeta, carrier, psi, both)


def state_at(reference: PiecewiseSignal, piece: int, time: float) -> Array:
    """The generator's state (k,) of a piece of a signal at a time [s] in it."""
    generator = reference.generators[reference.kind[piece]]
    w = reference.anchors[piece, : len(generator.S)]
    since = time - float(reference.breakpoints[max(piece - 1, 0)])
    if since == 0:
        return w
    result, term = w, w
    for power in range(1, len(w) + 1):  # of polynomials the series ends
        term = generator.S @ term * (since / power)
        if not term.any():
            return result
        result = result + term
    direction = 1.0 if piece else -1.0
    return np.asarray(generator.propagator(direction).states(w[np.newaxis], np.array([max(direction * since, 0.0)]))[0])
