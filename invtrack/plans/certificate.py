"""Independent check of a planned trajectory: quadrature of its own values against the plant's equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arguments import instance
from invtrack.arrays import Array, real_vector
from invtrack.errors import PlanError
from invtrack.linear.state_sizes import comparable_size, unit_ratios, with_idle_sizes
from invtrack.linear.state_units import own_pace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.windows import windows
from invtrack.references.signal import PiecewiseSignal

WINDOWS_PER_PIECE = 200
"""Windows checked between the ends of a piece at most, spread evenly over it."""

EQUATIONS_PER_PIECE = 20_000
"""Equations checked per piece at most: with more states in fewer windows, though never in fewer than FEWEST_WINDOWS."""

FEWEST_WINDOWS = 40
"""Windows checked per piece of a plant with however many states, where they do not cover it."""

ROUNDING = 32.0
"""How many units in their last place the terms of a state's change may be off: far above all that is left of them nothing is known
better than these."""

ACCURACY = 1e-8
"""Largest residual of a plan, relative to its size, with which it is handed out."""

CANCELLED = 1e-5
"""An output below this share of the terms that it is the sum of is known no better than they are."""

TIME_STEPS = 32.0
"""How many units in their last place times, and what is carried as far, may be off: far out nothing is known better than these."""


@dataclass(frozen=True)
class Certificate:
    """How well a planned trajectory meets its conditions, measured from its values alone, not from how it was found.

    dynamics_residual: largest |x(b) - x(a) - integral of A x + B u| over windows as long as the motion is slow, and over the short
    panels that they are made up of where it is fast, relative to each state's size, less what a state moves in the time by which a
    and b, as numbers, may be off, and less the rounding of the terms of the integral; also how far a state would drift away from
    rest within the manoeuvre's length, by A x + B u there. The size of a state is its peak, or what its terms could move it by
    within half a window, of half a radian of the plant's own at most, if that is more.
    output_error: largest sum of |C x + D u - wanted output| and |planned y - (C x + D u)|, relative to the peak of the wanted
    motion.
    continuity: largest jump of a state at a breakpoint (beyond that of the rest it is measured from), relative to its peak.
    rest_residual: largest distance of a state from rest (or from its bounded particular solution) at the ends of the trajectory,
    relative to its peak.
    """

    dynamics_residual: float
    output_error: float
    continuity: float
    rest_residual: float

    def worst(self, *, exact: bool) -> float:
        """The largest residual of the plan's own equations; y = y_d is one of them if `exact`."""
        return max(self.dynamics_residual, self.continuity, self.output_error if exact else 0.0)

    def require(self, *, exact: bool, method: str) -> None:
        """The last guard: raises PlanError for a plan that misses its own equations by more than ACCURACY, whatever the reason."""
        worst = self.worst(exact=exact)
        if not worst <= ACCURACY:
            raise PlanError(
                f"the plan by {method} is too ill-conditioned to be trusted: it misses its own equations by {worst:.1e} of its "
                f"size ({self}); look for inputs, states or weights in badly chosen units, nearly dependent outputs, or a model in "
                "fewer states"
            )


def certify(model: SwitchedSystem, trajectory: Trajectory, reference: PiecewiseSignal, span: tuple[float, float]) -> Certificate:
    """Residuals of `trajectory` over `span` [s], from its values at off-grid points, one piece at a time.

    `trajectory` and the wanted output `reference` are deviations from the rest of each interval.

    Raises PlanError for what is no such model, trajectory, reference or span.
    """
    for name, value, kind in (("model", model, SwitchedSystem), ("trajectory", trajectory, Trajectory)):
        instance(name, value, kind, expected=f"a {kind.__name__}, as a plan holds it", error=PlanError)
    instance("reference", reference, PiecewiseSignal, expected="a signal", error=PlanError)
    if (trajectory.rows, reference.n_channels) != (model.n_states + model.n_inputs + model.n_outputs, model.n_outputs):
        raise PlanError(
            f"expected a trajectory of [x; u; y] and a reference for {model.n_states} states, {model.n_inputs} inputs and "
            f"{model.n_outputs} outputs, got {trajectory.rows} rows and {reference.n_channels} channels"
        )
    span = tuple(real_vector("span [s]", span, ["start", "end"], error=PlanError).tolist())
    if span[1] <= span[0]:  # at rest throughout: nothing happens in no time, so look on both sides of it
        span = (span[0] - 1.0, span[1] + 1.0)
    paces = np.array(model.map(own_pace))
    per_piece = min(WINDOWS_PER_PIECE, max(FEWEST_WINDOWS, EQUATIONS_PER_PIECE // model.n_states))
    over = windows(trajectory, model.switch_times, paces, span, per_piece)
    starts, ends, piece = over.starts, over.ends, over.piece
    nodes, weights = np.polynomial.legendre.leggauss(10)
    n, m, p = model.n_states, model.n_inputs, model.n_outputs
    times = (starts[:, None] + ends[:, None]) / 2 + (ends - starts)[:, None] / 2 * nodes
    inner = trajectory(times.ravel(), np.repeat(piece, len(nodes))).reshape(len(piece), len(nodes), -1)
    x_start, x_end = (trajectory(times, piece, slice(n)) for times in (starts, ends))
    interval = model.interval((starts + ends) / 2)
    number = model.numbers[interval]
    change, fastest, total = np.empty((len(piece), n)), np.empty((len(piece), n)), np.empty((len(piece), n))
    planned = np.empty((len(piece), len(nodes), p))
    size, unit = np.max(np.abs(inner[:, :, :n]), axis=(0, 1)), 1 / np.maximum(paces[interval], np.finfo(float).tiny)
    for k in np.unique(number).tolist():
        system, chosen = model.distinct[k], number == k
        x, u = inner[chosen, :, :n], inner[chosen, :, n : n + m]
        planned[chosen] = x @ system.C.T + u @ system.D.T
        shares = weights * (ends - starts)[chosen, None] / 2
        change[chosen] = np.einsum("mgi,mg->mi", x @ system.A.T + u @ system.B.T, shares)
        terms = np.abs(x) @ np.abs(system.A).T + np.abs(u) @ np.abs(system.B).T
        total[chosen], fastest[chosen] = np.einsum("mgi,mg->mi", terms, shares), np.max(terms, axis=1)
    # A state that stays zero because large terms cancel is measured against those terms.
    first, last = over.first, over.last
    lengths = (ends[last] - starts[first])[over.owner]
    size = np.maximum(size, np.max(fastest * np.minimum(lengths, unit)[:, None] / 2, axis=0))
    size = comparable_size(size, unit_ratios(model))  # of a plant at rest elsewhere, velocities are rounding
    size = with_idle_sizes(size, np.max(fastest, axis=0), model)
    size = np.where(size > 0, size, 1.0)
    moved = TIME_STEPS * np.spacing(np.maximum(np.abs(starts), np.abs(ends)))[:, None] * np.max(fastest, axis=1, keepdims=True)
    wanted = reference(times.ravel()).reshape(len(piece), len(nodes), p)
    wanted_size = np.max(np.abs(wanted), axis=(0, 1))
    # A channel that is to stay still is measured against what the states could make of it, and so is one in which they cancel.
    possible = np.max([np.abs(system.C) @ np.where(np.isfinite(size), size, 0.0) for system in model.distinct], axis=0)
    wanted_size = np.where(wanted_size > 0, np.maximum(wanted_size, CANCELLED * possible), np.where(possible > 0, possible, 1.0))
    return Certificate(
        dynamics_residual=max(
            _missed(x_end - x_start - change, total, moved, size),
            _missed(
                x_end[last] - x_start[first] - np.add.reduceat(change, first),
                np.add.reduceat(total, first),
                np.maximum.reduceat(moved, first),
                size,
            ),
            _drift(model, trajectory, size),
        ),
        output_error=float(np.max((np.abs(planned - wanted) + np.abs(inner[:, :, n + m :] - planned)) / wanted_size)),
        continuity=_continuity(model, trajectory, size),
        rest_residual=_rest_residual(trajectory, span, size),
    )


def _missed(miss: Array, terms: Array, moved: Array, size: Array) -> float:
    """The largest of what states miss (k, n), less what may be rounding of the terms (k, n) and of times, as a share of size."""
    return float(np.max(np.maximum(np.abs(miss) - ROUNDING * np.finfo(float).eps * terms - moved, 0.0) / size))


def _drift(model: SwitchedSystem, trajectory: Trajectory, size: Array) -> float:
    """How far the states would drift within the manoeuvre's length from the rests that hold before and after it."""
    n, m, found = model.n_states, model.n_inputs, 0.0
    length = trajectory.breakpoints[-1] - trajectory.breakpoints[0]
    for system, tail in ((model.systems[0], trajectory.before), (model.systems[-1], trajectory.after)):
        if tail.holds_still:
            x, u = tail.held[:n], tail.held[n : n + m]
            terms = np.abs(system.A) @ np.abs(x) + np.abs(system.B) @ np.abs(u)
            found = max(found, _missed(length * (system.A @ x + system.B @ u)[None], length * terms[None], np.zeros((1, 1)), size))
    return found


def _continuity(model: SwitchedSystem, trajectory: Trajectory, size: Array) -> float:
    times, n = np.union1d(trajectory.breakpoints, model.switch_times), len(size)
    before, after = (np.searchsorted(trajectory.breakpoints, times, side=side) for side in ("left", "right"))
    left, right = (trajectory(times, piece, slice(n)) for piece in (before, after))
    shifts = np.zeros((len(times), n))
    shifts[np.searchsorted(times, model.switch_times)] = model.shifts
    return float(np.max(np.abs(right - left - shifts) / size))


def _rest_residual(trajectory: Trajectory, span: tuple[float, float], size: Array) -> float:
    """How much the states still change from the span's ends on outward, over ten times its length; infinite if they explode."""
    length = span[1] - span[0]
    times = np.array([span[0], span[0] - 10 * length, span[1], span[1] + 10 * length])
    last = len(trajectory.breakpoints)
    with np.errstate(over="ignore", invalid="ignore"):  # an endless reference that grows leaves the range of numbers out there
        x = trajectory(times, np.array([0, 0, last, last]))[:, : len(size)]
        change = float(np.max(np.abs(x[[0, 2]] - x[[1, 3]]) / size))
    return np.inf if np.isnan(change) else change
