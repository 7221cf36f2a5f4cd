"""A limited plan in finitely many numbers: exact steps with an input linear in time, and a tail in closed form at each end."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices
from invtrack.linear.propagation import transition_and_gramian
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.tail import Tail
from invtrack.redesign.cost import Weights
from invtrack.references.generator import Generator
from invtrack.references.signal import JUMP_TOLERANCE, PiecewiseSignal

SAME_LENGTH_DIGITS = 10
"""Steps whose lengths agree to this many digits share their matrices."""


@dataclass(frozen=True, eq=False)
class Step:
    """A step of a plant and of the reference behind it, as a map of its own ends.

    With z = [x; u_s; u_e] (n + 2 m,), the state and input at its start and the input at its end, x at its end is transition z, and
    the step costs z'cost z + 2 z'drive w + w'miss w for the reference's state w (q,) at its start.

    Args:
        system: the plant over the step.
        length: duration of the step [s].
        transition: (n, n + 2 m).
        cost: (n + 2 m, n + 2 m).
        drive: (n + 2 m, q).
        miss: (q, q), what it costs not to move.
    """

    system: StateSpace
    length: float
    transition: Array
    cost: Array
    drive: Array
    miss: Array

    def values(self, row: Array, share: float) -> Array:
        """Row (n + 2 m,) of [x; u_s; u_e] that gives row [x; u; y] at this share of the step."""
        n, m = self.system.n_states, self.system.n_inputs
        c_x = row[:n] + row[n + m :] @ self.system.C
        c_u = row[n : n + m] + row[n + m :] @ self.system.D
        flow = scipy.linalg.expm(ramp(self.system, self.length) * share)
        at = flow[: n + m] @ _from_ends(n, m)
        return np.asarray(c_x @ at[:n] + c_u @ at[n:])


@dataclass(frozen=True, eq=False)
class Grid:
    """Steps between times. Neighbours share the input's node between them, except where the best input jumps.

    Args:
        times: the steps' ends (N + 1,) [s].
        systems: the distinct models of the plant.
        owner: which of these each step has (N,).
        steps: the distinct steps.
        kind: which of these each step is (N,).
        anchors: the reference's state at the start of each step (N, q).
        first: number of the input's node at each step's start (N,).
        last: number of the input's node at each step's end (N,).
        jumps: numbers of the steps at whose start the best input jumps.
        shifts: by how much states and inputs jump at each step's end with the rest that they are measured from (N, n + p).
    """

    times: Array
    systems: tuple[StateSpace, ...]
    owner: Indices
    steps: tuple[Step, ...]
    kind: Indices
    anchors: Array
    first: Indices
    last: Indices
    jumps: Indices
    shifts: Array

    @property
    def node_times(self) -> Array:
        """Time [s] of each of the input's nodes."""
        times = np.empty(self.nodes)
        times[self.first], times[self.last] = self.times[:-1], self.times[1:]
        return times

    @property
    def nodes(self) -> int:
        """Number of the input's nodes."""
        return int(self.last[-1]) + 1


def tail_cost(tail: Tail, weights: Weights) -> Array:
    """V (n, n): all of an optimal tail costs v'V v, of M'V + V M + X'W X = 0; where it holds still it costs nothing."""
    weight = scipy.linalg.block_diag(weights.Q_x, weights.R, weights.Q_y)
    V = scipy.linalg.solve_continuous_lyapunov(tail.departure.M.T, -tail.X.T @ weight @ tail.X)
    return np.asarray((V + V.T) / 2)


def grid_times(edges: Array, step: float | Array) -> tuple[Array, Array]:
    """Times (N + 1,) with all of `edges` among them and even steps between; plan lengths (N,).

    step: longest step [s], one for all or one for each gap between edges.
    """
    gaps, counts = np.diff(edges), step_counts(edges, step)
    inner = [np.linspace(a, b, m, endpoint=False) for a, b, m in zip(edges[:-1], edges[1:], counts, strict=True)]
    return np.append(np.concatenate(inner), edges[-1]), np.repeat(gaps / counts, counts)


def step_counts(edges: Array, step: float | Array) -> Indices:
    """How many steps `grid_times` makes of each gap between edges."""
    return np.asarray(np.maximum(np.ceil(np.diff(edges) / step * (1 - 1e-9)), 1), dtype=np.intp)


def make_grid(plant: SwitchedSystem, reference: PiecewiseSignal, weights: Weights, edges: Array, step: float | Array) -> Grid:
    """Steps of the plant and the reference, with the costs of each.

    Args:
        plant: with any number of switch times.
        reference: wanted outputs, as deviations from the operating point.
        weights: of the cost.
        edges: times (k,) [s] at which steps must end, among them all breakpoints of the reference and all switch times.
        step: longest step [s], one for all or one for each gap between edges (k - 1,).
    """
    times, lengths = grid_times(edges, step)
    fine = reference.refined(times)
    owner = plant.numbers[plant.interval((times[:-1] + times[1:]) / 2)]
    rounded = np.round(lengths / lengths.max(), SAME_LENGTH_DIGITS)
    keys, chosen, kind = np.unique(
        np.column_stack([owner, fine.kind[1:-1], rounded]), axis=0, return_index=True, return_inverse=True
    )
    steps = tuple(
        make_step(plant.distinct[int(number)], reference.generators[int(generator)], weights, float(lengths[j]))
        for (number, generator, _), j in zip(keys, chosen, strict=True)
    )
    jumps = np.flatnonzero(np.isin(times[1:-1], _jump_times(plant, reference))) + 1
    shift = np.zeros(len(lengths), dtype=np.intp)
    shift[jumps] = 1
    first = np.arange(len(lengths)) + np.cumsum(shift)
    return Grid(
        times=times,
        systems=plant.distinct,
        owner=owner,
        steps=steps,
        kind=kind.ravel(),
        anchors=fine.anchors[1:-1],
        first=first,
        last=first + 1,
        jumps=jumps,
        shifts=_shifts(plant, times),
    )


def make_step(system: StateSpace, generator: Generator, weights: Weights, length: float) -> Step:
    """The step of one plant, driven by one generator of the reference, over `length` [s]."""
    n, m, q = system.n_states, system.n_inputs, len(generator.S)
    M = scipy.linalg.block_diag(ramp(system, length), generator.S * length)
    seen = np.zeros((n + m + system.n_outputs, n + 2 * m + q))
    seen[:n, :n], seen[n : n + m, n : n + m] = np.eye(n), np.eye(m)
    seen[n + m :, :n], seen[n + m :, n : n + m], seen[n + m :, n + 2 * m :] = system.C, system.D, -generator.R
    weight = scipy.linalg.block_diag(weights.Q_x, weights.R, weights.Q_y)
    flow, gramian = transition_and_gramian(M, seen.T @ weight @ seen, 1.0)
    ends = scipy.linalg.block_diag(_from_ends(n, m), np.eye(q))
    cost = length * ends.T @ gramian @ ends
    k = n + 2 * m
    return Step(system, length, flow[:n, :k] @ ends[:k, :k], cost[:k, :k], cost[:k, k:], cost[k:, k:])


def ramp(system: StateSpace, unit: float) -> Array:
    """Generator of [x; u; change of u per unit of time] (n + 2 m, n + 2 m) where u changes evenly; `unit`: the unit of time [s]."""
    n, m = system.n_states, system.n_inputs
    M = np.zeros((n + 2 * m, n + 2 * m))
    M[:n, :n], M[:n, n : n + m], M[n : n + m, n + m :] = unit * system.A, unit * system.B, np.eye(m)
    return M


def _from_ends(n: int, m: int) -> Array:
    """[x; u; change of u] from [x; u_s; u_e]."""
    result = np.eye(n + 2 * m)
    result[n + m :, n : n + m] = -np.eye(m)
    return result


def _shifts(plant: SwitchedSystem, times: Array) -> Array:
    """Jumps of the deviations of states and inputs from rest at the end of each step between the times (N, n + p)."""
    shifts = np.zeros((len(times) - 1, plant.n_states + plant.n_inputs))
    ends = np.searchsorted(times, plant.switch_times) - 1
    shifts[ends] = np.hstack([plant.shifts, -np.diff(plant.rest_inputs, axis=0)])
    return shifts


def _jump_times(plant: SwitchedSystem, reference: PiecewiseSignal) -> Array:
    """Where the best input jumps: B, D or the input at rest does, or a wanted output with direct feedthrough does."""
    pairs = zip(plant.systems[:-1], plant.systems[1:], strict=True)
    differ = np.array([not (np.array_equal(a.B, b.B) and np.array_equal(a.D, b.D)) for a, b in pairs], dtype=bool)
    differ |= np.any(np.diff(plant.rest_inputs, axis=0), axis=1)
    switches = plant.switch_times[differ]
    if not any(np.any(system.D) for system in plant.distinct):
        return np.asarray(switches)
    steps = reference.breakpoints[np.any(reference.jumps(0) > JUMP_TOLERANCE, axis=1)]
    return np.union1d(switches, np.union1d(steps, plant.switch_times))
