"""Francis regulators as maps over time: the usual practice that the exosystem map is compared with."""

from __future__ import annotations

from typing import Any

import numpy as np

from invtrack.arrays import Array, whole_number
from invtrack.errors import InversionError
from invtrack.inversion.inverse_system import require_square
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.plans.two_sided_problem import Pieces, two_sided_trajectory
from invtrack.references.exosystem import Exosystem
from invtrack.regulation.admissible import admissible_states, directions_left, inadmissible_states, largest_jump, map_jumps
from invtrack.regulation.exosystem_map import require_outputs
from invtrack.regulation.francis import francis
from invtrack.regulation.map_certificate import certify_map
from invtrack.regulation.map_pieces import inner_times, map_breakpoints, unweighted, visibility
from invtrack.regulation.regulation_map import PlanPieces, RegulationMap


def switched_francis(model: Any, exosystem: Exosystem) -> RegulationMap:
    """G = Pi_k, F = Gamma_k of the Francis regulator of each interval, exchanged where the plant or the exosystem switches.

    Exact as long as nothing switches; x_d = G x_e jumps where something does (also where the exosystem starts and stops), which
    the plant cannot follow, so each switch leaves a transient. Outside a finite exosystem G is zero, or the held output's
    equilibrium. Raises what `francis` does, and TrajectoryError for a wrong number of outputs.
    Source: Devasia, Paden, Rossi 1996, sections 1 and 3.
    """
    plant = as_switched(model)
    return _map_of(plant, plant, exosystem, "switched Francis")


def single_francis(model: Any, exosystem: Exosystem, *, interval: int = 0) -> RegulationMap:
    """G = Pi, F = Gamma of the Francis regulator of one interval of the plant, used for all of them: jumps are not known about.

    interval: whose matrices are taken; the others' equations are then missed, which the certificate shows. Raises InversionError
    for an interval that does not exist, and what `switched_francis` does.
    """
    plant = as_switched(model)
    interval = whole_number("interval", interval, highest=len(plant) - 1, error=InversionError)
    frozen = SwitchedSystem([plant.systems[interval]] * len(plant), plant.switch_times)
    return _map_of(plant, frozen, exosystem, "single Francis")


def _map_of(plant: SwitchedSystem, assumed: SwitchedSystem, exosystem: Exosystem, method: str) -> RegulationMap:
    """The map of the regulators of the plant `assumed`, judged by the plant as it is."""
    require_square(plant, "a regulation map")
    require_outputs(plant, exosystem)
    breakpoints = map_breakpoints(plant, exosystem)
    middles = inner_times(breakpoints)
    weights = visibility(exosystem, plant)
    comparable = exosystem.weighted(weights)
    q = exosystem.n_states
    maps: list[DrivenSystem] = []
    plans: list[DrivenSystem] = []
    found: dict[tuple[int, int], int] = {}
    kind = np.empty(len(middles), dtype=np.intp)
    for j, (k, e) in enumerate(zip(assumed.interval(middles).tolist(), exosystem.interval(middles).tolist(), strict=True)):
        key = (int(assumed.numbers[k]), int(exosystem.numbers[e]))
        if key not in found:
            found[key] = len(maps)
            rows = _rows(assumed.systems[k], comparable.A[e], comparable.C[e])
            n_u = assumed.n_states + assumed.n_inputs
            maps.append(_static((rows[:n_u] * weights).reshape(-1, 1), np.zeros((1, 1))))
            plans.append(_static(rows, comparable.A[e]))
        kind[j] = found[key]
    ones, none = np.ones((len(kind), 1)), np.zeros((len(kind) - 2, 0))
    trajectory = two_sided_trajectory(Pieces(breakpoints, maps, kind, ones, ones), none, none, none[:0].ravel(), none[:0].ravel())
    empty, edge = np.zeros((len(kind) - 2, 0, q)), np.zeros((0, q))
    jumps = map_jumps(trajectory, exosystem, plant, weights)
    admissible = admissible_states(jumps)
    manoeuvre = (float(breakpoints[0]), float(breakpoints[-1]))
    return RegulationMap(
        method=method,
        model=plant,
        exosystem=exosystem,
        trajectory=trajectory,
        pieces=PlanPieces(tuple(plans), kind, empty, empty, edge, edge),
        manoeuvre=manoeuvre,
        preactuation=0.0,
        postactuation=0.0,
        tolerance=0.0,
        weights=weights,
        admissible=unweighted(admissible, weights),
        inadmissible=inadmissible_states(plant, jumps, exosystem.names, admissible, weights),
        directions_left=directions_left(jumps),
        certificate=certify_map(
            plant,
            exosystem,
            trajectory,
            manoeuvre,
            weights=weights,
            boundary_residual=0.0,
            continuity=largest_jump(jumps, np.eye(len(weights))),
        ),
        remarks=("jumps where the plant or the exosystem switches: no trajectory of the plant, but what is usually aimed at",),
    )


def _rows(system: StateSpace, A_e: Array, C_e: Array) -> Array:
    """[Pi; Gamma; C_e] (n + 2 p, q) of one plant and one exosystem: what takes x_e to [x; u; y]."""
    n, m = system.n_states, system.n_inputs
    rows = np.zeros((n + m, len(A_e)))  # no output, no motion: also where the plant could not hold a constant one
    if np.any(C_e):
        regulator = francis(system, A_e, C_e)
        rows = np.vstack([regulator.Pi, regulator.Gamma])
    return np.vstack([rows, system.C @ rows[:n] + system.D @ rows[n:]])


def _static(X: Array, S: Array) -> DrivenSystem:
    """X w, w' = S w: a two-sided system without states of its own."""
    none, nothing = Part.empty(len(X), 0), np.zeros((0, len(S)))
    return DrivenSystem(TwoSidedSystem(none, none, np.zeros((0, 0))), S, nothing, nothing, X, nothing)
