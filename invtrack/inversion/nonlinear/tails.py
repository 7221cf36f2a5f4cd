"""Tails of a motion: how its linear model leaves rest before the first node, and comes back to it after the last one."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.axis_zeros import split_through_axis
from invtrack.inversion.inverse_system import inverse_systems
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.shooting import Motion
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.tail import Side, Tail

CUT = 1e-10
"""Singular values of a tail's directions below this share of the largest are none."""


def linear_tail(model: StateSpace, away: Array, size: Array, side: Side) -> Tail:
    """[x; u; y] outside the window, as deviations from rest, with the output held.

    What of the distance from rest lies in the antistable (before) or stable (after) internal dynamics dies out along them; what
    does not, such as where a vehicle that may stand anywhere comes to rest, is held.

    Args:
        model: the linear model at that end.
        away: the state's distance from rest at the edge of the window (n,).
        size: peaks of the states, in which distances count (n,).
        side: of the motion.
    """
    plant = as_switched(model)
    (inverse,) = inverse_systems(plant, split_through_axis(plant))
    n = model.n_states
    if side == "before":
        part, A = inverse.system.backward, -inverse.system.backward.A
        X = part.X
    else:
        decaying = inverse.system.decaying
        part = inverse.system.forward
        A, X = part.A[:decaying, :decaying], part.X[:, :decaying]
    v = np.zeros(0)
    if X.shape[1]:
        v = np.asarray(np.linalg.lstsq(X[:n] / size[:, None], away / size, rcond=CUT)[0], dtype=float)
    held = np.zeros(len(part.X))
    held[:n] = away - X[:n] @ v
    return Tail(
        direction=-1 if side == "before" else 1,
        departure=Propagator(A),
        X=X,
        v=v,
        S=np.zeros((1, 1)),
        X_w=held[:, np.newaxis],
        w=np.ones(1),
    )


def tail_error(dynamics: Dynamics, point: Array, tail: Tail, model: StateSpace, sizes: tuple[Array, Array]) -> float:
    """How far a linear tail is from the plant's equations at the edge of the window, where it is furthest from rest.

    The larger of the outputs' distance from those held, as a share of their motion, and what the states' rates are off, within
    the tail's own time, as a share of the states' peaks; it falls with the square of the distance from rest.

    Args:
        dynamics: of the plant there.
        point: at the edge (.,).
        tail: that begins in it.
        model: the linear model of that end.
        sizes: of states (n,) and outputs (p,).
    """
    if not tail.departs:
        return 0.0
    n, m = model.n_states, model.n_inputs
    inputs = (model.operating_point.u0 + tail.X[n : n + m] @ tail.v)[None]
    rates, outputs = dynamics.evaluate(point[None], inputs)
    away = np.abs(dynamics.output_difference(outputs[0], model.operating_point.y0)) / sizes[1]
    planned = tail.direction * tail.X[:n] @ (tail.departure.M @ tail.v)
    off = np.abs(dynamics.state_rates(point[None], rates)[0] - planned) / sizes[0] / abs(tail.departure.growth)
    return float(max(np.max(away), np.max(off)))


def tails_of(problem: MotionProblem, motion: Motion, model: SwitchedSystem, size: Array) -> tuple[Tail, Tail]:
    """The linear tails before and after a motion.

    Args:
        problem: whose linear models they follow.
        motion: whose first and last nodes they begin in.
        model: whose rests the plan's values count from.
        size: peaks of the states (n,).
    """
    away = problem.dynamics[0].states(motion.points[[0, -1]]) - model.rest_states[[0, -1]]
    first, last = problem.linear_models[0], problem.linear_models[-1]
    return linear_tail(first, away[0], size, "before"), linear_tail(last, away[1], size, "after")
