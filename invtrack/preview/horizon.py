"""The window of known outputs ahead of a planner, and what it asks of the present: phi, at a cost that is one sum."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from invtrack.arrays import Array
from invtrack.preview.known import Stretch
from invtrack.preview.law import PreviewLaw

ROOM = 4
"""A run of whole periods has room for so many times the periods ahead before what is past is cleared away."""


@dataclass(eq=False)
class _Run:
    """Whole periods that follow one another in one interval of the plant, or one period that a jump cuts.

    Args:
        interval: of the plant.
        first, stop: numbers of its periods, the latter exclusive.
        stretches: of a period that is cut; None of whole ones.
        psi: of whole periods, row i that of period `origin` + i; phi(start of period) = exp(-A_b h) phi(end) + psi.
        origin: see psi.
    """

    interval: int
    first: int
    stop: int
    stretches: Sequence[Stretch] | None = None
    psi: Array = field(default_factory=lambda: np.zeros((0, 0)))
    origin: int = 0

    def append(self, psi: Array, ahead: int) -> None:
        """One more whole period, of which `ahead` are looked at at once, at most."""
        if self.stop - self.origin == len(self.psi):
            kept = self.psi[max(0, len(self.psi) - ahead) :]
            self.origin = self.stop - len(kept)
            self.psi = np.vstack([kept, np.zeros((ROOM * ahead, len(psi)))])
        self.psi[self.stop - self.origin] = psi
        self.stop += 1


class Horizon:
    """What is known from the period at hand on, as far as the planner looks ahead."""

    def __init__(self, law: PreviewLaw, start: float, period: float, count: int, zeta: Array) -> None:
        """count: of the periods ahead; zeta: [zeta; 1] at the start, from where the outputs go on as polynomials until told."""
        self._law, self._start, self._period, self._count = law, start, period, count
        self._runs: deque[_Run] = deque()
        self._at_jumps: dict[int, Array] = {}
        self.zeta, self.known = zeta, 0
        times = period * np.arange(count + 1, dtype=float)
        self._powers = {
            id(each): np.ascontiguousarray(each.system.propagators[1].matrices(times).transpose(0, 2, 1)) for each in law.intervals
        }

    def time(self, number: int) -> float:
        """Start [s] of a period."""
        return self._start + number * self._period

    @property
    def end(self) -> float:
        """Time [s] up to which the outputs are known."""
        return self.time(self.known)

    def append(self, stretches: Sequence[Stretch]) -> None:
        """One more period."""
        times = self._law.plant.switch_times
        for stretch in stretches:
            if stretch.interval < len(times) and stretch.end == times[stretch.interval]:
                self._at_jumps[stretch.interval] = stretch.zeta
        interval = stretches[0].interval
        if stretches[-1].interval != interval:
            self._runs.append(_Run(interval, self.known, self.known + 1, stretches))
        else:
            last = self._runs[-1] if self._runs else None
            if last is None or last.stretches is not None or last.interval != interval:
                n_b = len(stretches[0].psi)
                last = _Run(interval, self.known, self.known, psi=np.zeros((0, n_b)), origin=self.known)
                self._runs.append(last)
            last.append(folded(stretches, np.zeros(len(stretches[0].psi))), self._count)
        self.known += 1
        self.zeta = stretches[-1].zeta

    def phi(self, number: int) -> Array:
        """phi (n_b,) right after the start of a period, for what is known and polynomials beyond it."""
        while self._runs and self._runs[0].stop < number:
            self._runs.popleft()
        interval = int(np.searchsorted(self._law.plant.switch_times, self.end, side="right"))
        phi = self._law.phi_of(interval, self.end) @ self.zeta
        for run in reversed(self._runs):
            if run.stop <= number:
                break
            if run.stretches is not None:
                phi, interval = self._through(run.stretches, phi, interval)
                continue
            phi = self._back(phi, interval, run.interval)
            interval, first = run.interval, max(run.first, number)
            count = run.stop - first
            powers = self._powers[id(self._law.intervals[interval])]
            psi = run.psi[first - run.origin : run.stop - run.origin]
            n_b = len(phi)
            phi = phi @ powers[count] + psi.ravel() @ powers[:count].reshape(count * n_b, n_b)
        now = int(np.searchsorted(self._law.plant.switch_times, self.time(number), side="right"))
        return self._back(phi, interval, now)

    def before(self, stretches: Sequence[Stretch], phi: Array) -> list[Array]:
        """phi right before the end of each stretch of a period, for phi right after the period's end; last, that at its start."""
        interval = int(np.searchsorted(self._law.plant.switch_times, stretches[-1].end, side="right"))
        found = []
        for stretch in reversed(stretches):
            phi = self._back(phi, interval, stretch.interval)
            found.append(phi)
            phi, interval = stretch.carrier.decay_b @ phi + stretch.psi, stretch.interval
        return [*reversed(found), phi]

    def _through(self, stretches: Sequence[Stretch], phi: Array, interval: int) -> tuple[Array, int]:
        """phi at the start of a period that jumps cut, and its interval there."""
        for stretch in reversed(stretches):
            phi = self._back(phi, interval, stretch.interval)
            phi, interval = stretch.carrier.decay_b @ phi + stretch.psi, stretch.interval
        return phi, interval

    def _back(self, phi: Array, interval: int, wanted: int) -> Array:
        """phi taken back through the jumps between two intervals, at which no time passes."""
        for k in range(interval - 1, wanted - 1, -1):
            junction = self._law.junctions[k]
            phi = junction.back @ phi + junction.offset @ self._at_jumps[k]
        return phi


def folded(stretches: Sequence[Stretch], phi: Array) -> Array:
    """phi at the start of stretches in one interval, from phi at their end."""
    for stretch in reversed(stretches):
        phi = stretch.carrier.decay_b @ phi + stretch.psi
    return phi
