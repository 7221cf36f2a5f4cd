"""The quadratic programme of one step towards the best motion within limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.sparse at its first use

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.shooting import Motion
from invtrack.plans.runge_kutta import legendre
from invtrack.redesign.limited.quadratic_program import QuadraticProgram
from invtrack.redesign.limited.transcription import Entries, LimitRows, entries_of, sparse_sum
from invtrack.redesign.limits import Bound
from invtrack.redesign.nonlinear.costed import CostedMotions, Course, Linearized


@dataclass(frozen=True, eq=False)
class LimitedStep:
    """Changes z = [dv; dx at the nodes; dc of the elements] of a course, in units in which they are about one.

    Inputs are linear in time on each element, or constant: they keep to their limits at all times where they do at the ends. Where
    the rate of one is limited it is continuous.

    Args:
        motions: the elements, with one or two coefficients for each input.
        bounds: the limits, as deviations from the operating point.
        origin: inputs and outputs at the operating point (m,) and (p,).
        input_unit: sizes of the inputs (m,).
        state_unit: sizes of the states (n,).
    """

    motions: CostedMotions
    bounds: Sequence[Bound]
    origin: tuple[Array, Array]
    input_unit: Array
    state_unit: Array

    @property
    def rate_limited(self) -> Indices:
        """The inputs whose rate is limited."""
        n = len(self.state_unit)
        return np.array([int(np.argmax(b.row)) - n for b in self.bounds if b.kind == "input rate"], dtype=np.intp)

    @property
    def unit(self) -> Array:
        """Of each unknown."""
        reach = np.max(np.abs(self.motions.ends[0].X) / self.state_unit[:, None], axis=0)
        v = 1 / np.where(reach > 0, reach, 1.0)
        N = len(self.motions.mesh)
        return np.concatenate([v, np.tile(self.state_unit, N + 1), np.tile(self.input_unit, N * self.motions.scheme.count)])

    def x_columns(self, at: Indices) -> Indices:
        """Columns (k, n) of the states at these nodes of the mesh."""
        n = len(self.state_unit)
        return np.asarray(n + np.asarray(at)[:, None] * n + np.arange(n))

    def c_columns(self, at: Indices) -> Indices:
        """Columns (k, s m) of the coefficients on these elements."""
        n, N, size = len(self.state_unit), len(self.motions.mesh), self.motions.scheme.count * len(self.input_unit)
        return np.asarray(n * (N + 2) + np.asarray(at)[:, None] * size + np.arange(size))

    def moved(self, course: Course, z: Array, share: float) -> Course:
        """The course changed by a share of z."""
        n, N, motion = len(self.state_unit), len(self.motions.mesh), course.motion
        change = share * self.unit * z
        dynamics = self.motions.dynamics[0]
        tangents = np.zeros((N + 1, dynamics.size))
        tangents[:, self.motions.states] = change[n : n * (N + 2)].reshape(N + 1, n)
        points = dynamics.retract(motion.points, tangents)
        coefficients = motion.coefficients + change[n * (N + 2) :].reshape(motion.coefficients.shape)
        return Course(Motion(points, coefficients), course.v + change[:n])

    def program(self, course: Course, *, rough: bool = True) -> tuple[QuadraticProgram, LimitRows]:
        """Cost, equations and limits of changes of a course, and what the rows of these mean."""
        linearized, unit = self.motions.linearized(course.motion, rough=rough), self.unit
        scale = scipy.sparse.diags_array(unit)
        P, q = self._cost(course, linearized)
        E, e = self._equations(course, linearized)
        G, low, high, rows = self._limits(course, linearized)
        above, below = np.isfinite(high), np.isfinite(low)
        program = QuadraticProgram(
            P=scipy.sparse.csr_array(scale @ P @ scale),
            q=unit * q,
            E=scipy.sparse.csr_array(E @ scale),
            e=e,
            G=scipy.sparse.csr_array(scipy.sparse.vstack([G[above], -G[below]], format="csr") @ scale),
            h=np.concatenate([high[above], -low[below]]),
        )
        side = np.repeat(np.array([1, -1], dtype=np.intp), [np.sum(above), np.sum(below)])
        meaning = LimitRows(np.append(rows.bound[above], rows.bound[below]), side, np.append(rows.time[above], rows.time[below]))
        return program, meaning

    def _cost(self, course: Course, linearized: Linearized) -> tuple[scipy.sparse.csr_array, Array]:
        motions, total, N = self.motions, len(self.unit), len(self.motions.mesh)
        model, (before, after), n = motions.quadratics(course.motion, linearized), motions.ends, len(self.state_unit)
        columns = np.hstack([self.x_columns(np.arange(N)), self.c_columns(np.arange(N))])
        first, last = np.arange(n)[None], self.x_columns(np.array([N]))
        entries = [
            _blocks(2 * model.H, columns, columns),
            entries_of(2 * before.tail_weight, first, first),
            entries_of(2 * after.state_weight, last, last),
        ]
        q = np.zeros(total)
        np.add.at(q, columns, 2 * model.g)
        q[:n] += 2 * before.tail_weight @ course.v
        q[last[0]] += 2 * after.state_weight @ after.away(course.motion.points[-1])
        return sparse_sum(entries, (total, total)), q

    def _equations(self, course: Course, linearized: Linearized) -> tuple[scipy.sparse.csr_array, Array]:
        """Elements that meet, the first one at the end of the way from rest, and inputs that do not jump where they must not."""
        motions, motion, N = self.motions, course.motion, len(self.motions.mesh)
        (before, after), n, unit = motions.ends, len(self.state_unit), self.state_unit
        V = linearized.states[:, -1] / unit[:, None]
        rows = n + np.arange(N * n).reshape(N, n)
        start, own = np.arange(n)[None], np.arange(N)
        columns = np.hstack([self.x_columns(own), self.c_columns(own)])
        entries = [
            entries_of(np.diag(1 / unit), start, self.x_columns(np.array([0]))),
            entries_of(-before.X / unit[:, None], start, start),
            entries_of(np.diag(1 / unit), rows, self.x_columns(own + 1)),
            _blocks(-V, rows, columns),
        ]
        gap = motions.difference(before.point(course.v)[None], motion.points[:1])[0]
        right = [gap / unit, (motions.gaps(motion) / unit).ravel()]
        used = n * (N + 1)
        for i in self.rate_limited.tolist():
            size, at = self.input_unit[i], used + np.arange(N + 1)
            used += N + 1
            (first, last), own_columns = self._edge_values(i), self.c_columns(own)
            left, right_side = motion.coefficients[:, :, i] @ first, motion.coefficients[:, :, i] @ last
            # At the window's start, between elements, and at its end.
            inner = at[1:-1, None]
            entries += [
                entries_of((first / size)[None], at[:1, None], own_columns[:1, i :: len(self.input_unit)]),
                entries_of(-before.U[i : i + 1] / size, at[:1, None], start),
                entries_of((first / size)[None], inner, own_columns[1:, i :: len(self.input_unit)]),
                entries_of(-(last / size)[None], inner, own_columns[:-1, i :: len(self.input_unit)]),
                entries_of((last / size)[None], at[-1:, None], own_columns[-1:, i :: len(self.input_unit)]),
                entries_of(-self._leaving(i) / size, at[-1:, None], self.x_columns(np.array([N]))),
            ]
            arriving = before.rest.inputs[i] + before.U[i] @ course.v
            leaving = after.rest.inputs[i] + (self._leaving(i) @ after.away(motion.points[-1]))[0]
            right.append(np.concatenate([[arriving - left[0]], right_side[:-1] - left[1:], [leaving - right_side[-1]]]) / size)
        return sparse_sum(entries, (used, len(self.unit))), np.concatenate(right)

    def _leaving(self, i: int) -> Array:
        """The row (1, n) of the deviation with which the window ends that gives the input with which the way back begins."""
        after = self.motions.ends[1]
        return np.asarray(np.linalg.solve(after.X.T, after.U[i]))[None]

    def _edge_values(self, i: int) -> tuple[Array, Array]:
        """What coefficients (s,) make of an input at the start and at the end of an element."""
        start, end = legendre(self.motions.scheme.count, np.array([0.0, 1.0]))
        return start, end

    def _limits(self, course: Course, linearized: Linearized) -> tuple[scipy.sparse.csr_array, Array, Array, LimitRows]:
        """Rows, and what they may change by, in the limits' sizes: inputs at the ends of elements, all else at all nodes."""
        motions, motion, n, m = self.motions, course.motion, len(self.state_unit), len(self.input_unit)
        mesh, S, own = motions.mesh, motions.scheme.steps, np.arange(len(motions.mesh))
        columns = np.hstack([self.x_columns(own), self.c_columns(own)])
        values = self.values(motion)
        matrices, low, high, owner, time = [], [], [], [], []
        for number, bound in enumerate(self.bounds):
            if bound.kind == "path":
                rows = (
                    np.einsum("a,kjab->kjb", bound.row[:n], linearized.states)
                    + bound.row[n : n + m] @ linearized.inputs
                    + np.einsum("a,kjab->kjb", bound.row[n + m :], linearized.outputs)
                )
                at = values @ bound.row
                when = mesh.edges[:-1, None] + mesh.lengths[:, None] * np.linspace(0.0, 1.0, S + 1)
            else:
                i = int(np.argmax(bound.row)) - n
                edges = np.array(self._edge_values(i)) if motions.scheme.count > 1 else np.array(self._edge_values(i))[:1]
                if bound.kind == "input rate":
                    edges = np.diff(edges, axis=0)
                rows = np.zeros((len(own), len(edges), columns.shape[1]))
                rows[:, :, n + i :: m] = edges
                at = motion.coefficients[:, :, i] @ edges.T - (0.0 if bound.kind == "input rate" else self.origin[0][i])
                when = mesh.edges[:-1, None] + mesh.lengths[:, None] * np.linspace(0.0, 1.0, len(edges))
                if bound.kind == "input rate":
                    rows, at = rows / mesh.lengths[:, None, None], at / mesh.lengths[:, None]
                    when = when + mesh.lengths[:, None] / 2
            count = rows.shape[1]
            flat = rows.reshape(-1, rows.shape[2]) / bound.size
            place = np.arange(len(flat))[:, None]
            matrices.append(
                sparse_sum([_blocks(flat[:, None], place, np.repeat(columns, count, axis=0))], (len(flat), len(self.unit)))
            )
            low.append((bound.low - at).ravel() / bound.size)
            high.append((bound.high - at).ravel() / bound.size)
            owner.append(np.full(len(flat), number))
            time.append(when.ravel())
        rows_of = LimitRows(np.concatenate(owner), np.zeros(0, dtype=np.intp), np.concatenate(time))
        return scipy.sparse.vstack(matrices, format="csr"), np.concatenate(low), np.concatenate(high), rows_of

    def values(self, motion: Motion) -> Array:
        """[x; u; y] at the nodes (N, S + 1, n + m + p), as deviations from the operating point."""
        motions = self.motions
        nodes, u = motions.nodes(motion), motions.inputs(motion.coefficients)
        states = motions.dynamics[0].states(nodes.reshape(-1, nodes.shape[2])).reshape(*nodes.shape[:2], -1)
        return np.concatenate([states, u - self.origin[0], motions.outputs(nodes, u) - self.origin[1]], axis=2)


def _blocks(blocks: Array, rows: Indices, columns: Indices) -> Entries:
    """Blocks (k, r, c) at rows (k, r) and columns (k, c)."""
    return (
        blocks.ravel(),
        np.broadcast_to(rows[:, :, None], blocks.shape).ravel(),
        np.broadcast_to(columns[:, None, :], blocks.shape).ravel(),
    )
