"""Equilibria that differ from interval to interval, as one more state of the exosystem: it stays at 1."""

from __future__ import annotations

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import CompatibilityError
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.exosystem import Exosystem
from invtrack.regulation.admissible import Jumps
from invtrack.regulation.map_pieces import inner_times, visibility

REST = "rest"
"""Name of the state that stays at 1."""


def with_equilibria(exosystem: Exosystem, plant: SwitchedSystem, *, origin: Array) -> Exosystem:
    """The exosystem whose outputs are deviations from the outputs at rest of each interval of the plant.

    y_d = C_e x_e + (origin - y0_k) 1, `origin` (p,) the output from which C_e x_e is measured; the exosystem itself where the plant
    is at rest in one place.
    """
    if plant.rests_in_one_place:
        return exosystem
    times = np.union1d(plant.switch_times, exosystem.switch_times)
    middles = inner_times(times)
    made: dict[tuple[int, int], tuple[Array, Array]] = {}
    pairs = []
    for k, e in zip(plant.interval(middles).tolist(), exosystem.interval(middles).tolist(), strict=True):
        key = int(plant.numbers[k]), int(exosystem.numbers[e])
        if key not in made:
            offset = (origin - plant.rest_outputs[k])[:, np.newaxis]
            made[key] = scipy.linalg.block_diag(exosystem.A[e], 0.0), np.hstack([exosystem.C[e], offset])
        pairs.append(made[key])
    names = [*exosystem.names, _free_name(exosystem.names)]
    return Exosystem([A for A, _ in pairs], [C for _, C in pairs], times, names=names)


def driver_weights(exosystem: Exosystem, plant: SwitchedSystem) -> Array:
    """How strongly each state of `with_equilibria` shows, see `visibility`: the last one by what the jumps move of the outputs."""
    weights = visibility(exosystem, plant)
    if plant.rests_in_one_place:
        return weights
    C = np.max([np.abs(system.C) for system in plant.distinct], axis=0)
    moved = np.abs(np.diff(plant.rest_outputs, axis=0)) + np.abs(plant.shifts) @ C.T
    largest = float(np.max(moved))
    return np.append(weights, np.exp2(np.rint(np.log2(largest))) if largest > 0 else 1.0)


def rest_jumps(plant: SwitchedSystem, breakpoints: Array, weights: Array) -> Array:
    """What jumps of the rest add to those of G for the weighted states, at each breakpoint (m + 1, n, q)."""
    jumps = np.zeros((len(breakpoints), plant.n_states, len(weights)))
    if not plant.rests_in_one_place:
        jumps[np.searchsorted(breakpoints, plant.switch_times), :, -1] = plant.shifts / weights[-1]
    return jumps


def require_rest_passed(jumps: Jumps, plant: SwitchedSystem, states: int) -> None:
    """Raises CompatibilityError where the plant cannot pass a jump of its equilibrium with the exosystem at zero.

    Args:
        jumps: those of the map, beyond those of the rest.
        plant: the plant.
        states: of the exosystem itself.
    """
    stuck = np.flatnonzero(np.any(jumps.jump[:, :, states:], axis=(1, 2)))
    if stuck.size:
        raise CompatibilityError(
            f"the equilibrium jumps at t = {jumps.times[stuck[0]]:.6g} s, and no continuous state holds the outputs "
            f"{list(plant.outputs.names)} still through it, so the exosystem's outputs cannot be followed from zero on; "
            "invtrack.quadratic_redesign gives up as little of an output as it must"
        )


def _free_name(taken: tuple[str, ...]) -> str:
    name = REST
    while name in taken:
        name += "_"
    return name
