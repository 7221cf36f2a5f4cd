"""Independent check of a plan on a nonlinear motion: replayed by the plant's own simulator, and judged by its values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.shooting import ElementChain, Motion
from invtrack.linear.state_sizes import comparable_size, unit_ratios
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.certificate import Certificate
from invtrack.plans.plan import intervals_of_pieces
from invtrack.plans.runge_kutta import CLASSICAL
from invtrack.plans.trajectory import Trajectory
from invtrack.references.signal import PiecewiseSignal

MOST_STEPS = 6000
"""Steps of the replay, in all: so many elements are replayed, spread evenly over the motion, and those beside breakpoints."""


MARGIN, MOST_SHORTER = 0.3, 8
"""Share of the accuracy that a replay in shorter steps is to reach, and how much shorter they become at once, at most."""

FALLING = 4.0
"""By how much a residual must fall when steps become shorter for these to have been to blame."""


@dataclass(frozen=True)
class MotionChecks:
    """What a plan on a nonlinear motion is judged by, beside its certificate.

    Args:
        rest_residual: what is left of rates and outputs at the equilibria, as a share of their terms.
        gap: smallest |log |lambda|| of the multipliers of an element at rest that stand for no zero: how fast errors of the mesh
            die out from element to element.
        decoupling: smallest ratio of B_y along the motion to that at its start, in any direction (the smallest |eigenvalue| of
            B_y(start)^-1 B_y); None without a vector relative degree.
        input_jump: largest jump of an input between elements away from breakpoints, as a share of that input's range.
        elements: how many there are.
    """

    rest_residual: float
    gap: float
    decoupling: float | None
    input_jump: float
    elements: int


def certify_motion(
    shooting: ElementChain,
    motion: Motion,
    trajectory: Trajectory,
    model: SwitchedSystem,
    reference: PiecewiseSignal,
    accuracy: float,
) -> Certificate:
    """Residuals of a plan, from its values and a replay of its inputs by the plant's own simulator.

    Elements start in the plan's states and are driven by its inputs. dynamics_residual: how far they are then from the plan's
    states, on the way and at the end, as a share of their peaks; output_error: their outputs less those wanted, and less those
    planned; continuity: jumps of the plan's states at its breakpoints; rest_residual: what is held outside the window but is not at
    rest, by its rates of change.

    A held input is planned for the steps of its hold, and replayed in these. A continuous one must not depend on them: where a
    dynamics_residual may be the replay's own error, of fourth order, it is repeated in shorter steps as long as that makes it fall.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        trajectory: what the plan says.
        model: whose rests the trajectory's values count from.
        reference: the wanted outputs, absolute.
        accuracy: residuals below this are small enough.
    """
    held = shooting.scheme.count == 1
    steps = shooting.scheme.steps if held else shooting.scheme.steps * 3 // 2
    found = _replayed(shooting, motion, trajectory, model, reference, steps)
    while not held and accuracy < found.dynamics_residual < np.inf:
        shorter = int(np.ceil((found.dynamics_residual / (MARGIN * accuracy)) ** (1 / CLASSICAL.order)))
        steps *= min(max(2, shorter), MOST_SHORTER)
        before, found = found, _replayed(shooting, motion, trajectory, model, reference, steps)
        if not found.dynamics_residual < before.dynamics_residual / FALLING:
            break
    return found


def _replayed(
    shooting: ElementChain, motion: Motion, trajectory: Trajectory, model: SwitchedSystem, reference: PiecewiseSignal, steps: int
) -> Certificate:
    """The same by a replay in so many steps on each element.

    Args:
        shooting, motion, trajectory, model, reference: see `certify_motion`.
        steps: on each element.
    """
    mesh, n, m = shooting.mesh, model.n_states, model.n_inputs
    even = np.linspace(0, len(mesh) - 1, min(max(1, MOST_STEPS // steps), len(mesh))).astype(np.intp)
    chosen = np.union1d(even, mesh.beside(reference.breakpoints))
    shares = np.arange(1, steps + 1) / steps
    times = np.minimum(mesh.edges[chosen, None] + mesh.lengths[chosen, None] * shares, mesh.edges[chosen + 1, None])
    inside = np.repeat((mesh.edges[chosen] + mesh.edges[chosen + 1]) / 2, steps)
    wanted = reference(times.ravel(), inside=inside).reshape(len(chosen), steps, -1)
    before = np.searchsorted(trajectory.breakpoints, times.ravel(), side="left")  # the piece that ends in a breakpoint
    planned = trajectory(times.ravel(), before).reshape(len(chosen), steps, -1)
    interval = intervals_of_pieces(model, mesh.edges)[chosen + 1]
    x = planned[:, :, :n] + model.rest_states[interval][:, None]
    y = planned[:, :, n + m :] + model.rest_outputs[interval][:, None]
    size = state_sizes(shooting, motion, model)
    defect, missed = 0.0, 0.0
    for k in np.unique(mesh.interval[chosen]):
        here = mesh.interval[chosen] == k
        numbers, dynamics = chosen[here], shooting.dynamics[k]
        points, outputs = dynamics.replay(motion.points[numbers], motion.coefficients[numbers], mesh.lengths[numbers], steps)
        states = dynamics.states(points.reshape(-1, points.shape[2])).reshape(len(numbers), steps, n)
        defect = max(defect, float(np.max(np.abs(states - x[here]) / size)))
        for other in (wanted[here], y[here]):
            missed = max(missed, float(np.max(np.abs(dynamics.output_difference(outputs, other)) / shooting.motion_size)))
    return Certificate(defect, missed, _continuity(trajectory, model, size), _unrest(trajectory, model, size))


def state_sizes(shooting: ElementChain, motion: Motion, model: SwitchedSystem) -> Array:
    """Peaks of the plan's states (n,), those that hardly move by what comparable ones make of them."""
    states = shooting.dynamics[0].states(motion.points) - model.rest_states[0]
    peaks = comparable_size(np.max(np.abs(states), axis=0), unit_ratios(model))
    return np.where(peaks > 0, peaks, 1.0)


def input_jump(mesh: Mesh, trajectory: Trajectory, model: SwitchedSystem, stops: Array) -> float:
    """Largest jump of an input between two elements, but at the stops [s], as a share of the input's range."""
    inner = mesh.edges[1:-1]
    smooth = ~np.isin(inner, stops)
    rows = slice(model.n_states, model.n_states + model.n_inputs)
    interval = intervals_of_pieces(model, trajectory.breakpoints)

    def at(piece: Indices) -> Array:
        return np.asarray(trajectory(inner, piece, rows) + model.rest_inputs[interval[piece]])

    left, right = (at(np.searchsorted(trajectory.breakpoints, inner, side=side)) for side in ("left", "right"))
    span = np.ptp(np.vstack([left, right]), axis=0)
    jumps = np.abs(right - left)[smooth] / np.where(span > 0, span, 1.0)
    return float(np.max(jumps, initial=0.0))


def _continuity(trajectory: Trajectory, model: SwitchedSystem, size: Array) -> float:
    edges, n = trajectory.breakpoints, len(size)
    pieces = np.arange(len(edges))
    rest = model.rest_states[intervals_of_pieces(model, edges)]
    left, right = (trajectory(edges, side)[:, :n] + rest[side] for side in (pieces, pieces + 1))
    return float(np.max(np.abs(right - left) / size))


def _unrest(trajectory: Trajectory, model: SwitchedSystem, size: Array) -> float:
    """What the tails hold, but is not at rest: its rates of change, as shares of what states of full size would make of them."""
    n, worst = len(size), 0.0
    for tail, system in ((trajectory.before, model.systems[0]), (trajectory.after, model.systems[-1])):
        rates, terms = np.abs(system.A @ tail.held[:n]), np.abs(system.A) @ size
        worst = max(worst, float(np.max(rates / np.where(terms > 0, terms, 1.0))))
    return worst
