"""Exact tracking for every output of an exosystem at once, through jumps of plant and exosystem: the maps G(t) and F(t)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import InversionError, TrajectoryError
from invtrack.inversion.bounded_solution.problem import split_each
from invtrack.inversion.bounded_solution.refusals import ACCURACY
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.boundary_value import BoundaryValueSolution
from invtrack.plans.ends import Departure, actuation_times
from invtrack.plans.plan import TwoSidedTrajectory
from invtrack.references.exosystem import Exosystem
from invtrack.regulation.admissible import (
    Jumps,
    admissible_states,
    directions_left,
    inadmissible_states,
    largest_jump,
    map_jumps,
)
from invtrack.regulation.map_certificate import RegulationCertificate, certify_map
from invtrack.regulation.map_equations import solve_map
from invtrack.regulation.map_pieces import MapPiece, internal_parts, map_breakpoints, map_pieces
from invtrack.regulation.regulation_map import PlanPieces, RegulationMap
from invtrack.regulation.visibility import column_weights, unweighted, visibility

Array = NDArray[np.float64]


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
    last interval), InversionError (options out of range, an endless exosystem mode that is a plant zero, too ill-conditioned).
    Source: Devasia, Paden, Rossi 1996, section 3.
    """
    if not 0 < tolerance < 1:
        raise InversionError(f"tolerance must lie between 0 and 1, got {tolerance}")
    plant = as_switched(model)
    require_outputs(plant, exosystem)
    splits = split_each(plant)
    breakpoints = map_breakpoints(plant, exosystem)
    weights = visibility(exosystem, plant)
    pieces, kind = map_pieces(plant, splits, exosystem, breakpoints, weights)
    solution, Z_s, Z_u = solve_map(pieces, kind, breakpoints)
    trajectory = _trajectory(pieces, kind, breakpoints, Z_s, Z_u)
    jumps = map_jumps(trajectory, exosystem, plant, weights)
    admissible = admissible_states(jumps)
    preactuation, postactuation = _times(trajectory, tolerance)
    certificate = certify_map(
        plant,
        exosystem,
        trajectory,
        (_finite(breakpoints[0], -preactuation), _finite(breakpoints[-1], postactuation)),
        weights=weights,
        boundary_residual=_boundary(trajectory, pieces, kind, jumps, admissible),
        continuity=largest_jump(jumps, admissible),
    )
    _require_accurate(certificate, solution)
    free = solution.freedom // exosystem.n_states
    remarks = (f"the bounded map is not unique ({free} free direction(s)); the one of least norm was taken",) if free else ()
    return RegulationMap(
        method="exosystem map",
        model=plant,
        exosystem=exosystem,
        trajectory=trajectory,
        pieces=_plan_pieces(pieces, kind, Z_s, Z_u),
        manoeuvre=(float(breakpoints[0]), float(breakpoints[-1])),
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        weights=weights,
        admissible=unweighted(admissible, weights),
        inadmissible=inadmissible_states(plant, jumps, exosystem.names, admissible, weights),
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


def _require_accurate(certificate: RegulationCertificate, solution: BoundaryValueSolution) -> None:
    """The last guard, as in `invert`: a map that misses its own equations is refused, whatever the reason."""
    worst = max(certificate.dynamics_residual, certificate.output_error, certificate.boundary_residual, certificate.continuity)
    if not worst <= ACCURACY:
        raise InversionError(
            f"the exosystem's map is too ill-conditioned to be trusted: it misses its own equations by {worst:.1e} of its size "
            f"({certificate}; smallest pivot of the boundary value problem {solution.conditioning:.1e}); look for states in badly "
            "chosen units, or for exosystem modes that grow or decay by many powers of ten"
        )


def _finite(edge: float, away: float) -> float:
    return float(edge + away) if np.isfinite(away) else float(edge)


def _trajectory(
    pieces: Sequence[MapPiece], kind: NDArray[np.intp], breakpoints: Array, Z_s: Array, Z_u: Array
) -> TwoSidedTrajectory:
    """[G; F] row by row: Z and the constant of each piece's drive as two-sided states."""
    count, q = len(kind), Z_s.shape[2]
    v_f, v_b = np.zeros((count, Z_s.shape[1] * q + 1)), np.zeros((count, Z_u.shape[1] * q + 1))
    generators = [piece.generator for piece in pieces]
    for j, number in enumerate(kind.tolist()):
        piece = pieces[number]
        n_s, n_u = len(piece.split.A_s), len(piece.split.A_u)
        if piece.place != "inside" and not (np.any(Z_s[j]) or np.any(Z_u[j])):  # an endless piece occurs once
            generators[number], n_s, n_u = piece.settled, 0, 0
        v_f[j, : n_s * q], v_f[j, n_s * q] = Z_s[j, :n_s].ravel(), piece.constant
        v_b[j, : n_u * q], v_b[j, n_u * q] = Z_u[j, :n_u].ravel(), piece.constant
    return TwoSidedTrajectory(breakpoints, tuple(generators), kind, v_f, v_b)


def _plan_pieces(pieces: Sequence[MapPiece], kind: NDArray[np.intp], Z_s: Array, Z_u: Array) -> PlanPieces:
    """[Z; I] times the weights of the pieces: from x_e at their ends to the two-sided states [z; x_e] of a plan."""
    count, q = len(kind), Z_s.shape[2]
    Z_f, Z_b = np.zeros((count, Z_s.shape[1] + q, q)), np.zeros((count, Z_u.shape[1] + q, q))
    for j, piece in enumerate(pieces[k] for k in kind):
        n_s, n_u = len(piece.split.A_s), len(piece.split.A_u)
        Z_f[j, :n_s] = (Z_s[j, :n_s] + piece.steady_s) * piece.weights
        Z_b[j, :n_u] = (Z_u[j, :n_u] + piece.steady_u) * piece.weights
        Z_f[j, n_s : n_s + q] = Z_b[j, n_u : n_u + q] = np.diag(piece.weights)
    return PlanPieces(tuple(piece.plan for piece in pieces), kind, Z_f, Z_b)


def _times(trajectory: TwoSidedTrajectory, tolerance: float) -> tuple[float, float]:
    """How long before the first and after the last breakpoint [G; F] is away from the particular solution."""
    first, last = (trajectory.generators[trajectory.kind[end]] for end in (0, -1))
    before = Departure(-first.M_b[:-1, :-1], first.X_b[:, :-1], trajectory.v_b[0, : len(first.M_b) - 1])
    after = Departure(last.M_f[:-1, :-1], last.X_f[:, :-1], trajectory.v_f[-1, : len(last.M_f) - 1])
    # A part that does not decay relative to the exosystem's state never comes within the tolerance.
    lasting = [len(d.v) > 0 and bool(np.max(np.linalg.eigvals(d.M).real) >= 0) for d in (before, after)]
    nothing = Departure(np.zeros((0, 0)), np.zeros((len(first.X_b), 0)), np.zeros(0))
    decaying = [nothing if lasts else d for lasts, d in zip(lasting, (before, after), strict=True)]
    times = actuation_times(trajectory, (decaying[0], decaying[1]), tolerance, None)
    return (np.inf if lasting[0] else times[0]), (np.inf if lasting[1] else times[1])


def _boundary(
    trajectory: TwoSidedTrajectory, pieces: Sequence[MapPiece], kind: NDArray[np.intp], jumps: Jumps, admissible: Array
) -> float:
    """How far Z_s is from its particular solution just after the first breakpoint, and Z_u from its own just before the last one.

    From values of G inside the manoeuvre, on the admissible (weighted) states; where the plant is the same on both sides on all.
    """
    edges, worst = trajectory.breakpoints, 0.0
    for end, inside, part in ((0, 1, 0), (-1, len(kind) - 2, 1)):
        piece, q = pieces[kind[end]], len(admissible)
        n, w = len(piece.split.internal.form.V), column_weights(piece.weights)
        values = trajectory(edges[[end]], np.array([inside]), slice(0, n * q)).reshape(n, q) / w
        states = np.eye(q)
        if pieces[kind[inside]].split is not piece.split:
            states = jumps.Phi[end] @ admissible
        away = internal_parts(piece, (values - piece.base[:n]) @ states)[part]
        size = float(np.max(np.abs(values @ states), initial=0.0))
        worst = max(worst, float(np.max(np.abs(away), initial=0.0)) / (size if size > 0 else 1.0))
    return worst
