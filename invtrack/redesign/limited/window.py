"""The best plan within limits: a window as wide as it must be, with limits imposed at as many instants as it takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RedesignError
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.limited.discretization import make_grid, step_counts
from invtrack.redesign.limited.limit_check import PathPoints, grid_points, tail_excess, values_between, worst_within_steps
from invtrack.redesign.limited.optimality import Optimality, measured_optimality
from invtrack.redesign.limited.quadratic_program import QuadraticProgram, SolverGaveUpError, explain
from invtrack.redesign.limited.transcription import LimitRows, Transcription
from invtrack.redesign.limits import Bound
from invtrack.redesign.quadratic import FreeOptimum
from invtrack.references.signal import JUMP_TOLERANCE, PiecewiseSignal

TAIL_SHARE = 1e-2
"""Share of the peak to which the optimum without limits has decayed where the first window ends."""

INTERPOLATION_ERROR = 1e-5
"""What linear interpolation of the input without limits may miss, as a share of its peak, if no step is stated."""

FEWEST_STEPS, USUAL_MOST_STEPS, MOST_STEPS = 200, 4000, 40_000
"""Steps of the first window if no step is stated; and of any window."""

COARSER = 10.0
"""By how much a step may be longer than the interpolation error asks for where the first window would have too many."""

SAMPLES = 4000
"""Instants, about, at which the optimum without limits is looked at."""

KEPT = 1e-9
"""A limit counts as kept where it is exceeded by no more than this share of its size."""

OVERSHOOT = 1e-6
"""The same for states and outputs, between the instants at which they are held to their limits."""

SNAP = 1e-7
"""A value within this share of a limit's size of the limit counts as on it: inputs and rates are put there."""

EDGE_SHARES = np.array([0.0, 0.5, 1.0])
"""Shares of the window's first and last step at which no limit may act."""

MOST_DOUBLINGS = 6
"""How often the time before and after the manoeuvre is doubled in search of a window in which the limits can be kept."""

MOST_COARSENINGS = 4
"""How often the step is doubled where the solver gives up."""

MOST_ROUNDS = 40
"""Windows and sets of instants that are tried."""


@dataclass(frozen=True, eq=False)
class LimitedProblem:
    """What is to be planned: the optimum without limits, with the problem that it solves, and the limits."""

    free: FreeOptimum
    bounds: tuple[Bound, ...]

    @property
    def plant(self) -> SwitchedSystem:
        """The plant."""
        return self.free.problem.plant

    @property
    def reference(self) -> PiecewiseSignal:
        """Wanted outputs, as deviations from the operating point, with breakpoints at all jumps of the plant."""
        return self.free.problem.deviation

    @property
    def tails(self) -> tuple[Tail, Tail]:
        """What lies before and after the manoeuvre without limits; with other v also what lies before and after the window."""
        return self.free.trajectory.before, self.free.trajectory.after


@dataclass(frozen=True, eq=False)
class LimitedSolution:
    """The best plan within the limits.

    Args:
        trajectory: of the deviations.
        overshoot: the largest excess of a limit, as a share of its size.
        step: the longest step [s].
        rows: the rows by which the limits were imposed.
        multipliers: of these, (rows,), in cost per unit of what each limits.
        optimality: how far from the optimum it can be.
    """

    trajectory: Trajectory
    overshoot: float
    step: float
    rows: LimitRows
    multipliers: Array
    optimality: Optimality


def free_excess(problem: LimitedProblem) -> float:
    """Largest excess of a limit by the optimum without limits, as a share of the limit's size; NaN where that is no number.

    Infinite where the rate of an input that jumps is limited.
    """
    if _jumps_against_limits(problem):
        return np.inf
    per_piece = max(65, SAMPLES // (len(problem.free.trajectory.breakpoints)) + 1)
    nodes = (1 - np.cos(np.linspace(0.0, np.pi, per_piece))) / 2  # both sides of a jump included
    tails = [tail_excess(tail, problem.bounds) for tail in problem.tails]
    values = values_between(problem.free.trajectory, problem.bounds, nodes)
    inner = [float(np.max(bound.excess(value))) for bound, value in zip(problem.bounds, values, strict=True)]
    return float(np.max([*inner, *(np.max(excess) for excess in tails)]))


def _jumps_against_limits(problem: LimitedProblem) -> bool:
    """Whether an input with a limited rate jumps in the optimum without limits, in absolute terms."""
    n, plant, edges = problem.plant.n_states, problem.plant, problem.free.trajectory.breakpoints
    limited = [int(np.argmax(bound.row)) - n for bound in problem.bounds if bound.kind == "input rate"]
    rows, pieces = slice(n, n + plant.n_inputs), np.arange(len(edges))
    before, after = problem.free.trajectory(edges, pieces, rows), problem.free.trajectory(edges, pieces + 1, rows)
    size = np.max(np.abs(np.vstack([before, after])), axis=0)
    moved = np.zeros_like(before)
    moved[np.searchsorted(edges, plant.switch_times)] = np.diff(plant.rest_inputs, axis=0)
    return bool(np.any((np.abs(after - before + moved) > JUMP_TOLERANCE * (size + np.abs(moved)))[:, limited]))


def solve_limited(problem: LimitedProblem, step: float | None) -> LimitedSolution:
    """The best plan within the limits; where no step is stated, with a longer one if the solver gives up at the usual one.

    The longer the step, the better conditioned the equations; what it costs is of the order of the step squared.

    Raises RedesignError where a window of as many steps as are tried is not enough, with the limits that conflict.
    """
    if step is not None:
        return _solve_with(problem, step)
    length = _first_window(problem, None)[2]
    for _ in range(MOST_COARSENINGS):
        try:
            return _solve_with(problem, length)
        except SolverGaveUpError:
            length *= 2
    return _solve_with(problem, length)


def _solve_with(problem: LimitedProblem, step: float) -> LimitedSolution:
    """Window, programme, and instants at which states are limited, until all limits are kept."""
    units, margins, length = _first_window(problem, step)
    task = _transcribe(problem, units, margins, length)
    points = grid_points(task.grid, problem.bounds)
    for _ in range(MOST_ROUNDS):
        program, rows = task.program(points)
        minimum = program.solve()
        if minimum is None:
            wider = _feasible_margins(problem, units, margins, length)
        else:
            z = _exact(program, rows, problem.bounds, minimum.z)
            trajectory = task.trajectory(z)
            wider = _widened(problem, margins, length, trajectory)
        if minimum is None or wider != margins:
            margins = wider
            task = _transcribe(problem, units, margins, length)
            points = grid_points(task.grid, problem.bounds)
            continue
        excess, share = worst_within_steps(trajectory, problem.bounds)
        further = _exceeding(excess, share, problem.bounds)
        if len(further.bound) == 0:
            optimality = measured_optimality(program, z, minimum, task.miss)
            optimality.require()
            size = np.array([bound.size for bound in problem.bounds])[rows.bound]
            overshoot = max(0.0, float(np.max(excess)))
            return LimitedSolution(trajectory, overshoot, length, rows, minimum.of_limits / size, optimality)
        points = points.joined(further)
    raise RedesignError(
        f"the limited redesign did not settle in {MOST_ROUNDS} rounds of widening its window and imposing its limits at further "
        "instants; take a smaller step, or a smoother limit"
    )


def _first_window(problem: LimitedProblem, step: float | None) -> tuple[tuple[Array, Array], tuple[float, float], float]:
    """Units of states and inputs, time [s] before and after the manoeuvre, and the longest step [s]."""
    n, m = problem.plant.n_states, problem.plant.n_inputs
    start, end = problem.reference.manoeuvre
    free = problem.free.trajectory
    edges = free.breakpoints
    per_piece = max(33, SAMPLES // len(edges))
    inner = np.append(np.linspace(edges[:-1], edges[1:], per_piece, endpoint=False, axis=1).ravel(), edges[-1])
    peak = np.max(np.abs(free(inner, free.locate(inner))), axis=0)
    before, after = (tail.decay_time(peak, TAIL_SHARE) for tail in problem.tails)
    times = np.concatenate([np.linspace(start - before, start, SAMPLES), inner, np.linspace(end, end + after, SAMPLES)])
    piece = free.locate(times)
    values, curvature = free(times, piece), free.derivative().derivative()(times, piece, slice(n, n + m))
    peak = np.maximum(peak, np.max(np.abs(values), axis=0))
    units = (_units(peak[:n]), _units(peak[n : n + m]))
    if step is None:
        bend = np.max(np.max(np.abs(curvature), axis=0) / units[1])
        window = times[-1] - times[0]
        smooth = np.sqrt(8 * INTERPOLATION_ERROR / max(bend, np.finfo(float).tiny))
        step = float(min(max(smooth, window / USUAL_MOST_STEPS), COARSER * smooth, window / FEWEST_STEPS))
    before, after = (step * max(10.0, float(np.ceil(margin / step))) for margin in (before, after))  # whole steps: all alike
    margins = (before, after)
    _require_steps(problem, margins, step)
    return units, margins, step


def _units(peak: Array) -> Array:
    """Peaks; where one is but rounding of the others', or nothing moves, the largest."""
    largest = float(np.max(peak))
    return np.where(peak > 1e-9 * largest, peak, largest if largest > 0 else 1.0)


def _require_steps(problem: LimitedProblem, margins: tuple[float, float], step: float) -> None:
    """Raises RedesignError for a window of too many steps."""
    edges = _window_edges(problem, margins)
    steps = int(np.sum(step_counts(edges, step)))
    if steps > MOST_STEPS:
        raise RedesignError(
            f"limits act from {edges[0]:.6g} to {edges[-1]:.6g} s, which takes {steps} steps of {step:.4g} s, more than "
            f"{MOST_STEPS}; take a larger step, or loosen the limits"
        )


def _window_edges(problem: LimitedProblem, margins: tuple[float, float]) -> Array:
    """The breakpoints and, `margins` [s] before and after them, the window's ends."""
    breaks = problem.reference.breakpoints
    return np.concatenate([[breaks[0] - margins[0]], breaks, [breaks[-1] + margins[1]]])


def _transcribe(
    problem: LimitedProblem, units: tuple[Array, Array], margins: tuple[float, float], step: float | Array
) -> Transcription:
    grid = make_grid(problem.plant, problem.reference, problem.free.weights, _window_edges(problem, margins), step)
    return Transcription(grid, problem.tails, problem.free.weights, problem.bounds, *units)


def _feasible_margins(
    problem: LimitedProblem, units: tuple[Array, Array], margins: tuple[float, float], step: float
) -> tuple[float, float]:
    """The first of the doubled windows in which the limits can be kept, tried with as many steps outside the manoeuvre as before.

    Raises RedesignError where there is none, with the limits that conflict.
    """
    steps = np.full(len(problem.reference.breakpoints) + 1, step)
    for _ in range(MOST_DOUBLINGS):
        margins = (2 * margins[0], 2 * margins[1])
        steps[[0, -1]] *= 2
        task = _transcribe(problem, units, margins, steps)
        program, rows = task.program(grid_points(task.grid, problem.bounds))
        if program.solve() is not None:
            _require_steps(problem, margins, step)
            return margins
    raise RedesignError(
        f"the limits cannot all be kept, even with {margins[0]:.4g} s before the manoeuvre and {margins[1]:.4g} s after it: "
        f"{explain(program, rows.bound, problem.bounds)}"
    )


def _widened(problem: LimitedProblem, margins: tuple[float, float], step: float, trajectory: Trajectory) -> tuple[float, float]:
    """Twice the time on each side on which a limit is exceeded in the tail, or acts in the window's step beside it.

    There it would act on the tail's state through the window's end, and the tail would not be what is best beyond it.
    """
    inner = values_between(trajectory, problem.bounds, EDGE_SHARES)[:, [0, -1]]  # (bounds, 2, shares)
    wider = []
    for side, (margin, tail) in enumerate(zip(margins, (trajectory.before, trajectory.after), strict=True)):
        beyond = float(np.max(tail_excess(tail, problem.bounds)))
        beside = max(float(np.max(bound.excess(value[side]))) for bound, value in zip(problem.bounds, inner, strict=True))
        wider.append(2 * margin if beyond > KEPT or beside > -SNAP else margin)
    if wider != list(margins):
        _require_steps(problem, (wider[0], wider[1]), step)
    return wider[0], wider[1]


def _exact(program: QuadraticProgram, rows: LimitRows, bounds: tuple[Bound, ...], z: Array) -> Array:
    """The solver's answer with the plant's equations met to rounding, and inputs and rates that touch their limits on them."""
    firm = np.array([bound.kind != "path" for bound in bounds])[rows.bound]
    return program.nearest(z, firm & (program.h - program.G @ z <= SNAP))


def _exceeding(excess: Array, share: Array, bounds: tuple[Bound, ...]) -> PathPoints:
    """Where a state or an output exceeds its limit, at its worst within each step; excess, share (bounds, steps)."""
    path = np.array([bound.kind == "path" for bound in bounds])
    number, step = np.nonzero((excess > OVERSHOOT) & path[:, None])
    return PathPoints(number, step, share[number, step])
