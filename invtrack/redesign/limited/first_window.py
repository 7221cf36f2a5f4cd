"""What is to be planned within limits, and the window and step to begin with."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import RedesignError
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.ends import decay_time
from invtrack.plans.plan import TwoSidedTrajectory
from invtrack.redesign.limited.discretization import step_counts
from invtrack.redesign.limited.limit_check import differentiated
from invtrack.redesign.limited.tails import Tail
from invtrack.redesign.limits import Bound
from invtrack.redesign.weights import Weights
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

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


@dataclass(frozen=True, eq=False)
class LimitedProblem:
    """What is to be planned: reference as deviation with breakpoints at all jumps, limits, and the optimum without them.

    tails: before and after; v: what they are without limits.
    """

    plant: SwitchedSystem
    reference: PiecewiseSignal
    weights: Weights
    bounds: tuple[Bound, ...]
    free: TwoSidedTrajectory
    tails: tuple[Tail, Tail]
    v: tuple[Array, Array]


def first_window(problem: LimitedProblem, step: float | None) -> tuple[tuple[Array, Array], tuple[float, float], float]:
    """Units of states and inputs, time [s] before and after the manoeuvre, and the longest step [s]."""
    n, p = problem.plant.n_states, problem.plant.n_channels
    start, end = problem.reference.manoeuvre
    edges = problem.free.breakpoints
    per_piece = max(33, SAMPLES // len(edges))
    inner = np.append(np.linspace(edges[:-1], edges[1:], per_piece, endpoint=False, axis=1).ravel(), edges[-1])
    piece = problem.free.locate(inner)
    peak = np.max(np.abs(problem.free(inner, piece)), axis=0)
    before, after = (decay_time(tail.departure(v), peak, TAIL_SHARE) for tail, v in zip(problem.tails, problem.v, strict=True))
    times = np.concatenate([np.linspace(start - before, start, SAMPLES), inner, np.linspace(end, end + after, SAMPLES)])
    piece = problem.free.locate(times)
    first = differentiated(problem.free)
    values, curvature = problem.free(times, piece), differentiated(first)(times, piece)[:, n : n + p]
    peak = np.maximum(peak, np.max(np.abs(values), axis=0))
    units = (_units(peak[:n]), _units(peak[n : n + p]))
    if step is None:
        bend = np.max(np.max(np.abs(curvature), axis=0) / units[1])
        window = times[-1] - times[0]
        smooth = np.sqrt(8 * INTERPOLATION_ERROR / max(bend, np.finfo(float).tiny))
        step = float(min(max(smooth, window / USUAL_MOST_STEPS), COARSER * smooth, window / FEWEST_STEPS))
    before, after = (step * max(10.0, float(np.ceil(margin / step))) for margin in (before, after))  # whole steps: all alike
    margins = (before, after)
    require_steps(problem, margins, step)
    return units, margins, step


def _units(peak: Array) -> Array:
    """Peaks; where one is but rounding of the others', or nothing moves, the largest."""
    largest = float(np.max(peak))
    return np.where(peak > 1e-9 * largest, peak, largest if largest > 0 else 1.0)


def require_steps(problem: LimitedProblem, margins: tuple[float, float], step: float) -> None:
    """Raises RedesignError for a window of too many steps."""
    edges = window_edges(problem, margins)
    steps = int(np.sum(step_counts(edges, step)))
    if steps > MOST_STEPS:
        raise RedesignError(
            f"limits act from {edges[0]:.6g} to {edges[-1]:.6g} s, which takes {steps} steps of {step:.4g} s, more than "
            f"{MOST_STEPS}; take a larger step, or loosen the limits"
        )


def window_edges(problem: LimitedProblem, margins: tuple[float, float]) -> Array:
    """The breakpoints and, `margins` [s] before and after them, the window's ends."""
    breaks = problem.reference.breakpoints
    return np.concatenate([[breaks[0] - margins[0]], breaks, [breaks[-1] + margins[1]]])
