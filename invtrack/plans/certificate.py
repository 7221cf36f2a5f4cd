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
from invtrack.plans.windows import Windows, windows
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


NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)


@dataclass(frozen=True)
class Certificate:
    """How well a planned trajectory meets its conditions, measured from its values alone, not from how it was found.

    dynamics_residual: largest |x(b) - x(a) - integral of A x + B u| over windows as long as the motion is slow, and over the short
    panels that they are made up of where it is fast, relative to each state's size, less what a state moves in the time by which a
    and b, as numbers, may be off, and less the rounding of the terms of the integral; also how far a state would drift away from
    rest within the manoeuvre's length, by A x + B u there, but for its own damping. The size of a state is its peak, or what its
    terms could move it by within half a window, of half a radian of the plant's own at most, if that is more.
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
    per_piece = min(WINDOWS_PER_PIECE, max(FEWEST_WINDOWS, EQUATIONS_PER_PIECE // model.n_states))
    over = windows(trajectory, model.switch_times, np.array(model.map(own_pace)), span, per_piece)
    found = _Integrated.over(model, trajectory, over)
    size = found.state_sizes(model)
    return Certificate(
        dynamics_residual=max(found.missed(size), _drift(model, trajectory, size)),
        output_error=found.output_error(model, reference, size),
        continuity=_continuity(model, trajectory, size),
        rest_residual=rest_residual(trajectory, span, size),
    )


@dataclass(frozen=True, eq=False)
class _Integrated:
    """The plant's equations along a trajectory, integrated over panels.

    Args:
        windows: of panels.
        times: Gauss points (k, 10) [s].
        change: x at the end of each panel less x at its start (k, n).
        rates, terms: integrals of A x + B u, and of |A| |x| + |B| |u|, over each (k, n).
        fastest: the latter at its largest within each (k, n).
        peaks: of the states (n,).
        left: what each window's x at its end differs by from that at its start (w, n).
        outputs, claimed: C x + D u, and the trajectory's own y (k, 10, p).
    """

    windows: Windows
    times: Array
    change: Array
    rates: Array
    terms: Array
    fastest: Array
    peaks: Array
    left: Array
    outputs: Array
    claimed: Array

    @classmethod
    def over(cls, model: SwitchedSystem, trajectory: Trajectory, windows: Windows) -> _Integrated:
        """Along a trajectory over all of its windows."""
        n, m = model.n_states, model.n_inputs
        starts, ends, piece = windows.starts, windows.ends, windows.piece
        half, middle = (ends - starts) / 2, (starts + ends) / 2
        times = middle[:, None] + half[:, None] * NODES
        values = trajectory(times.ravel(), np.repeat(piece, len(NODES))).reshape(*times.shape, -1)
        x_start, x_end = (trajectory(edges, piece, slice(n)) for edges in (starts, ends))
        rates, terms, fastest = (np.empty((len(piece), n)) for _ in range(3))
        outputs, number = np.empty((*times.shape, model.n_outputs)), model.numbers[model.interval(middle)]
        for k in np.unique(number).tolist():
            system, chosen = model.distinct[k], number == k
            x, u = values[chosen, :, :n], values[chosen, :, n : n + m]
            outputs[chosen] = x @ system.C.T + u @ system.D.T
            sizes = np.abs(x) @ np.abs(system.A).T + np.abs(u) @ np.abs(system.B).T
            shares = WEIGHTS * half[chosen, None]
            rates[chosen] = np.einsum("kgi,kg->ki", x @ system.A.T + u @ system.B.T, shares)
            terms[chosen], fastest[chosen] = np.einsum("kgi,kg->ki", sizes, shares), np.max(sizes, axis=1)
        return cls(
            windows=windows,
            times=times,
            change=x_end - x_start,
            rates=rates,
            terms=terms,
            fastest=fastest,
            peaks=np.max(np.abs(values[:, :, :n]), axis=(0, 1)),
            left=x_end[windows.last] - x_start[windows.first],
            outputs=outputs,
            claimed=values[:, :, n + m :],
        )

    def state_sizes(self, model: SwitchedSystem) -> Array:
        """What each state is to be measured against (n,): that of one that stays zero because large terms cancel is theirs."""
        starts, ends = self.windows.starts, self.windows.ends
        lengths = (ends[self.windows.last] - starts[self.windows.first])[self.windows.owner]
        radian = 1 / np.maximum(np.array(model.map(own_pace))[model.interval((starts + ends) / 2)], np.finfo(float).tiny)
        size = np.maximum(self.peaks, np.max(self.fastest * np.minimum(lengths, radian)[:, None] / 2, axis=0))
        size = comparable_size(size, unit_ratios(model))  # of a plant at rest elsewhere, velocities are rounding
        size = with_idle_sizes(size, np.max(self.fastest, axis=0), model)
        return np.where(size > 0, size, 1.0)

    def missed(self, size: Array) -> float:
        """The largest share of their size (n,) that states miss over a panel, or over a window."""
        first, ends = self.windows.first, np.maximum(np.abs(self.windows.starts), np.abs(self.windows.ends))
        moved = TIME_STEPS * np.spacing(ends)[:, None] * self.fastest
        rates, terms = np.add.reduceat(self.rates, first), np.add.reduceat(self.terms, first)
        return max(
            _missed(self.change - self.rates, self.terms, moved, size),
            _missed(self.left - rates, terms, np.maximum.reduceat(moved, first), size),
        )

    def output_error(self, model: SwitchedSystem, reference: PiecewiseSignal, size: Array) -> float:
        """Largest distance of C x + D u from the wanted output and from the trajectory's own; size (n,) of the states."""
        wanted = reference(self.times.ravel()).reshape(self.outputs.shape)
        asked = np.max(np.abs(wanted), axis=(0, 1))
        # A channel that is to stay still is measured against what the states could make of it, and so is one in which they cancel.
        possible = np.max([np.abs(system.C) @ np.where(np.isfinite(size), size, 0.0) for system in model.distinct], axis=0)
        against = np.where(asked > 0, np.maximum(asked, CANCELLED * possible), np.where(possible > 0, possible, 1.0))
        return float(np.max((np.abs(self.outputs - wanted) + np.abs(self.claimed - self.outputs)) / against))


def _missed(miss: Array, terms: Array, moved: Array, size: Array) -> float:
    """The largest of what states miss (k, n), less what may be rounding of the terms (k, n) and of times, as a share of size."""
    return float(np.max(np.maximum(np.abs(miss) - ROUNDING * np.finfo(float).eps * terms - moved, 0.0) / size))


def _drift(model: SwitchedSystem, trajectory: Trajectory, size: Array) -> float:
    """How far the states would drift from the rests before and after the manoeuvre within its length, but for their own damping."""
    n, m, found = model.n_states, model.n_inputs, 0.0
    length = trajectory.breakpoints[-1] - trajectory.breakpoints[0]
    for system, tail in ((model.systems[0], trajectory.before), (model.systems[-1], trajectory.after)):
        if tail.holds_still and length > 0:
            x, u = tail.held[:n], tail.held[n : n + m]
            lasting = 1 / (1 / length + np.maximum(-np.diag(system.A), 0.0))
            rate, terms = system.A @ x + system.B @ u, np.abs(system.A) @ np.abs(x) + np.abs(system.B) @ np.abs(u)
            found = max(found, _missed((lasting * rate)[None], (lasting * terms)[None], np.zeros((1, 1)), size))
    return found


def _continuity(model: SwitchedSystem, trajectory: Trajectory, size: Array) -> float:
    times, n = np.union1d(trajectory.breakpoints, model.switch_times), len(size)
    before, after = (np.searchsorted(trajectory.breakpoints, times, side=side) for side in ("left", "right"))
    left, right = (trajectory(times, piece, slice(n)) for piece in (before, after))
    shifts = np.zeros((len(times), n))
    shifts[np.searchsorted(times, model.switch_times)] = model.shifts
    return float(np.max(np.abs(right - left - shifts) / size))


def rest_residual(trajectory: Trajectory, span: tuple[float, float], size: Array) -> float:
    """How much the states still change from the span's ends on outward, over ten times its length; infinite if they explode."""
    length = span[1] - span[0]
    times = np.array([span[0], span[0] - 10 * length, span[1], span[1] + 10 * length])
    last = len(trajectory.breakpoints)
    with np.errstate(over="ignore", invalid="ignore"):  # an endless reference that grows leaves the range of numbers out there
        x = trajectory(times, np.array([0, 0, last, last]))[:, : len(size)]
        change = float(np.max(np.abs(x[[0, 2]] - x[[1, 3]]) / size))
    return np.inf if np.isnan(change) else change
