"""What the freedom in a modified inverse is chosen for, and one choice of it with its solution."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.inversion.bounded_solution import BoundedSolution, bounded_solution
from invtrack.inversion.inverse_system import Correction, inverse_systems
from invtrack.inversion.modified.modified_dynamics import ModifiedDynamics, derivative_columns
from invtrack.inversion.modified.placement import MovablePart
from invtrack.linear.internal_dynamics import InternalDynamics, SplitDynamics
from invtrack.plans.certificate import ACCURACY, certify
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.references.signal import PiecewiseSignal

NODES = 4
"""Gauss points per panel."""

PANELS = 400
"""Panels in each stretch (before, during and after the manoeuvre) at most."""

TIME_CONSTANTS = 9.0
"""How many time constants of the slowest pole placed are looked at before and after the manoeuvre: its square is then 1e-8."""

NO_EFFECT = 1e-12
"""A term of L changes nothing where its error is below this share of the largest term's; least squares leaves it at zero."""

SMALLEST_RATIO = 1e-3
"""Combinations of terms whose effect is below this share of the strongest are left out: they would take large terms for little,
as where the references of two outputs are nearly the same, and cost accuracy."""


@dataclass(frozen=True, eq=False)
class ErrorSamples:
    """Quadrature nodes (m,) [s], the pieces of the trajectory they lie in, and weights (m,): the integral of f is weights @ f."""

    times: Array
    pieces: Indices
    weights: Array

    def errors(self, trajectory: Trajectory, reference: PiecewiseSignal, scale: Array) -> Array:
        """sqrt(weight) (y - y_d) / scale, (m, p): its sum of squares is the integral of the squared error."""
        y = trajectory(self.times, self.pieces, slice(trajectory.rows - len(scale), trajectory.rows))
        return np.sqrt(self.weights)[:, None] * (y - reference(self.times)) / scale


def error_samples(breakpoints: Array, poles: ComplexArray) -> ErrorSamples:
    """Samples that resolve the poles placed, over the manoeuvre and TIME_CONSTANTS of the slowest of them on both sides."""
    tail = TIME_CONSTANTS / float(np.min(np.abs(poles.real)))
    panel = 1.0 / float(np.max(np.abs(poles)))
    start, end = float(breakpoints[0]), float(breakpoints[-1])
    edges = [np.linspace(start - tail, start, _count(tail, panel) + 1)]
    whole = max(end - start, np.finfo(float).tiny)
    for a, b in itertools.pairwise(breakpoints):
        count = int(np.ceil(min(_count(b - a, panel), PANELS * (b - a) / whole)))
        edges.append(np.linspace(a, b, max(count, 1) + 1))
    edges.append(np.linspace(end, end + tail, _count(tail, panel) + 1))
    starts, ends = np.concatenate([e[:-1] for e in edges]), np.concatenate([e[1:] for e in edges])
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    times = ((starts + ends) / 2)[:, None] + ((ends - starts) / 2)[:, None] * nodes
    pieces = np.searchsorted(breakpoints, (starts + ends) / 2, side="right")
    return ErrorSamples(times.ravel(), np.repeat(pieces, NODES), (((ends - starts) / 2)[:, None] * weights).ravel())


def _count(length: float, panel: float) -> int:
    return int(min(max(np.ceil(length / panel), 8), PANELS))


@dataclass(frozen=True, eq=False)
class DesignProblem:
    """What the freedom in a modified inverse is chosen for.

    Args:
        planning: plant, reference and options.
        internals: internal dynamics of each interval.
        parts: what is placed in each interval.
        unmoved: the zeros that stay in each interval.
        output_scale: sizes of the outputs in which errors are measured (p,).
    """

    planning: PlanningProblem
    internals: Sequence[InternalDynamics]
    parts: Sequence[MovablePart]
    unmoved: Sequence[ComplexArray]
    output_scale: Array

    @cached_property
    def samples(self) -> ErrorSamples:
        """Where the error is weighed."""
        poles = np.concatenate([part.poles for part in self.parts])
        return error_samples(self.planning.deviation.breakpoints, poles if len(poles) else np.array([1.0 + 0j]))

    @cached_property
    def active(self) -> NDArray[np.bool_]:
        """Which outputs are to move at all (p,)."""
        return (
            self.planning.deviation.size(1) * (self.planning.manoeuvre[1] - self.planning.manoeuvre[0]) > 1e-6 * self.output_scale
        )

    def solve(self, dynamics: Sequence[ModifiedDynamics], L: Sequence[Array]) -> BoundedSolution:
        """The bounded solution for one choice of F and L in each interval; those with the same share what is worked out."""
        known: dict[tuple[int, bytes], tuple[SplitDynamics, Correction]] = {}
        built = []
        for d, entry in zip(dynamics, L, strict=True):
            key = (id(d), entry.tobytes())
            if key not in known:
                known[key] = d.with_feedforward(entry)
            built.append(known[key])
        inverses = inverse_systems(self.planning.plant, [split for split, _ in built], [correction for _, correction in built])
        return bounded_solution(self.planning, inverses)

    def is_accurate(self, solution: BoundedSolution) -> bool:
        """Whether a solution keeps the plant's equations over the manoeuvre, so that it may be handed out."""
        planning = self.planning
        certificate = certify(planning.plant, solution.trajectory, planning.deviation, planning.manoeuvre)
        return certificate.worst(exact=False) <= ACCURACY

    def errors(self, solution: BoundedSolution) -> Array:
        """Weighted error samples (m p,); their sum of squares is the integral of the squared error."""
        return self.samples.errors(solution.trajectory, self.planning.deviation, self.output_scale).ravel()

    def no_feedforward(self) -> list[Array]:
        """L = 0 in each interval."""
        return [np.zeros((len(self.output_scale), len(part.degrees) + sum(part.degrees))) for part in self.parts]


@dataclass(frozen=True, eq=False)
class Candidate:
    """One choice of the freedom in F and L: its name, and the integral square of its predicted error over output_scale [s]."""

    name: str
    integral_square_error: float


@dataclass(frozen=True, eq=False)
class Solved:
    """One choice of the freedom, with its solution.

    Args:
        name: of the choice.
        dynamics: the modified inverse of each interval.
        L: that of each interval (p, rho + p).
        solution: the bounded solution with these.
        integral_square_error: that of the predicted error over output_scale [s].
        candidates: what it was compared with.
        remarks: what a user should know.
    """

    name: str
    dynamics: list[ModifiedDynamics]
    L: list[Array]
    solution: BoundedSolution
    integral_square_error: float
    candidates: tuple[Candidate, ...] = ()
    remarks: tuple[str, ...] = ()


def without_feedforward(problem: DesignProblem, name: str, dynamics: list[ModifiedDynamics]) -> Solved:
    """The solution for these F and L = 0."""
    L = problem.no_feedforward()
    solution = problem.solve(dynamics, L)
    return Solved(name, dynamics, L, solution, float(np.sum(problem.errors(solution) ** 2)))


def best_weights(responses: Array, error: Array) -> Array:
    """Weights w (k,), as small as possible, with which error (m,) + responses (m, k) @ w has the least sum of squares."""
    size = np.linalg.norm(responses, axis=0)
    kept, weights = size > NO_EFFECT * np.max(size, initial=0.0), np.zeros(len(size))
    if np.any(kept):
        weights[kept] = np.linalg.lstsq(responses[:, kept] / size[kept], -error, rcond=SMALLEST_RATIO)[0] / size[kept]
    return weights


@dataclass(frozen=True)
class _Entry:
    """One entry of L, in the intervals that share it; unit: what it is measured in, so that v has the size of its output."""

    intervals: list[int]
    row: int
    column: int
    unit: float

    def added(self, L: Sequence[Array], weight: float) -> list[Array]:
        result = [matrix.copy() for matrix in L]
        for k in self.intervals:
            result[k][self.row, self.column] += weight * self.unit
        return result


def with_least_squares(problem: DesignProblem, plain: Solved) -> Solved:
    """L with the least integral square error: the error is affine in L, so one response per entry and least squares give it."""
    name = f"{plain.name} with L"
    entries = _entries(problem, plain.dynamics)
    if not entries:
        return replace(plain, name=name)
    start, best = problem.errors(plain.solution), list(plain.L)
    responses = np.array([problem.errors(problem.solve(plain.dynamics, entry.added(plain.L, 1.0))) - start for entry in entries])
    for entry, weight in zip(entries, best_weights(responses.T, start), strict=True):
        best = entry.added(best, float(weight))
    solution = problem.solve(plain.dynamics, best)
    error = float(np.sum(problem.errors(solution) ** 2))
    return replace(plain, name=name, L=best, solution=solution, integral_square_error=error)


def _entries(problem: DesignProblem, dynamics: Sequence[ModifiedDynamics]) -> list[_Entry]:
    """Entries that act on derivatives of outputs that move."""
    scale = problem.output_scale
    return [
        _Entry(shared, row, column, float(scale[row] / scale[i]))
        for shared in _shared_intervals(problem, dynamics)
        for i, _, column in derivative_columns(dynamics[shared[0]].split.internal.form)
        if problem.active[i]
        for row in range(len(scale))
    ]


def _shared_intervals(problem: DesignProblem, dynamics: Sequence[ModifiedDynamics]) -> list[list[int]]:
    """Intervals with moved zeros, by the modified inverse that they share. In the others the output stays exact until disturbed."""
    groups: dict[int, list[int]] = {}
    for k, (part, d) in enumerate(zip(problem.parts, dynamics, strict=True)):
        if len(part.targets):
            groups.setdefault(id(d), []).append(k)
    return list(groups.values())
