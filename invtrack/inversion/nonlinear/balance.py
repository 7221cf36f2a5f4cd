"""Held inputs beside breakpoints and jumps: misses of the outputs spread evenly over the middles and ends of holds."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy  # loads scipy.optimize at its first use

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.boundary_value import TwoPointProblem
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.refinement import wanted_at
from invtrack.inversion.nonlinear.shooting import Motion, Shooting
from invtrack.references.signal import PiecewiseSignal

MOVED = 6
"""Holds on either side of a stop in which the outputs may miss at their matched points, too."""

FORGOTTEN = 12
"""So many holds further out nothing is left of that."""

SPARING = 0.1
"""What a change at a matched point counts beside the largest miss: one that does not gain so much of itself is not made."""

SHARES = np.array([0.5, 1.0])
"""Of a hold, after which misses are looked at: where outputs may be matched."""


@dataclass(frozen=True, eq=False)
class Place:
    """Holds beside stops that are near each other: those in which matched points move, and those in which that shows (k,), (l,)."""

    moved: Indices
    looked: Indices


def balanced(shooting: Shooting, motion: Motion, reference: PiecewiseSignal, stops: Array, accuracy: float) -> Shooting | None:
    """Conditions for which the largest miss at middles and ends of holds beside stops is as small as it gets, to first order.

    A motion for held inputs meets its outputs once in each hold. Beside a jump of the parameters, or a breakpoint, its inputs
    change much from hold to hold, and between the matched points the outputs miss by more than elsewhere, now on one side, now on
    the other. There they are let miss at the matched points, too: a linear program says by how much.

    Args:
        shooting, motion: conditions, and the motion that meets them.
        reference: the wanted outputs, absolute.
        stops: breakpoints of the reference and times of jumps [s].
        accuracy: misses up to this, as a share of the motion, stay as they are.

    Returns None where no stop has larger ones.
    """
    misses = _misses(shooting, motion, reference)
    places = _places(shooting.mesh, stops, np.max(np.abs(misses), axis=(1, 2)) > accuracy)
    if not places:
        return None
    wanted = shooting.wanted.copy()
    for place, influence in zip(places, _influences(shooting, motion, places), strict=True):
        change = _least(misses[place.looked].ravel(), influence)
        wanted[place.moved, :, 0] += change.reshape(len(place.moved), -1) * shooting.motion_size
    return replace(shooting, wanted=wanted)


def _misses(shooting: Shooting, motion: Motion, reference: PiecewiseSignal) -> Array:
    """y - y_d in the middle and at the end of each hold, as shares of the motion (N, 2, p)."""
    after = (SHARES * shooting.scheme.steps).astype(np.intp)
    inputs = np.repeat(motion.coefficients, len(after), axis=1)
    y = shooting.outputs(shooting.nodes(motion)[:, after], inputs)
    away = shooting.dynamics[0].output_difference(y, wanted_at(shooting.mesh, reference, SHARES))
    return np.asarray(away / shooting.motion_size)


def _places(mesh: Mesh, stops: Array, large: Array) -> list[Place]:
    """Where stops [s] have holds beside them with large misses (N,)."""

    def around(edge: int, reach: int) -> Indices:
        return np.arange(max(0, edge - reach), min(len(mesh), edge + reach))

    found: list[Place] = []
    for edge in np.unique(np.searchsorted(mesh.edges, stops)).tolist():
        moved, looked = around(edge, MOVED), around(edge, MOVED + FORGOTTEN)
        if not np.any(large[moved]):
            continue
        if found and found[-1].looked[-1] >= looked[0]:
            before = found.pop()
            moved, looked = np.union1d(before.moved, moved), np.union1d(before.looked, looked)
        found.append(Place(moved, looked))
    return found


def _influences(shooting: Shooting, motion: Motion, places: list[Place]) -> list[Array]:
    """How misses in each place, in order, depend on what is wanted at its matched points: (2 l p, k p), as shares of the motion.

    One solution of the linear problem serves all places, which are too far from each other for one to show in another.
    """
    nodes, scheme, p = shooting.nodes(motion), shooting.scheme, len(shooting.motion_size)
    maps, ((L, _), (R, _)) = shooting.maps(motion, nodes), shooting.end_conditions(motion)
    back, gain = maps.inverse
    problem = TwoPointProblem.of(maps.exact, L, R, shooting.ends[0].scale)
    still = np.zeros(len(L)), np.zeros(len(R))
    found = [np.zeros((len(place.looked), len(SHARES), p, len(place.moved), p)) for place in places]
    between = [replace(shooting, scheme=replace(scheme, at_end=(at_end,) * p)).maps(motion, nodes) for at_end in (False, True)]
    for k in range(max(len(place.moved) for place in places)):
        here = [(place, result) for place, result in zip(places, found, strict=True) if k < len(place.moved)]
        numbers = [place.moved[k] for place, _ in here]
        for i in range(p):
            inputs = np.zeros((len(shooting.mesh), gain.shape[1]))
            inputs[numbers] = gain[numbers, :, i] * shooting.motion_size[i]
            states = problem.solve(np.einsum("kij,kj->ki", maps.end_c, inputs), *still)[:-1]
            inputs -= np.einsum("kij,kj->ki", back, states)
            for place, result in here:
                own = place.looked
                for j, each in enumerate(between):
                    by_states = np.einsum("kij,kj->ki", each.out_x[own], states[own])
                    by_inputs = np.einsum("kij,kj->ki", each.out_c[own], inputs[own])
                    result[:, j, :, k, i] = (by_states + by_inputs) / shooting.motion_size
    return [result.reshape(-1, result.shape[3] * p) for result in found]


def _least(misses: Array, influence: Array) -> Array:
    """The changes w (k,) for which the largest |misses + influence w| (l,), and SPARING times the sum of |w|, is least."""
    size = float(np.max(np.abs(misses)))
    k = influence.shape[1]
    unit, none, ones = np.eye(k), np.zeros((k, 1)), np.ones((len(misses), 1))
    blank = np.zeros((len(misses), k))
    found = scipy.optimize.linprog(  # over w, |w| and the largest
        np.concatenate([np.zeros(k), np.full(k, SPARING), [1.0]]),
        A_ub=np.block([[influence, blank, -ones], [-influence, blank, -ones], [unit, -unit, none], [-unit, -unit, none]]),
        b_ub=np.concatenate([-misses / size, misses / size, np.zeros(2 * k)]),
        bounds=(None, None),
        method="highs",
    )
    return np.asarray(found.x[:k] * size) if found.success else np.zeros(k)
