"""Independent check of a planned trajectory: quadrature of its own values against the plant's equations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arguments import instance
from invtrack.arrays import Array, Indices, real_vector
from invtrack.errors import PlanError
from invtrack.linear.state_sizes import comparable_size, unit_ratios, with_idle_sizes
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.trajectory import Trajectory
from invtrack.references.signal import PiecewiseSignal

PANEL_ANGLE = 1.0
"""Largest panel length times the norm of a piece's fastest dynamics; 10 Gauss points are then exact to rounding."""

PANELS_PER_PIECE = 200
"""Panels checked per piece at most, spread evenly over it, its ends among them."""

EQUATIONS_PER_PIECE = 20_000
"""Equations checked per piece at most: with more states on fewer panels, though never on fewer than FEWEST_PANELS."""

FEWEST_PANELS = 40
"""Panels checked per piece of a plant with however many states, where its dynamics are so fast that these do not cover it."""

ACCURACY = 1e-8
"""Largest residual of a plan, relative to its size, with which it is handed out."""

CANCELLED = 1e-5
"""An output below this share of the terms that it is the sum of is known no better than they are."""

TIME_STEPS = 32.0
"""How many units in their last place times, and what is carried as far, may be off: far out nothing is known better than these."""

TOTAL_PANELS = 20_000
"""Panels checked in all, at most; beyond, pieces are skipped evenly."""


@dataclass(frozen=True)
class Certificate:
    """How well a planned trajectory meets its conditions, measured from its values alone, not from how it was found.

    dynamics_residual: largest |x(b) - x(a) - integral of A x + B u| over panels, relative to each state's peak, less what a state
    moves in the time by which a and b, as numbers, may be off.
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
    panels_per_piece = min(PANELS_PER_PIECE, max(FEWEST_PANELS, EQUATIONS_PER_PIECE // model.n_states))
    starts, ends, piece = _panels(trajectory, model.switch_times, span, panels_per_piece)
    nodes, weights = np.polynomial.legendre.leggauss(10)
    n, m, p = model.n_states, model.n_inputs, model.n_outputs
    times = (starts[:, None] + ends[:, None]) / 2 + (ends - starts)[:, None] / 2 * nodes
    inner = trajectory(times.ravel(), np.repeat(piece, len(nodes))).reshape(len(piece), len(nodes), -1)
    x_start, x_end = (trajectory(times, piece, slice(n)) for times in (starts, ends))
    number = model.numbers[model.interval((starts + ends) / 2)]
    change, moved = np.empty((len(piece), n)), np.empty((len(piece), n))
    resolution = TIME_STEPS * np.spacing(np.maximum(np.abs(starts), np.abs(ends)))
    planned = np.empty((len(piece), len(nodes), p))
    size, rate = np.max(np.abs(inner[:, :, :n]), axis=(0, 1)), np.zeros(n)
    for k in np.unique(number).tolist():
        system, chosen = model.distinct[k], number == k
        x, u = inner[chosen, :, :n], inner[chosen, :, n : n + m]
        planned[chosen] = x @ system.C.T + u @ system.D.T
        half = (ends - starts)[chosen, None] / 2
        change[chosen] = np.einsum("mgi,g->mi", x @ system.A.T + u @ system.B.T, weights) * half
        # A state that stays zero because large terms cancel is measured against those terms.
        terms = np.abs(x) @ np.abs(system.A).T + np.abs(u) @ np.abs(system.B).T
        moved[chosen] = resolution[chosen, None] * np.max(terms, axis=1)
        size, rate = np.maximum(size, np.max(terms * half[:, :, None], axis=(0, 1))), np.maximum(rate, np.max(terms, axis=(0, 1)))
    size = comparable_size(size, unit_ratios(model))  # of a plant at rest elsewhere, velocities are rounding
    size = with_idle_sizes(size, rate, model)
    size = np.where(size > 0, size, 1.0)
    wanted = reference(times.ravel()).reshape(len(piece), len(nodes), p)
    wanted_size = np.max(np.abs(wanted), axis=(0, 1))
    # A channel that is to stay still is measured against what the states could make of it, and so is one in which they cancel.
    possible = np.max([np.abs(system.C) @ np.where(np.isfinite(size), size, 0.0) for system in model.distinct], axis=0)
    wanted_size = np.where(wanted_size > 0, np.maximum(wanted_size, CANCELLED * possible), np.where(possible > 0, possible, 1.0))
    return Certificate(
        dynamics_residual=float(np.max(np.maximum(np.abs(x_end - x_start - change) - moved, 0.0) / size)),
        output_error=float(np.max((np.abs(planned - wanted) + np.abs(inner[:, :, n + m :] - planned)) / wanted_size)),
        continuity=_continuity(model, trajectory, size),
        rest_residual=_rest_residual(trajectory, span, size),
    )


def _panels(trajectory: Trajectory, switch_times: Array, span: tuple[float, float], per_piece: int) -> tuple[Array, Array, Indices]:
    """Starts, ends and pieces of the panels, `per_piece` at most, none of which crosses a breakpoint or a switch time."""
    inner = trajectory.breakpoints
    first, last = min(span[0], inner[0]), max(span[1], inner[-1])
    edges = np.concatenate([[first], np.union1d(inner, switch_times[(switch_times > first) & (switch_times < last)]), [last]])
    piece = trajectory.locate((edges[:-1] + edges[1:]) / 2)
    fastest = trajectory.paces()
    stride = max(1, len(piece) // (TOTAL_PANELS // 10))
    starts, ends, owners = [], [], []
    for j in range(0, len(edges) - 1, stride):
        length = edges[j + 1] - edges[j]
        if length <= 0:
            continue
        panel = min(length, PANEL_ANGLE / max(float(fastest[piece[j]]), np.finfo(float).tiny))
        count = int(min(np.ceil(length / panel), per_piece))
        first = edges[j] + (length - panel) * np.linspace(0.0, 1.0, count)
        starts.append(first)
        ends.append(np.minimum(first + panel, edges[j + 1]))
        owners.append(np.full(count, piece[j]))
    return np.concatenate(starts), np.concatenate(ends), np.concatenate(owners)


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
