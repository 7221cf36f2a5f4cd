"""The trajectory of a plan whose inputs are held: the plant's own response over each hold, and a tail on either side."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import NonHyperbolicError, PlanError
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.linear.internal_dynamics import NOT_UNIQUE, format_zeros
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.certificate import ACCURACY
from invtrack.plans.tail import SIDES, Side, Tail
from invtrack.plans.trajectory import Trajectory, TwoSidedSegments
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem

ON_AXIS = 1e-6
"""A zero is on the imaginary axis where its rate times the hold is below this."""


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """States x (N + 1, n) at the edges of N holds and inputs u (N, m) over them, from the first interval's x0 and absolute."""

    mesh: Mesh
    x: Array
    u: Array


def trajectory_of_holds(
    plant: SwitchedSystem, motion: HeldMotion, ends: tuple[End, End], rests: Sequence[tuple[Array, Array]]
) -> Trajectory:
    """[x; u; y] as deviations from each interval's rest: x carried over each hold by the plant itself.

    Args:
        plant, motion: the plant, and what was found.
        ends, rests: conditions before and after, and state and input held there, as deviations from the interval's rest.
    """
    mesh = motion.mesh
    x, u = motion.x[:-1] - plant.rest_states[mesh.interval], motion.u - plant.rest_inputs[mesh.interval]
    group = plant.numbers[mesh.interval]
    number, groups = np.zeros(len(mesh), dtype=np.intp), []
    for k, system in enumerate(plant.distinct):
        chosen = np.flatnonzero(group == k)
        number[chosen] = np.arange(len(chosen))
        groups.append(TwoSidedSegments(_held_system(system), np.hstack([x[chosen], u[chosen]]), u[chosen]))
    size = np.max(np.abs(x), axis=0)
    size = np.where(size > 0, size, np.max(size, initial=np.finfo(float).tiny))
    before, after = (
        _tail(system, x, end, rest, side, size)
        for system, x, end, rest, side in zip(
            (plant.systems[0], plant.systems[-1]),
            (x[0], motion.x[-1] - plant.rest_states[-1]),
            ends,
            rests,
            SIDES,
            strict=True,
        )
    )
    return Trajectory(mesh.edges, tuple(groups), group, number, before, after)


def _held_system(system: StateSpace) -> DrivenSystem:
    """x' = A x + B w, u = w, y = C x + D w under a held input w."""
    n, m = system.B.shape
    X = np.vstack([np.eye(n), np.zeros((m, n)), system.C])
    parts = TwoSidedSystem(Part(system.A, X, np.eye(n)), Part.empty(len(X), n), np.eye(n))
    X_w = np.vstack([np.zeros((n, m)), np.eye(m), system.D])
    return DrivenSystem(parts, np.zeros((m, m)), system.B, np.zeros((0, m)), X_w, np.zeros((n, m)))


def _tail(system: StateSpace, x: Array, end: End, rest: tuple[Array, Array], side: Side, size: Array) -> Tail:
    """How the plan leaves rest, or comes back to it, beyond holds. Raises NonHyperbolicError or PlanError where it does not.

    Args:
        system, x: of that end, and the state at the edge as deviation from its rest.
        end, rest: conditions, and state and input that are held.
        side: of the manoeuvre.
        size: peaks of the states (n,).
    """
    departure = end.departure(side)
    v = departure.V @ (x - rest[0])
    left = x - rest[0] - departure.X @ v
    moving = end.scale * (end.M @ (left / end.scale)) - left
    if np.max(np.abs(moving) / size, initial=0.0) > ACCURACY:
        on_axis = end.zeros[np.abs(end.zeros.real) * end.length < ON_AXIS]
        if len(on_axis):
            raise NonHyperbolicError(
                f"the motion does not come to rest: some of it is left in zeros on the imaginary axis ({format_zeros(on_axis)}), "
                f"{NOT_UNIQUE}; damp them, track another output, or choose a reference that leaves them at rest"
            )
        raise PlanError(
            "the motion for held inputs does not come to rest: its two-point problem is too ill-conditioned; look for states or "
            "inputs in badly chosen units, or nearly dependent outputs"
        )
    direction = -1 if side == "before" else 1
    rows = np.vstack([departure.X, departure.U, system.C @ departure.X + system.D @ departure.U])
    held = np.concatenate([rest[0] + left, rest[1], system.C @ (rest[0] + left) + system.D @ rest[1]])
    return Tail(direction, Propagator(direction * departure.A), rows, v, np.zeros((1, 1)), held[:, None], np.ones(1))
