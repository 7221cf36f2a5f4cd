"""From plant, reference and weights to the optimal trajectory on all of time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.ends import Departure
from invtrack.plans.plan import TwoSidedGenerator, TwoSidedTrajectory
from invtrack.redesign.optimal.boundary import join
from invtrack.redesign.optimal.interval import Interval, make_interval, two_sided
from invtrack.redesign.optimal.optimum import Optimum, optimum
from invtrack.redesign.weights import Weights, without_rounding
from invtrack.references.signal import Generator, PiecewiseSignal

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Redesign:
    """The optimal trajectory and its two ends.

    departures: what dies out before the manoeuvre (backward in time) and after it. held: the values (p,) at which the reference
    holds still before and after; held_values: [x; u; y] (n + 2 p,) that the trajectory tends to there.
    """

    trajectory: TwoSidedTrajectory
    departures: tuple[Departure, Departure]
    held: tuple[Array, Array]
    held_values: tuple[Array, Array]


def assemble(plant: SwitchedSystem, reference: PiecewiseSignal, weights: Weights) -> Redesign:
    """The optimum for a reference (as deviation) that has breakpoints at all switch times and holds still before and after."""
    edges, y_0 = reference.breakpoints, plant.operating_point.y0
    before, after = (without_rounding(reference(t), reference, y_0) for t in (edges[0] - 1.0, edges[-1] + 1.0))
    held = (before, after)
    if not np.any(weights.Q_y):
        return _rest(plant, reference, held)
    columns = np.hstack([*(generator.R for generator in reference.generators), *(value[:, np.newaxis] for value in held)])
    known = {id(system): _measured(optimum(system, weights), columns) for system in plant.systems}
    optima = [known[id(system)] for system in plant.systems]
    driven = {key: [two_sided(best, generator) for generator in reference.generators] for key, best in known.items()}
    end_anchors = reference.end_anchors()
    owner = plant.interval((edges[:-1] + edges[1:]) / 2)
    intervals = [
        make_interval(best, reference, end_anchors, np.flatnonzero(owner == k) + 1, driven[id(system)])
        for k, (best, system) in enumerate(zip(optima, plant.systems, strict=True))
    ]
    first, last = optima[0], optima[-1]
    xi_0, s_f = first.steady_f @ held[0], last.steady_b @ held[1]
    values = join(intervals, xi_0, s_f)
    s_start = intervals[0].E_b @ values[0][1] + intervals[0].p_b
    xi_end = intervals[-1].E_f @ values[-1][0] + intervals[-1].p_f
    ends = _Ends(first, last, held, s_start, xi_end)
    return Redesign(
        trajectory=_trajectory(plant.systems, reference, driven, intervals, values, ends),
        departures=(
            Departure(first.A_c.T, first.X_b, s_start - first.steady_b @ held[0]),
            Departure(last.A_c, last.X_f, xi_end - last.steady_f @ held[1]),
        ),
        held=held,
        held_values=(first.steady_values @ held[0], last.steady_values @ held[1]),
    )


@dataclass(frozen=True, eq=False)
class _Ends:
    """The two pieces without end: the outputs held there, s (n,) where the first one ends, xi (n,) where the last one starts."""

    first: Optimum
    last: Optimum
    held: tuple[Array, Array]
    s_start: Array
    xi_end: Array

    def generators(self) -> list[TwoSidedGenerator]:
        """Before the manoeuvre xi rests at its steady value and s runs backward; after it, s rests and xi runs forward."""
        # One state that stays at 1, so that nothing depends on the unit of the outputs.
        before, after = (
            two_sided(best, Generator(np.zeros((1, 1)), value[:, np.newaxis]))
            for best, value in zip((self.first, self.last), self.held, strict=True)
        )
        none, no_columns = np.zeros((0, 0)), np.zeros((len(self.first.X_y), 0))
        value_before = (self.first.X_y + self.first.X_f @ self.first.steady_f) @ self.held[0]
        value_after = (self.last.X_y + self.last.X_b @ self.last.steady_b) @ self.held[1]
        X_before, X_after = np.column_stack([self.first.X_b, value_before]), np.column_stack([self.last.X_f, value_after])
        return [TwoSidedGenerator(none, no_columns, before.M_b, X_before), TwoSidedGenerator(after.M_f, X_after, none, no_columns)]


def _measured(best: Optimum, columns: Array) -> Optimum:
    """xi and s in powers of two of their units, such that the drive by the reference's columns is of the size of the dynamics.

    As entries of an augmented matrix, a drive made large by the weights would set the pace of all of it.
    """
    pace = np.linalg.norm(best.A_c, 1)
    units = []
    for E in (best.E_f, best.E_b):
        drive = np.max(np.abs(E @ columns).sum(axis=0))
        units.append(float(2.0 ** np.ceil(np.log2(drive / pace))) if drive > 0 else 1.0)
    return best.in_units_of(units[0], units[1])


def _trajectory(
    systems: Sequence[StateSpace],
    reference: PiecewiseSignal,
    driven: dict[int, list[TwoSidedGenerator]],
    intervals: Sequence[Interval],
    values: Sequence[tuple[Array, Array]],
    ends: _Ends,
) -> TwoSidedTrajectory:
    """The pieces within the intervals, from (xi at its start, s at its end) of each, and the two without end."""
    n, (pieces, q) = len(ends.s_start), reference.anchors.shape
    v_f, v_b = np.zeros((pieces, n + q)), np.zeros((pieces, n + q))
    kind = np.empty(pieces, dtype=np.intp)
    numbers = {key: k * len(reference.generators) for k, key in enumerate(driven)}
    for interval, system, (xi, s) in zip(intervals, systems, values, strict=True):
        inner = interval.pieces
        kind[inner] = numbers[id(system)] + interval.kind
        v_f[inner, :n], v_b[inner, :n] = interval.parts(xi, s)
        v_f[inner, n:], v_b[inner, n:] = interval.start_w, interval.end_w
    generators = [*(generator for group in driven.values() for generator in group), *ends.generators()]
    kind[0], kind[-1] = len(generators) - 2, len(generators) - 1
    v_b[0, : n + 1], v_f[-1, : n + 1] = np.append(ends.s_start, 1.0), np.append(ends.xi_end, 1.0)
    return TwoSidedTrajectory(reference.breakpoints, tuple(generators), kind, v_f, v_b)


def _rest(plant: SwitchedSystem, reference: PiecewiseSignal, held: tuple[Array, Array]) -> Redesign:
    """The optimum where nothing is asked of the output: not to move. (The Riccati equation may have no stabilizing solution.)"""
    rows = plant.n_states + 2 * plant.n_channels
    still, none, no_columns = np.zeros((1, 1)), np.zeros((0, 0)), np.zeros((rows, 0))
    forward = TwoSidedGenerator(still, np.zeros((rows, 1)), none, no_columns)
    backward = TwoSidedGenerator(none, no_columns, still, np.zeros((rows, 1)))
    pieces = len(reference.breakpoints) + 1
    kind = np.zeros(pieces, dtype=np.intp)
    kind[0] = 1
    v = np.zeros((pieces, 1))
    nothing = Departure(none, no_columns, np.zeros(0))
    trajectory = TwoSidedTrajectory(reference.breakpoints, (forward, backward), kind, v, v)
    return Redesign(trajectory, (nothing, nothing), held, (np.zeros(rows), np.zeros(rows)))
