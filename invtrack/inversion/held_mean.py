"""The continuous inverse with its input held at its mean: by how much holds then miss what is planned for them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.hold_response import NODES, WEIGHTS
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.sampled_element import SampledElement
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.trajectory import Trajectory

ROUNDING = 256.0
"""How many units in their last place the terms of an equation, and the times in it, may be off where it still counts as met."""


@dataclass(frozen=True, eq=False)
class HeldMean:
    """A motion over N holds, from the first interval's rest and absolute, and what holding its mean input changes of it.

    What that changes is found from the input's departure from its mean alone. Anything else by which the motion misses a hold's
    equations (an input that moves too fast to be read at the nodes, a jump) is the difference of what is planned for its start and
    its end, and counts where it is more than rounding.

    Args:
        states: at the edges of the holds (N + 1, n).
        inputs: mean over each hold (N, m).
        missed: the state at the end of each hold that it leads to, less that planned for it, in the hold's coordinates (N, n).
        outputs: each output where it is to be met, less that wanted (N, p).
        jumps: the state planned for the end of each hold, less that planned for the start of the next one (N, n).
    """

    states: Array
    inputs: Array
    missed: Array
    outputs: Array
    jumps: Array

    @classmethod
    def of(
        cls, plant: SwitchedSystem, motion: Trajectory, mesh: Mesh, elements: Sequence[tuple[Indices, SampledElement]]
    ) -> HeldMean:
        """That of a motion [x; u; y] of the plant, as deviations from each interval's rest.

        Args:
            plant, motion: the plant and the motion.
            mesh, elements: the holds, and which are of each kind.
        """
        n, m = plant.n_states, plant.n_inputs
        piece = motion.locate((mesh.edges[:-1] + mesh.edges[1:]) / 2)
        start, end = (motion(edges, piece, slice(n)) for edges in (mesh.edges[:-1], mesh.edges[1:]))
        moving = np.array([motion(mesh.edges[:-1] + share * mesh.lengths, piece, slice(n, n + m)) for share in NODES])
        mean = np.einsum("g,gkm->km", WEIGHTS, moving)
        x_peak, u_peak = np.max(np.abs(start), axis=0), np.max(np.abs(moving), axis=(0, 1))
        in_time = float(np.spacing(np.max(np.abs(mesh.edges)))) / np.finfo(float).eps
        missed, outputs, sizes = np.empty_like(start), np.empty((len(mesh), plant.n_outputs)), np.empty_like(start)
        for chosen, element in elements:
            system = plant.systems[mesh.interval[chosen[0]]]
            # What states come to as they are, and change by within what times are off.
            size = x_peak + in_time * (np.abs(system.A) @ x_peak + np.abs(system.B) @ u_peak)
            sizes[chosen], peaks, given = size, (size, u_peak), (start[chosen], mean[chosen])
            missed[chosen], outputs[chosen] = element.changes(mean[chosen] - moving[:, chosen])
            planned = end[chosen] + missed[chosen] @ element.coordinates.back.T
            other = _missed(_held(system, element.length, np.eye(n), np.zeros((n, m))), given, planned, peaks)
            missed[chosen] += other @ element.coordinates.into.T
            for i, share in enumerate(element.shares.tolist()):
                C, D, rows = system.C[i : i + 1], system.D[i : i + 1], slice(n + m + i, n + m + i + 1)
                times = np.minimum(mesh.edges[chosen] + share * mesh.lengths[chosen], mesh.edges[chosen + 1])
                planned = motion(times, piece[chosen], rows) + outputs[chosen, i : i + 1]
                outputs[chosen, i] += _missed(_held(system, share * element.length, C, D), given, planned, peaks)[:, 0]
        rest = plant.rest_states[mesh.interval]
        states = np.vstack([start + rest, end[-1:] + rest[-1:]])
        jumps = end + rest - states[1:]
        jumps = np.where(np.abs(jumps) > ROUNDING * np.finfo(float).eps * (sizes + np.abs(rest)), jumps, 0.0)
        return cls(states, mean + plant.rest_inputs[mesh.interval], missed, outputs, jumps)


def _held(system: StateSpace, time: float, C: Array, D: Array) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """C x + D u as rows of the state before that time [s] and of an input held over it (r, n), (r, m); and the terms of these."""
    units = plant_units(system)
    A_d, B_d = zero_order_hold(system.A * units / units[:, None], system.B / units[:, None], time)
    A_d, B_d = A_d * units[:, None] / units, B_d * units[:, None]
    terms = np.abs(C) @ np.abs(A_d), np.abs(C) @ np.abs(B_d) + np.abs(D)
    return (C @ A_d, C @ B_d + D), terms


def _missed(
    held: tuple[tuple[Array, Array], tuple[Array, Array]],
    given: tuple[Array, Array],
    planned: Array,
    peaks: tuple[Array, Array],
) -> Array:
    """What states and inputs given lead to, less what is planned (k, r); zero where that is rounding.

    Args:
        held: rows, and their terms; see `_held`.
        given: states and inputs (k, n), (k, m).
        planned: (k, r).
        peaks: of states and inputs (n,), (m,), whose terms' rounding counts as nothing.
    """
    rows, terms = held
    found = given[0] @ rows[0].T + given[1] @ rows[1].T - planned
    return np.where(np.abs(found) > ROUNDING * np.finfo(float).eps * (terms[0] @ peaks[0] + terms[1] @ peaks[1]), found, 0.0)
