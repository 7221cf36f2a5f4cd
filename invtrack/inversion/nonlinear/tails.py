"""Tails of a motion: how it leaves rest before the first node, and comes back to it after the last one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.nonlinear.ends import Departure
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.inversion.nonlinear.shooting import Motion, Shooting
from invtrack.inversion.nonlinear.transfer import Known, Outside
from invtrack.linear.propagation import Propagator
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.tail import SIDES, Tail

ENDS = (0, -1)
"""Of a mesh, before and after the manoeuvre."""


def known(problem: MotionProblem, shooting: Shooting, motion: Motion) -> Known:
    """A motion with its tails in the tangent spaces at rest, to start others from."""
    before, after = (_outside(problem, shooting, motion, end) for end in ENDS)
    return Known(shooting, motion, (before, after))


def tails_of(problem: MotionProblem, shooting: Shooting, motion: Motion, model: SwitchedSystem) -> tuple[Tail, Tail]:
    """[x; u; y] of the plan before and after a motion, as deviations from rest.

    What of the distance from rest lies in the antistable (before) or stable (after) zeros dies out along them; what does not, such
    as where a vehicle that may stand anywhere comes to rest, is held.

    Args:
        problem, shooting, motion: of the plan.
        model: whose rests the plan's values count from.
    """
    before, after = (_tail(problem, shooting, motion, model, end) for end in ENDS)
    return before, after


def tail_errors(problem: MotionProblem, shooting: Shooting, motion: Motion, *, known_well: bool = False) -> Array:
    """How far the tails (2,) are from the conditions of a further element before and after the mesh.

    The larger of the outputs' misses there, as a share of their motion, and of the gap that the element leaves, as a share of the
    states' peaks and per time of the tail's own. Of a motion that is known well what its tails hold counts, too: by that element,
    and by a third of the rates at which it still moves, as a share of what states of full size would make of them. They fall with
    the square of the distance from rest, those of tails of higher degree with a higher power.
    """
    motion = motion if known_well else shooting.on_tails(motion)
    mesh, whole, sizes, found = shooting.mesh, known(problem, shooting, motion), shooting.sizes(motion), np.zeros(2)
    for end, outside, held in zip(ENDS, whole.outside, problem.held_outputs, strict=True):
        if not outside.tail.departs:
            continue
        H = float(mesh.lengths[end])
        edges = np.array([mesh.edges[0] - H, mesh.edges[0]] if end == 0 else [mesh.edges[-1], mesh.edges[-1] + H])
        wanted = np.broadcast_to(held[:, None], (1, len(held), shooting.scheme.count))
        further = replace(shooting, mesh=Mesh(edges, mesh.interval[[end]]), wanted=wanted)
        small = whole.on(further.mesh, shooting.scheme.count)
        gaps, away = further.misses(small, further.nodes(small))
        share = np.max(np.abs(gaps) / sizes) / (H * abs(outside.tail.departure.growth))
        unrest = _unrest(outside, sizes) / 3 if known_well else 0.0
        found[end] = max(share, np.max(np.abs(away[0]) / shooting.motion_size[:, None]), unrest)
    return found


def _unrest(outside: Outside, sizes: Array) -> float:
    """Rates of change of what a tail holds, as shares of what states of these sizes (n,) would make of them."""
    A = outside.rest.derivatives(outside.dynamics).A[0]
    rates, terms = np.abs(A @ outside.tail.held[: len(A)]), np.abs(A) @ sizes
    return float(np.max(rates / np.where(terms > 0, terms, 1.0)))


def _outside(problem: MotionProblem, shooting: Shooting, motion: Motion, end: int) -> Outside:
    dynamics, rest, point = problem.dynamics[end], shooting.ends[end].rest, motion.points[end]
    away = dynamics.difference(point[None], rest.point[None])[0]
    departure = shooting.ends[end].departure(SIDES[end])
    return Outside(dynamics, rest, _departing(np.vstack([departure.X, departure.U]), departure.A, departure.start(away), away, end))


def _tail(problem: MotionProblem, shooting: Shooting, motion: Motion, model: SwitchedSystem, end: int) -> Tail:
    dynamics, rest, point = problem.dynamics[end], shooting.ends[end].rest, motion.points[end][None]
    departure, linear = shooting.ends[end].departure(SIDES[end]), problem.linear_models[end]
    if departure.powers.degree == 1:
        X = dynamics.state_rates(np.repeat(rest.point[None], departure.X.shape[1], axis=0), departure.X.T).T
        rows = np.vstack([X, departure.U, linear.C @ X + linear.D @ departure.U])
    else:
        rows = _values_on(dynamics, rest, departure)
    start = departure.start(dynamics.difference(point, rest.point[None])[0])
    return _departing(rows, departure.A, start, dynamics.states(point)[0] - model.rest_states[end], end)


def _values_on(dynamics: Dynamics, rest: Rest, departure: Departure) -> Array:
    """Coefficients (n + m + p, K) of [x; u; y], as deviations from rest, for powers of a departure's coordinates."""
    powers = departure.powers
    phi = powers.values(powers.samples)
    origin, inputs = np.repeat(rest.point[None], len(phi), axis=0), phi @ departure.U.T
    points = dynamics.retract(origin, phi @ departure.X.T)
    y_rest = dynamics.evaluate(rest.point[None], rest.inputs[None])[1]
    y = dynamics.output_difference(dynamics.evaluate(points, rest.inputs + inputs)[1], np.repeat(y_rest, len(phi), axis=0))
    return powers.fitted(np.hstack([dynamics.states(points) - dynamics.states(origin), inputs, y]))


def _departing(X: Array, A: Array, v: Array, away: Array, end: int) -> Tail:
    """The tail with values X exp(A t) v, the first ones begin at `away` (n,), what they lack is held."""
    held = np.zeros(len(X))
    held[: len(away)] = away - X[: len(away)] @ v
    direction = 1 if end else -1
    return Tail(
        direction=direction,
        departure=Propagator(direction * A),
        X=X,
        v=v,
        S=np.zeros((1, 1)),
        X_w=held[:, np.newaxis],
        w=np.ones(1),
    )
