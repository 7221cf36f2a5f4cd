"""Discretized plan and limits as a quadratic programme, and its answer as a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy  # loads scipy.sparse at its first use

from invtrack.arrays import Array, Indices
from invtrack.linear.state_space import StateSpace
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import Trajectory, TwoSidedSegments, grouped
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.redesign.cost import Weights
from invtrack.redesign.limited.discretization import Grid, ramp, tail_cost
from invtrack.redesign.limited.limit_check import PathPoints
from invtrack.redesign.limited.quadratic_program import QuadraticProgram
from invtrack.redesign.limits import Bound

Entries = tuple[Array, Indices, Indices]


def entries_of(block: Array, rows: Indices, columns: Indices) -> Entries:
    """The same block (r, c) at rows (k, r) and columns (k, c), k times."""
    shape = (len(rows), *block.shape)
    return (
        np.broadcast_to(block, shape).ravel(),
        np.broadcast_to(rows[:, :, None], shape).ravel(),
        np.broadcast_to(columns[:, None, :], shape).ravel(),
    )


def sparse_sum(entries: Sequence[Entries], shape: tuple[int, int]) -> scipy.sparse.csr_array:
    """The sum of all entries."""
    data, rows, columns = (np.concatenate([entry[k] for entry in entries]) for k in range(3))
    return scipy.sparse.csr_array(scipy.sparse.coo_array((data, (rows, columns)), shape=shape))


@dataclass(frozen=True, eq=False)
class LimitRows:
    """What the rows of the programme's limits mean, (rows,) each: number of the bound, its side (-1 low, 1 high), time [s]."""

    bound: Indices
    side: Indices
    time: Array


@dataclass(frozen=True, eq=False)
class Transcription:
    """The unknowns z = [v before; v after; x at the grid's times; u at its nodes], in units in which they are about one.

    Args:
        grid: steps within the window.
        tails: what lies before and after it; each v has the unit in which it moves x and u by about one.
        weights: of the cost.
        bounds: the limits.
        state_unit: units of the states (n,).
        input_unit: units of the inputs (m,).
    """

    grid: Grid
    tails: tuple[Tail, Tail]
    weights: Weights
    bounds: tuple[Bound, ...]
    state_unit: Array
    input_unit: Array

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.state_unit)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.input_unit)

    def x_columns(self, at: Indices) -> Indices:
        """Columns (k, n) of the states at these of the grid's times."""
        return np.asarray(2 * self.n + np.asarray(at)[:, None] * self.n + np.arange(self.n))

    def u_columns(self, node: Indices) -> Indices:
        """Columns (k, m) of the input at these nodes."""
        first = 2 * self.n + len(self.grid.times) * self.n
        return np.asarray(first + np.asarray(node)[:, None] * self.m + np.arange(self.m))

    def step_columns(self, step: Indices) -> Indices:
        """Columns (k, n + 2 m) of [x; u_s; u_e] of these steps."""
        return np.hstack([self.x_columns(step), self.u_columns(self.grid.first[step]), self.u_columns(self.grid.last[step])])

    @property
    def unit(self) -> Array:
        """The unit of each unknown (k,)."""
        outer = np.concatenate([self.state_unit, self.input_unit])
        v = []
        for tail in self.tails:
            reach = np.max(np.abs(tail.X[: self.n + self.m]) / outer[:, None], axis=0)
            v.append(1 / np.where(reach > 0, reach, 1.0))
        return np.concatenate([*v, np.tile(self.state_unit, len(self.grid.times)), np.tile(self.input_unit, self.grid.nodes)])

    def program(self, points: PathPoints) -> tuple[QuadraticProgram, LimitRows]:
        """Cost, equations and limits, and what the rows of these mean."""
        unit = self.unit
        scale = scipy.sparse.diags_array(unit)
        P, q = self._cost()
        E, e = self._equations()
        rows, low, high, owner, time = self.limit_rows(points)
        above, below = np.isfinite(high), np.isfinite(low)
        G = scipy.sparse.vstack([rows[above], -rows[below]], format="csr")
        h = np.concatenate([high[above], -low[below]])
        program = QuadraticProgram(
            P=scipy.sparse.csr_array(scale @ P @ scale),
            q=unit * q,
            E=scipy.sparse.csr_array(E @ scale),
            e=e,
            G=scipy.sparse.csr_array(G @ scale),
            h=h,
        )
        side = np.repeat(np.array([1, -1], dtype=np.intp), [np.sum(above), np.sum(below)])
        return program, LimitRows(np.append(owner[above], owner[below]), side, np.append(time[above], time[below]))

    @cached_property
    def miss(self) -> float:
        """What it costs not to move, z = 0: the constant that the programme's cost leaves out."""
        grid = self.grid
        anchors = [grid.anchors[grid.kind == number, : len(step.miss)] for number, step in enumerate(grid.steps)]
        return float(sum(np.einsum("ki,ij,kj->", w, step.miss, w) for w, step in zip(anchors, grid.steps, strict=True)))

    def limit_rows(self, points: PathPoints) -> tuple[scipy.sparse.csr_array, Array, Array, Indices, Array]:
        """rows z between low and high, in units of each limit's size, the number of the bound behind each row, and its time [s]."""
        blocks: list[tuple[Array, Indices]] = []
        owner, times, lengths, rests = [], [], np.diff(self.grid.times), []
        middles = self.grid.times[:-1] + lengths / 2
        at_nodes = np.empty(self.grid.nodes)
        at_nodes[self.grid.last], at_nodes[self.grid.first] = middles, middles
        for number, bound in enumerate(self.bounds):
            channel = int(np.argmax(bound.row)) - self.n
            if bound.kind == "input":
                columns = self.u_columns(np.arange(self.grid.nodes))[:, [channel]]
                values = np.full(columns.shape, 1 / bound.size)
                times.append(self.grid.node_times)
                rests.append(bound.rest_at(at_nodes))
            elif bound.kind == "input rate":
                ends = (self.grid.first, self.grid.last)
                columns = np.hstack([self.u_columns(nodes)[:, [channel]] for nodes in ends])
                length = np.array([step.length for step in self.grid.steps])[self.grid.kind]
                values = np.array([-1.0, 1.0]) / (length * bound.size)[:, None]
                times.append(middles)
                rests.append(bound.rest_at(middles))
            else:
                chosen = np.flatnonzero(points.bound == number)
                columns = self.step_columns(points.step[chosen])
                values = self._path_values(bound, points.step[chosen], points.share[chosen]) / bound.size
                times.append(self.grid.times[points.step[chosen]] + points.share[chosen] * lengths[points.step[chosen]])
                rests.append(bound.rest_at(middles[points.step[chosen]]))
            blocks.append((values, columns))
            owner.append(np.full(len(columns), number))
        rows = scipy.sparse.vstack([self._rows(values, columns) for values, columns in blocks], format="csr")
        number_of = np.concatenate(owner)
        size, low, high = (np.array([getattr(b, name) for b in self.bounds])[number_of] for name in ("size", "low", "high"))
        rest = np.concatenate(rests)
        return rows, (low - rest) / size, (high - rest) / size, number_of, np.concatenate(times)

    def trajectory(self, z: Array) -> Trajectory:
        """The plan on all of time."""
        n, m, grid = self.n, self.m, self.grid
        z = z * self.unit
        x = z[self.x_columns(np.arange(len(grid.times)))]
        u = z[2 * n + x.size :].reshape(-1, m)
        first, last = u[grid.first], u[grid.last]
        states = np.hstack([x[:-1], first, (last - first) / np.diff(grid.times)[:, None]])

        def segments(number: int, chosen: Indices) -> TwoSidedSegments:
            nothing = np.zeros((len(chosen), 0))
            return TwoSidedSegments(_ramp(grid.systems[number]), states[chosen], nothing)

        before, after = (replace(tail, v=v) for tail, v in zip(self.tails, (z[:n], z[n : 2 * n]), strict=True))
        return grouped(grid.times, grid.owner, segments, before, after)

    def _cost(self) -> tuple[scipy.sparse.csr_array, Array]:
        """P and q of z'P z / 2 + q'z, in plain units."""
        total, n = len(self.unit), self.n
        own = [np.arange(n)[None] + k * n for k in range(2)]
        entries = [
            entries_of(2 * tail_cost(tail, self.weights), columns, columns) for tail, columns in zip(self.tails, own, strict=True)
        ]
        q = np.zeros(total)
        for number, step in enumerate(self.grid.steps):
            chosen = np.flatnonzero(self.grid.kind == number)
            columns = self.step_columns(chosen)
            entries.append(entries_of(2 * step.cost, columns, columns))
            w = self.grid.anchors[chosen, : step.drive.shape[1]]
            np.add.at(q, columns, 2 * w @ step.drive.T)
        return sparse_sum(entries, (total, total)), q

    def _equations(self) -> tuple[scipy.sparse.csr_array, Array]:
        """The plant's equations, and x and u continuous at the window's ends and, where the rate is limited, at jumps."""
        n, m, grid = self.n, self.m, self.grid
        steps = len(grid.kind)
        rows = np.arange(steps * n).reshape(steps, n)
        entries = [entries_of(np.diag(1 / self.state_unit), rows, self.x_columns(np.arange(1, steps + 1)))]
        for number, step in enumerate(grid.steps):
            chosen = np.flatnonzero(grid.kind == number)
            entries.append(entries_of(-step.transition / self.state_unit[:, None], rows[chosen], self.step_columns(chosen)))
        right = [(grid.shifts[:, :n] / self.state_unit).ravel()]
        outer = np.concatenate([self.state_unit, self.input_unit])
        for k, (tail, at, node) in enumerate(zip(self.tails, (0, steps), (0, grid.nodes - 1), strict=True)):
            edge = (steps * n + k * (n + m) + np.arange(n + m))[None]
            window = np.hstack([self.x_columns(np.array([at])), self.u_columns(np.array([node]))])
            entries.append(entries_of(np.diag(1 / outer), edge, window))
            entries.append(entries_of(-tail.X[: n + m] / outer[:, None], edge, np.arange(n)[None] + k * n))
            right.append(tail.held[: n + m] / outer)
        limited = [int(np.argmax(bound.row)) - n for bound in self.bounds if bound.kind == "input rate"]
        count = len(limited) * len(grid.jumps)
        both = [self.u_columns(nodes)[:, limited] for nodes in (grid.first[grid.jumps], grid.last[grid.jumps - 1])]
        at_jumps = (steps * n + 2 * (n + m) + np.arange(count)).reshape(len(grid.jumps), len(limited))
        size = np.diag(1 / self.input_unit[limited]) if limited else np.zeros((0, 0))
        entries += [entries_of(size, at_jumps, both[0]), entries_of(-size, at_jumps, both[1])]
        right.append((grid.shifts[grid.jumps - 1, n:][:, limited] / self.input_unit[limited]).ravel())
        e = np.concatenate(right)
        return sparse_sum(entries, (len(e), len(self.unit))), e

    def _rows(self, values: Array, columns: Indices) -> scipy.sparse.csr_array:
        row = np.broadcast_to(np.arange(len(columns))[:, None], columns.shape)
        return sparse_sum([(values.ravel(), row.ravel(), columns.ravel())], (len(columns), len(self.unit)))

    def _path_values(self, bound: Bound, step: Indices, share: Array) -> Array:
        """The bound's row in terms of [x; u_s; u_e] at these shares of these steps: (k, n + 2 m)."""
        keys, inverse = np.unique(np.column_stack([self.grid.kind[step], share]), axis=0, return_inverse=True)
        known = [self.grid.steps[int(kind)].values(bound.row, float(at)) for kind, at in keys]
        return np.array(known).reshape(-1, self.n + 2 * self.m)[inverse.ravel()]


def _ramp(system: StateSpace) -> DrivenSystem:
    """[x; u; y] of a plant whose input changes at a constant rate: states [x; u; u'], no reference."""
    n, m = system.n_states, system.n_inputs
    X = np.vstack([np.eye(n + m, n + 2 * m), np.hstack([system.C, system.D, np.zeros((system.n_outputs, m))])])
    rows, none = n + 2 * m, np.zeros((0, 0))
    forward = Part(ramp(system, 1.0), X, np.zeros((0, rows)))
    two_sided = TwoSidedSystem(forward, Part.empty(len(X), 0), np.zeros((rows, 0)))
    return DrivenSystem(two_sided, S=none, D_f=np.zeros((rows, 0)), D_b=none, X_w=np.zeros((len(X), 0)), J_w=none)
