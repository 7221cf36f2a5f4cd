"""Linear-quadratic regulators: for each interval of a linear plant by itself, and along a plan on a nonlinear motion."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_weight
from invtrack.control.gains import GainsAlong, GainSchedule, per_interval
from invtrack.control.riccati_along import riccati_along
from invtrack.errors import ControlError
from invtrack.linear.mode_groups import listed, unmoved_modes, unseen_modes
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.linearizations import Linearizations
from invtrack.plans.plan import Plan

ROUNDING = 1e-6
"""A closed-loop pole that decays by less than this share of the fastest one may be a double one on the imaginary axis, rounded."""

WEIGHED = 1e-12
"""An eigenvalue of Q, once its diagonal is scaled to one, weighs nothing below this share of the largest."""

STRETCHED = 1.5
"""Before the motion stretches grow by this factor from one to the next, as gains settle to those of the start."""


def lqr(model: Any, *, Q: ArrayLike, R: ArrayLike) -> GainSchedule:
    """Gains that minimise the integral of x'Q x + u'R u on each interval by itself: K = R^-1 B'X, A'X + X A - X B R^-1 B'X + Q = 0.

    Q (n, n) positive semidefinite, R (m, m) positive definite, in the units of states and inputs: an entry of Q weighs a radian
    squared against a metre squared. A number stands for that multiple of the identity, which weighs one unit of each state alike;
    where units differ, `bryson` makes weights from the largest deviations that are acceptable.

    Of a plan on a nonlinear motion, as `invert(plant, reference)` returns it, these are the gains along the motion, which minimise
    the integral from any time on for departures from the plan: K(t) = R^-1 B(t)'X(t), -X' = A'X + X A - X B R^-1 B'X + Q, backward
    from the stationary X at rest after the motion. Of any other plan they are those of its model.

    Raises ControlError for weights of the wrong shape or sign, and for a plant that cannot be stabilized: the message names the
    modes that no input moves, or that Q does not weigh, and the states that take part in them.
    """
    along = model.linearizations if isinstance(model, Plan) else None
    plant = as_switched(model.model if isinstance(model, Plan) else model)
    n, m = plant.n_states, plant.n_inputs
    state_weight = real_weight("Q", Q, n, meaning=f"states {list(plant.states.names)}", error=ControlError)
    input_weight = real_weight("R", R, m, meaning=f"inputs {list(plant.inputs.names)}", definite=True, error=ControlError)

    def gain(system: StateSpace) -> Array:
        return _stationary(system, state_weight, input_weight)[1]

    if along is None:
        return per_interval(plant, gain)
    first, last = (
        _at_end(side, system, state_weight, input_weight)
        for side, system in (("before", plant.systems[0]), ("after", plant.systems[-1]))
    )
    stretches = _with_approach(along, plant, model.start)
    inner = riccati_along(stretches, state_weight, input_weight, last[0])
    return GainsAlong([first[1], *inner, last[1]], stretches.edges)


def _at_end(side: str, system: StateSpace, Q: Array, R: Array) -> tuple[Array, Array]:
    try:
        return _stationary(system, Q, R)
    except ControlError as error:
        raise ControlError(f"at rest {side} the motion: {error}") from error


def _with_approach(along: Linearizations, plant: SwitchedSystem, start: float) -> Linearizations:
    """The same with stretches of rest in front, back to the start [s] of the plan."""
    edges = [float(along.edges[0])]
    length = float(along.lengths[0])
    while edges[-1] > start:
        edges.append(edges[-1] - length)
        length *= STRETCHED
    more, rest = len(edges) - 1, plant.systems[0]
    A, B = (np.repeat(matrix[None], more, axis=0) for matrix in (rest.A, rest.B))
    return Linearizations(np.concatenate([edges[:0:-1], along.edges]), np.concatenate([A, along.A]), np.concatenate([B, along.B]))


def _stationary(system: StateSpace, Q: Array, R: Array) -> tuple[Array, Array]:
    """X (n, n) and the gain K (m, n) of least cost; raises ControlError where there is none."""
    try:
        X = np.asarray(scipy.linalg.solve_continuous_are(system.A, system.B, Q, R))
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ControlError(f"no LQR gain: {_obstacle(system, Q) or error}") from error
    K = np.asarray(np.linalg.solve(R, system.B.T @ X))
    poles = np.linalg.eigvals(system.A - system.B @ K)
    reason = _obstacle(system, Q) if np.any(poles.real >= -ROUNDING * np.max(np.abs(poles))) else ""
    if reason:
        raise ControlError(f"no LQR gain: {reason}")
    if np.any(poles.real >= 0):
        raise ControlError(
            f"the LQR gain does not stabilize the plant: closed-loop poles {np.round(poles, 6).tolist()}; the weights of some "
            "states or inputs may differ by too many orders of magnitude"
        )
    return X, K


def _obstacle(system: StateSpace, Q: Array) -> str:
    """Why no gain of least cost stabilizes the plant, "" where nothing is found."""
    unmoved = [group for group in unmoved_modes(system) if group.side >= 0]
    if unmoved:
        return (
            f"the inputs {list(system.inputs.names)} do not move {listed(unmoved)}, on or right of the imaginary axis, so no "
            "feedback stabilizes the plant; add an input that acts on these states, or leave them out of the model where nothing "
            "disturbs them"
        )
    unweighed = [group for group in unseen_modes(_weighed(system, Q)) if group.side == 0]
    if unweighed:
        return (
            f"Q does not weigh {listed(unweighed)}, on the imaginary axis, so least cost leaves it as it is; give Q an entry for "
            "one of these states, however small"
        )
    return ""


def _weighed(system: StateSpace, Q: Array) -> StateSpace:
    """The plant with outputs z for which z'z = x'Q x."""
    size = np.sqrt(np.where(np.diag(Q) > 0, np.diag(Q), 1.0))
    values, vectors = np.linalg.eigh(Q / np.outer(size, size))
    factor = np.sqrt(np.maximum(values, 0.0))[:, None] * vectors.T * size
    shown = values > WEIGHED * max(np.max(values), 0.0)
    return StateSpace(system.A, system.B, factor[shown] if np.any(shown) else np.zeros((1, len(Q))), states=system.states)
