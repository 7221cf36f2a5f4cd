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
from invtrack.regulation.equilibria import driver_weights, rest_jumps, with_equilibria
from invtrack.regulation.exosystem_map import require_outputs
from invtrack.regulation.francis import francis
from invtrack.regulation.map_certificate import certify_map
from invtrack.regulation.map_pieces import inner_times, map_breakpoints, unweighted
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
    driver, weights = with_equilibria(exosystem, plant, origin=plant.rest_outputs[0]), driver_weights(exosystem, plant)
    comparable = driver.weighted(weights)
    q, q_d, n_u = exosystem.n_states, driver.n_states, plant.n_states + plant.n_inputs
    maps: list[DrivenSystem] = []
    plans: list[DrivenSystem] = []
    found: dict[tuple[int, int, int], int] = {}
    kind = np.empty(len(middles), dtype=np.intp)
    for j, (k, e) in enumerate(zip(plant.interval(middles).tolist(), driver.interval(middles).tolist(), strict=True)):
        key = (int(assumed.numbers[k]), int(plant.numbers[k]), int(driver.numbers[e]))
        if key not in found:
            found[key] = len(maps)
            rest = _rest_apart(assumed.systems[k], plant.systems[k])[:, np.newaxis] / weights[q:]  # without a column, or with one
            C_e = comparable.C[e].copy()
            C_e[:, q:] -= rest[n_u:]
            rows = _rows(assumed.systems[k], comparable.A[e], C_e)
            rows[:, q:] += rest
            maps.append(_static((rows[:n_u] * weights).reshape(-1, 1), np.zeros((1, 1))))
            plans.append(_static(rows, comparable.A[e]))
        kind[j] = found[key]
    ones, none = np.ones((len(kind), 1)), np.zeros((len(kind) - 2, 0))
    trajectory = two_sided_trajectory(Pieces(breakpoints, maps, kind, ones, ones), none, none, none[:0].ravel(), none[:0].ravel())
    empty, edge = np.zeros((len(kind) - 2, 0, q_d)), np.zeros((0, q_d))
    all_jumps = map_jumps(trajectory, driver, plant, weights, rest_jumps(plant, breakpoints, weights))
    jumps = all_jumps.of_states(q)
    admissible = admissible_states(jumps)
    manoeuvre = (float(breakpoints[0]), float(breakpoints[-1]))
    return RegulationMap(
        method=method,
        model=plant,
        exosystem=exosystem,
        driver=driver,
        trajectory=trajectory,
        pieces=PlanPieces(tuple(plans), kind, empty, empty, edge, edge),
        manoeuvre=manoeuvre,
        preactuation=0.0,
        postactuation=0.0,
        tolerance=0.0,
        weights=weights,
        admissible=unweighted(admissible, weights[:q]),
        inadmissible=inadmissible_states(plant, jumps, exosystem.names, admissible, weights[:q]),
        directions_left=directions_left(jumps),
        certificate=certify_map(
            plant,
            driver,
            trajectory,
            manoeuvre,
            weights=weights,
            boundary_residual=0.0,
            continuity=largest_jump(all_jumps, np.eye(len(weights))),
        ),
        remarks=("jumps where the plant or the exosystem switches: no trajectory of the plant, but what is usually aimed at",),
    )


def _rest_apart(assumed: StateSpace, real: StateSpace) -> Array:
    """[x; u; y] (n + 2 p,) at which the one is at rest, less that of the other."""
    at = [np.concatenate([system.rest, system.operating_point.u0, system.operating_point.y0]) for system in (assumed, real)]
    return np.asarray(at[0] - at[1])


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
