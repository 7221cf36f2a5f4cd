"""What a planner drives over one period."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array
from invtrack.errors import TrajectoryError
from invtrack.plans.plan import Samples
from invtrack.plans.trajectory import TwoSidedSegments
from invtrack.preview.known import Stretch
from invtrack.preview.law import PreviewLaw
from invtrack.references.signal import finite_times


@dataclass(frozen=True, eq=False)
class PlanPiece:
    """What a planner drives over one period, planned with what was known at its start.

    Args:
        law: what it was planned by.
        stretches: of the reference within the period.
        starts: z_f at the start of each stretch, measured from what the outputs make of it.
        ends: z_b at the end of each, likewise.
        x, u: state (n,) and input (m,) at the period's start, the state as deviation from the operating point's x0.
        state_change, input_change: by how much these differ from what the last plan foresaw for this instant.
    """

    law: PreviewLaw
    stretches: Sequence[Stretch]
    starts: Sequence[Array]
    ends: Sequence[Array]
    x: Array
    u: Array
    state_change: Array
    input_change: Array

    @property
    def start(self) -> float:
        """Start of the period [s]."""
        return self.stretches[0].start

    @property
    def end(self) -> float:
        """End of the period [s]."""
        return self.stretches[-1].end

    def __repr__(self) -> str:
        return f"<plan by {self.law.method} from {self.start:.6g} to {self.end:.6g} s>"

    @cached_property
    def segments(self) -> tuple[TwoSidedSegments, ...]:
        """One segment for each stretch, in the method's own coordinates."""
        return tuple(
            TwoSidedSegments(
                self.law.intervals[stretch.interval].driven_by(stretch.generator),
                np.concatenate([z_f, stretch.w_start])[np.newaxis],
                np.concatenate([z_b, stretch.w_end])[np.newaxis],
            )
            for stretch, (z_f, z_b) in zip(self.stretches, self.own_states(), strict=True)
        )

    def own_states(self) -> list[tuple[Array, Array]]:
        """z_f at the start and z_b at the end of each stretch, in the method's own coordinates."""
        found = []
        for stretch, z_f, z_b in zip(self.stretches, self.starts, self.ends, strict=True):
            each = self.law.intervals[stretch.interval]
            zeta = stretch.carrier.zeta
            found.append((z_f + each.Pi_f @ (zeta @ stretch.w_start), z_b + each.Pi_b @ (zeta @ stretch.w_end)))
        return found

    def __call__(self, t: ArrayLike) -> Samples:
        """Values at times t (k,) [s] within the period; at an instant between two stretches those of the later one.

        Raises TrajectoryError for times outside it.
        """
        times, _ = finite_times(t, None)
        if np.any(times < self.start) or np.any(times > self.end):
            raise TrajectoryError(
                f"this piece of a plan holds from {self.start:.6g} to {self.end:.6g} s, got times from {times.min():.6g} to "
                f"{times.max():.6g} s; ask the planner for the piece of another period"
            )
        n, m, plant = self.law.plant.n_states, self.law.plant.n_inputs, self.law.plant
        result = np.empty((len(times), n + m + 2 * plant.n_outputs))
        edges = np.array([stretch.end for stretch in self.stretches[:-1]])
        which = np.searchsorted(edges, times, side="right")
        for index in np.unique(which).tolist():
            stretch, chosen = self.stretches[index], which == index
            rest = self.law.intervals[stretch.interval].plant
            point, at = rest.operating_point, times[chosen]
            number = np.zeros(len(at), dtype=np.intp)
            result[chosen, : n + m + plant.n_outputs] = self.segments[index].values(
                number, at - stretch.start, stretch.end - at, slice(None), 0.0
            ) + np.concatenate([rest.rest, point.u0, point.y0])
            generator = stretch.generator
            y_d = generator.propagator(1.0).outputs(generator.R, stretch.w_start[np.newaxis], number, at - stretch.start)
            result[chosen, n + m + plant.n_outputs :] = y_d + point.y0
        x, u, y, y_d = np.split(result, np.cumsum([n, m, plant.n_outputs]), axis=1)
        return Samples(time=times, x=x, u=u, y=y, y_d=y_d)
