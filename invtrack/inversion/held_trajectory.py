"""The trajectory of a plan whose inputs are held: the plant's own response over each hold, and a tail on either side."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import NonHyperbolicError
from invtrack.inversion.held_end import HeldEnd
from invtrack.inversion.held_motion import HeldMotion
from invtrack.linear.internal_dynamics import NOT_UNIQUE, format_zeros
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.linear.zeros import zeros
from invtrack.plans.certificate import ACCURACY
from invtrack.plans.tail import Tail
from invtrack.plans.trajectory import Trajectory, TwoSidedSegments
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem


def trajectory_of_holds(plant: SwitchedSystem, motion: HeldMotion, ends: tuple[HeldEnd, HeldEnd]) -> Trajectory:
    """[x; u; y] as deviations from each interval's rest: x carried over each hold by the plant itself.

    plant, motion: the plant, and what was found; ends: conditions before and after.
    """
    mesh = motion.mesh
    x, u = motion.x[:-1] - plant.rest_states[mesh.interval], motion.u - plant.rest_inputs[mesh.interval]
    group = plant.numbers[mesh.interval]
    number, groups = np.zeros(len(mesh), dtype=np.intp), []
    for k, system in enumerate(plant.distinct):
        chosen = np.flatnonzero(group == k)
        number[chosen] = np.arange(len(chosen))
        groups.append(TwoSidedSegments(_held_system(system), np.hstack([x[chosen], u[chosen]]), u[chosen]))
    peaks = np.max(np.abs(x), axis=0)
    moved = np.where(peaks > 0, peaks, np.max(peaks, initial=np.finfo(float).tiny)) / (mesh.edges[-1] - mesh.edges[0])
    last = motion.x[-1] - plant.rest_states[-1]
    before, after = _tail(plant.systems[0], x[0], ends[0], -1, moved), _tail(plant.systems[-1], last, ends[1], 1, moved)
    return Trajectory(mesh.edges, tuple(groups), group, number, before, after)


def _held_system(system: StateSpace) -> DrivenSystem:
    """x' = A x + B w, u = w, y = C x + D w under a held input w."""
    n, m = system.B.shape
    X = np.vstack([np.eye(n), np.zeros((m, n)), system.C])
    parts = TwoSidedSystem(Part(system.A, X, np.eye(n)), Part.empty(len(X), n), np.eye(n))
    X_w = np.vstack([np.zeros((n, m)), np.eye(m), system.D])
    return DrivenSystem(parts, np.zeros((m, m)), system.B, np.zeros((0, m)), X_w, np.zeros((n, m)))


def _tail(system: StateSpace, x: Array, end: HeldEnd, direction: int, moved: Array) -> Tail:
    """How the plan leaves rest, or comes back to it, beyond holds. Raises NonHyperbolicError where it does not.

    Args:
        system, x: of that end, and the state at the edge as deviation from its interval's rest.
        end: conditions.
        direction: -1 before the manoeuvre, 1 after it.
        moved: rates (n,) at which states move by their peaks within the manoeuvre [1/s].
    """
    departure, neutral, (rest_x, rest_u) = end.departure, end.neutral, end.rest
    left = neutral.Z @ (x - rest_x)
    if np.max(np.abs(neutral.X @ (neutral.T @ left)) / moved, initial=0.0) > ACCURACY:
        found = zeros(system)
        nearest = np.argmin(np.abs(np.linalg.eigvals(neutral.T)[:, None] - found), axis=1)
        listed = format_zeros(found[np.unique(nearest)])
        raise NonHyperbolicError(
            f"the motion for inputs held for {end.element.length:.3g} s does not come to rest: some of it is left in zeros on the "
            f"imaginary axis, or as good as on it for such holds ({listed}), {NOT_UNIQUE}; damp them, track another output, choose "
            "a reference that leaves them at rest, or, where it does but for the holds, shorter ones"
        )
    rows = np.vstack([departure.X, departure.U, system.C @ departure.X + system.D @ departure.U])
    held_x, held_u = rest_x + neutral.X @ left, rest_u + neutral.U @ left
    held = np.concatenate([held_x, held_u, system.C @ held_x + system.D @ held_u])
    v = departure.Z @ (x - rest_x)
    return Tail(direction, Propagator(direction * departure.T), rows, v, np.zeros((1, 1)), held[:, None], np.ones(1))
