"""Exact tracking for every output of an exosystem at once, through jumps of plant and exosystem: the maps G(t) and F(t)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices, require_share
from invtrack.errors import PlanError, TrajectoryError
from invtrack.inversion.inverse_system import hyperbolic_splits, require_square
from invtrack.linear.state_sizes import unit_ratios
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.problem import actuation_times
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import drive_units
from invtrack.plans.two_sided_problem import TwoSidedProblem, TwoSidedSolution
from invtrack.references.exosystem import Exosystem
from invtrack.regulation.admissible import (
    Jumps,
    admissible_states,
    directions_left,
    inadmissible_states,
    largest_jump,
    map_jumps,
)
from invtrack.regulation.equilibria import driver_weights, require_rest_passed, rest_jumps, with_equilibria
from invtrack.regulation.map_certificate import certify_map
from invtrack.regulation.map_pieces import (
    MapPiece,
    column_weights,
    internal_parts,
    map_breakpoints,
    map_pieces,
    unweighted,
)
from invtrack.regulation.regulation_map import PlanPieces, RegulationMap


def exosystem_map(model: Any, exosystem: Exosystem, *, tolerance: float = 1e-10) -> RegulationMap:
    """G(t) and F(t) with which x_d = G x_e, u_d = F x_e track y_d = C_e x_e exactly, for all exosystem states at once.

    G' = A_y G - G A_e + B G_k C_e*, F = F_k G + G_k C_e*, C G = C_e, jumps of plant and exosystem included: with
    G = P Zeta + V (W_s Z_s + W_u Z_u), Z_s' = A_s Z_s - Z_s A_e + D_s runs forward and Z_u' = A_u Z_u - Z_u A_e + D_u backward.
    Before the first switch Z_s, after the last one Z_u, is the bounded particular solution of that endless piece: zero where the
    exosystem is at rest, the held output's equilibrium, the Francis regulator where the exosystem runs for ever. Columns whose
    output no continuous state can follow are defined too, with N G continuous, and G jumps there; `admissible` and `inadmissible`
    of the result say which.

    All of vec(G) is solved for together. The alternative, one inverse X = G(t) Phi_e(t, T_i) per column, loses G where Phi_e is
    ill-conditioned, as it is for a chain of integrators on a long horizon; vec(G) does not see how far x_e has gone.

    model: StateSpace, SwitchedSystem, or anything with A, B, C, D. tolerance: what counts as having come to the particular
    solution, relative to each entry's peak.

    Raises TrajectoryError (number of outputs), RelativeDegreeError, NonHyperbolicError (zeros on the imaginary axis in the first or
    last interval), InversionError (an endless exosystem mode that is a plant zero), PlanError (options out of range; too
    ill-conditioned).
    Source: Devasia, Paden, Rossi 1996, section 3.
    """
    require_share("tolerance", tolerance, error=PlanError)
    plant = as_switched(model)
    require_square(plant, "a regulation map")
    require_outputs(plant, exosystem)
    splits = hyperbolic_splits(plant)
    breakpoints = map_breakpoints(plant, exosystem)
    driver, weights = with_equilibria(exosystem, plant, origin=plant.rest_outputs[0]), driver_weights(exosystem, plant)
    pieces, kind = map_pieces(plant, splits, driver, breakpoints, weights)
    shifts = rest_jumps(plant, breakpoints, weights)
    unit = max(1.0, *drive_units([piece.driven for piece in pieces]))
    solution = _map_problem(pieces, kind, breakpoints, shifts, unit, unit_ratios(plant)).solve()
    trajectory = solution.trajectory()
    all_jumps, q = map_jumps(trajectory, driver, plant, weights, shifts), exosystem.n_states
    require_rest_passed(all_jumps, plant, q)
    jumps = all_jumps.of_states(q)
    admissible = admissible_states(jumps)
    passed = scipy.linalg.block_diag(admissible, np.eye(driver.n_states - q))
    manoeuvre = (float(breakpoints[0]), float(breakpoints[-1]))
    preactuation, postactuation, _ = actuation_times(trajectory, manoeuvre, tolerance)
    certificate = certify_map(
        plant,
        driver,
        trajectory,
        (_finite(breakpoints[0], -preactuation), _finite(breakpoints[-1], postactuation)),
        weights=weights,
        boundary_residual=_boundary(trajectory, pieces, kind, all_jumps, passed, shifts),
        continuity=largest_jump(all_jumps, passed),
    )
    certificate.require()
    free = solution.boundary.freedom // driver.n_states
    remarks = (f"the bounded map is not unique ({free} free direction(s)); the one of least norm was taken",) if free else ()
    return RegulationMap(
        method="exosystem map",
        model=plant,
        exosystem=exosystem,
        driver=driver,
        trajectory=trajectory,
        pieces=_plan_pieces(pieces, solution, unit),
        manoeuvre=manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        weights=weights,
        admissible=unweighted(admissible, weights[:q]),
        inadmissible=inadmissible_states(plant, jumps, exosystem.names, admissible, weights[:q]),
        directions_left=directions_left(jumps),
        certificate=certificate,
        remarks=remarks,
    )


def require_outputs(plant: SwitchedSystem, exosystem: Exosystem) -> None:
    """Raises TrajectoryError unless `exosystem` is one, with one output per output of the plant."""
    names = list(plant.outputs.names)
    if not isinstance(exosystem, Exosystem):
        raise TrajectoryError(
            f"expected an Exosystem, such as sinusoidal_exosystem(...), got {type(exosystem).__name__}; for a single reference "
            "use invert"
        )
    if exosystem.n_outputs != len(names):
        raise TrajectoryError(f"the exosystem has {exosystem.n_outputs} outputs, the plant {len(names)}: {names}")


def _finite(edge: float, away: float) -> float:
    return float(edge + away) if np.isfinite(away) else float(edge)


def _map_problem(
    pieces: Sequence[MapPiece], kind: Indices, breakpoints: Array, shifts: Array, unit: float, ratios: Array
) -> TwoSidedProblem:
    """The equations of vec(Z_s), vec(Z_u), with N G continuous at every breakpoint and every piece an interval of its own.

    Rows of C* that hold unknowns (outputs that change with the plant) are conditions, the others are what decides which exosystem
    states are admissible.

    Args:
        pieces, kind: the distinct pieces, and which of them lies before, between and after the breakpoints.
        breakpoints: those of the map (m + 1,) [s].
        shifts: jumps of G that are not to count (m + 1, n, q).
        unit: in which Z_s and Z_u are measured.
        ratios: of the plant's states, see `unit_ratios`.
    """
    driven = [piece.driven.in_units(unit, unit, piece.driven.system.in_units(unit, unit)) for piece in pieces]
    ones = np.ones((len(kind), 1))
    return TwoSidedProblem(
        breakpoints=breakpoints,
        driven=driven,
        which=kind,
        w_start=ones,
        w_end=ones,
        owner=np.arange(len(kind)),
        systems=[driven[k].system for k in kind],
        switch_times=breakpoints,
        shifts=shifts.reshape(len(breakpoints), -1),
        peaks=[np.zeros(driven[k].system.prescribed) for k in kind[1:]],
        ratios=np.asarray(np.kron(ratios, np.eye(len(pieces[0].A_e))), dtype=float),
    )


def _plan_pieces(pieces: Sequence[MapPiece], solution: TwoSidedSolution, unit: float) -> PlanPieces:
    """What takes x_e to the states of a plan: Z_s and Z_u, at the ends together with their particular solutions."""
    problem = solution.problem
    q = len(pieces[0].A_e)
    first, last = pieces[problem.which[0]], pieces[problem.which[-1]]
    Z_s, Z_u = (unit * z.reshape(len(z), z.shape[1] // q, q) for z in solution.states())
    return PlanPieces(
        driven=tuple(piece.plan for piece in pieces),
        which=problem.which,
        Z_f=Z_s,
        Z_b=Z_u,
        first_b=unit * solution.first_b.reshape(-1, q) + first.steady_u,
        last_f=unit * solution.last_f.reshape(-1, q) + last.steady_s,
    )


def _boundary(
    trajectory: Trajectory, pieces: Sequence[MapPiece], kind: Indices, jumps: Jumps, admissible: Array, shifts: Array
) -> float:
    """How far Z_s is from its particular solution just after the first breakpoint, and Z_u from its own just before the last one.

    From values of G inside the manoeuvre, on the admissible (weighted) states; where the plant is the same on both sides on all.

    Args:
        trajectory: G and F row by row, one above the other.
        pieces, kind: the distinct pieces, and which of them lies before, between and after the breakpoints.
        jumps: those of G.
        admissible: basis of the admissible states (q, d).
        shifts: jumps of G that do not count (m + 1, n, q).
    """
    edges, worst = trajectory.breakpoints, 0.0
    for end, inside, part in ((0, 1, 0), (-1, len(kind) - 2, 1)):
        piece, q = pieces[kind[end]], len(admissible)
        n, w = len(piece.split.internal.form.V), column_weights(piece.weights)
        values = trajectory(edges[[end]], np.array([inside]), slice(0, n * q)).reshape(n, q) / w
        values += shifts[end] if end else -shifts[end]  # as it is on the other side
        states = np.eye(q)
        if pieces[kind[inside]].split is not piece.split:
            states = jumps.Phi[end] @ admissible
        away = internal_parts(piece, (values - piece.base[:n]) @ states)[part]
        size = float(np.max(np.abs(values @ states), initial=0.0))
        worst = max(worst, float(np.max(np.abs(away), initial=0.0)) / (size if size > 0 else 1.0))
    return worst
