"""Steps over which the input is linear in time: exact transitions and exact costs, no quadrature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.redesign.weights import Weights
from invtrack.references.signal import JUMP_TOLERANCE, Generator, PiecewiseSignal

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

SAME_LENGTH_DIGITS = 10
"""Steps whose lengths agree to this many digits share their matrices."""

VAN_LOAN_NORM = 0.5
"""Norm up to which a Gramian is read off one exponential; beyond, that of a shorter step is doubled, which cancels nothing."""


@dataclass(frozen=True, eq=False)
class Step:
    """A step of a plant and of the reference behind it, as a map of its own ends.

    x at its end is transition [x; u_s; u_e] (n, n + 2 p), u_s and u_e the input at its start and end; its cost is
    z'cost z + 2 z'drive w + constant for z = [x; u_s; u_e] and the reference's state w at its start.
    """

    system: StateSpace
    length: float
    transition: Array
    cost: Array
    drive: Array

    def values(self, row: Array, share: float) -> Array:
        """Row (n + 2 p,) of [x; u_s; u_e] that gives row [x; u; y] at this share of the step."""
        n, p = self.system.n_states, self.system.n_channels
        c_x = row[:n] + row[n + p :] @ self.system.C
        c_u = row[n : n + p] + row[n + p :] @ self.system.D
        flow = scipy.linalg.expm(_ramp(self.system, self.length) * share)
        at = flow[: n + p] @ _from_ends(n, p)
        return np.asarray(c_x @ at[:n] + c_u @ at[n:])


@dataclass(frozen=True, eq=False)
class Grid:
    """Steps between times (N + 1,): kind (N,) of each among steps, reference anchors (N, q) at their starts.

    first, last (N,): which of the input's nodes stand at a step's start and end. Neighbours share theirs, except where the best
    input jumps: at `jumps`, indices of the steps that start there.
    """

    times: Array
    steps: tuple[Step, ...]
    kind: Indices
    anchors: Array
    first: Indices
    last: Indices
    jumps: Indices

    @property
    def nodes(self) -> int:
        """Number of the input's nodes."""
        return int(self.last[-1]) + 1


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
    """Steps of at most `step` [s] between edges, among which are all breakpoints of the reference and all switch times."""
    times, lengths = grid_times(edges, step)
    fine = reference.refined(times)
    middle = (times[:-1] + times[1:]) / 2
    numbers = {id(system): k for k, system in enumerate(plant.systems)}  # the last of equal ones stands for all
    owner = np.array([numbers[id(system)] for system in plant.systems])[plant.interval(middle)]
    rounded = np.round(lengths / lengths.max(), SAME_LENGTH_DIGITS)
    keys, chosen, kind = np.unique(
        np.column_stack([owner, fine.kind[1:-1], rounded]), axis=0, return_index=True, return_inverse=True
    )
    steps = tuple(
        make_step(plant.systems[int(k)], reference.generators[int(g)], weights, float(lengths[j]))
        for (k, g, _), j in zip(keys, chosen, strict=True)
    )
    jumps = np.flatnonzero(np.isin(times[1:-1], _jump_times(plant, reference))) + 1
    shift = np.zeros(len(lengths), dtype=np.intp)
    shift[jumps] = 1
    first = np.arange(len(lengths)) + np.cumsum(shift)
    return Grid(times, steps, kind.ravel(), fine.anchors[1:-1], first, first + 1, jumps)


def make_step(system: StateSpace, generator: Generator, weights: Weights, length: float) -> Step:
    """The step of one plant, driven by one generator of the reference, over `length` [s]."""
    n, p, q = system.n_states, system.n_channels, len(generator.S)
    M = scipy.linalg.block_diag(_ramp(system, length), generator.S * length)
    seen = np.zeros((n + 2 * p, n + 2 * p + q))
    seen[:n, :n], seen[n : n + p, n : n + p] = np.eye(n), np.eye(p)
    seen[n + p :, :n], seen[n + p :, n : n + p], seen[n + p :, n + 2 * p :] = system.C, system.D, -generator.R
    weight = scipy.linalg.block_diag(weights.Q_x, weights.R, weights.Q_y)
    flow, gramian = _flow_and_gramian(M, seen.T @ weight @ seen)
    ends = scipy.linalg.block_diag(_from_ends(n, p), np.eye(q))
    cost = length * ends.T @ gramian @ ends
    m = n + 2 * p
    return Step(system, length, flow[:n, :m] @ ends[:m, :m], cost[:m, :m], cost[:m, m:])


def _ramp(system: StateSpace, length: float) -> Array:
    """Generator of [x; u; change of u over the step], with time in units of the step."""
    n, p = system.n_states, system.n_channels
    M = np.zeros((n + 2 * p, n + 2 * p))
    M[:n, :n], M[:n, n : n + p], M[n : n + p, n + p :] = length * system.A, length * system.B, np.eye(p)
    return M


def _from_ends(n: int, p: int) -> Array:
    """[x; u; change of u] from [x; u_s; u_e]."""
    result = np.eye(n + 2 * p)
    result[n + p :, n : n + p] = -np.eye(p)
    return result


def _flow_and_gramian(M: Array, Q: Array) -> tuple[Array, Array]:
    """exp(M) and the integral of exp(M's) Q exp(M s) over 0 < s < 1 (Van Loan 1978, and doubling)."""
    scale = balancing_scale(M, within_parts=True)
    M, Q = M * scale / scale[:, None], scale[:, None] * Q * scale
    q, norm = len(M), float(np.linalg.norm(M, 1))
    halvings = max(0, int(np.ceil(np.log2(norm / VAN_LOAN_NORM)))) if norm > 0 else 0
    block = np.block([[-M.T, Q], [np.zeros_like(M), M]]) / 2**halvings
    both = scipy.linalg.expm(block)
    flow = both[q:, q:]
    gramian = flow.T @ both[:q, q:]
    for _ in range(halvings):
        gramian = gramian + flow.T @ gramian @ flow
        flow = flow @ flow
    gramian = gramian / scale[:, None] / scale
    return scale[:, None] * flow / scale, (gramian + gramian.T) / 2


def _jump_times(plant: SwitchedSystem, reference: PiecewiseSignal) -> Array:
    """Where the best input jumps: B or D does, or a wanted output with direct feedthrough does."""
    pairs = zip(plant.systems[:-1], plant.systems[1:], strict=True)
    differ = np.array([not (np.array_equal(a.B, b.B) and np.array_equal(a.D, b.D)) for a, b in pairs], dtype=bool)
    switches = plant.switch_times[differ]
    if not any(np.any(system.D) for system in plant.systems):
        return np.asarray(switches)
    steps = reference.breakpoints[np.any(reference.jumps(0) > JUMP_TOLERANCE, axis=1)]
    return np.union1d(switches, np.union1d(steps, plant.switch_times))
