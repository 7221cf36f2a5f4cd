"""The pieces of an exosystem map: one plant, one exosystem, and the split equations of Z = [Z_s; Z_u] between two breakpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.errors import InversionError
from invtrack.inversion.inverse_system import InverseSystem
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.references.exosystem import Exosystem
from invtrack.references.generator import Generator
from invtrack.regulation.francis import francis

LARGEST_GROWTH = 3.0
"""Time constants of the exosystem within one piece: over more of them Z, relative to x_e, would grow or decay beyond e^3."""


def visibility(exosystem: Exosystem, plant: SwitchedSystem) -> Array:
    """How strongly each state shows in y_d, as powers of two w (q,): exact to divide by; zero for a state that never shows.

    w = |C_e| (I + |A_e| / s + ... + (|A_e| / s)^(q - 1)), with the largest entries of all intervals and outputs, and s the rate of
    the faster of exosystem and plant. Columns of the map from w x_e are of similar size whatever units the states of the exosystem
    came in. The pattern of the matrices alone decides what never shows: x_e need not be observable where w > 0.
    """
    M = np.max(np.abs(exosystem.A), axis=0)
    shown: Array = np.max(np.abs(exosystem.C), axis=(0, 1))
    matrices = [M, *(system.A for system in plant.distinct)]
    rate = max(float(np.max(np.abs(np.linalg.eigvals(matrix)))) for matrix in matrices)
    term = shown
    for _ in range(exosystem.n_states - 1):
        term = term @ M / (rate if rate > 0 else 1.0)  # integrators alone have no rate of their own
        shown = shown + term
    seen = shown > 0
    return np.where(seen, np.exp2(np.rint(np.log2(np.where(seen, shown, 1.0)))), 0.0)


def column_weights(weights: Array) -> Array:
    """Weights to divide by (q,): 1 for a state that never shows, whose columns are zero."""
    return np.where(weights > 0, weights, 1.0)


def unweighted(states: Array, weights: Array) -> Array:
    """The states x_e in the columns of `states` (q, d) = w x_e, to unit length."""
    found = states / column_weights(weights)[:, None]
    return np.asarray(found / np.linalg.norm(found, axis=0))


@dataclass(frozen=True, eq=False)
class MapPiece:
    """G and F of one plant and one exosystem: [G; F] = base + from_s Z_s + from_u Z_u.

    Z_s' = A_s Z_s - Z_s A_e + D_s, forward from the piece's start, Z_u' = A_u Z_u - Z_u A_e + D_u, backward from its end. On pieces
    without end Z_s, Z_u are distances from the bounded particular solution steady_s, steady_u, which is then in `base`. All of this
    holds for the exosystem's states times their weights.

    Args:
        split: split internal dynamics of the plant.
        A_e: that of the exosystem (q, q).
        from_s, from_u: (n + p, n_s) and (n + p, n_u).
        base: (n + p, q).
        D_s, D_u: (n_s, q) and (n_u, q), zero on pieces without end.
        steady_s, steady_u: (n_s, q) and (n_u, q), zero on all other pieces.
        plan: the inverse of the plant driven by the exosystem, whose states are (Z_s + steady_s) x_e and (Z_u + steady_u) x_e.
        weights: of the exosystem's states (q,), see `visibility`.
    """

    split: SplitDynamics
    A_e: Array
    from_s: Array
    from_u: Array
    base: Array
    D_s: Array
    D_u: Array
    steady_s: Array
    steady_u: Array
    plan: DrivenSystem
    weights: Array

    @cached_property
    def driven(self) -> DrivenSystem:
        """The piece as a two-sided system: vec(Z_s), vec(Z_u) row by row, driven by a reference that stays at 1.

        Its values are [G; F] row by row, in the states' own units; vec(Z A_e) = (I x A_e') vec(Z). What is continuous is G.
        """
        form, q, n = self.split.internal.form, len(self.A_e), len(self.split.internal.form.V)
        T = np.vstack([form.C_star, self.split.L_s @ form.N, self.split.L_u @ form.N])
        parts: list[Part] = []
        for A, X in ((self.split.A_s, self.from_s), (self.split.A_u, self.from_u)):
            K = _kron(A, np.eye(q)) - _kron(np.eye(len(A)), self.A_e.T)
            parts.append(Part(K, _kron(X, np.diag(self.weights)), _kron(X[:n], np.eye(q))))
        return DrivenSystem(
            system=TwoSidedSystem(parts[0], parts[1], _kron(T, np.eye(q)), len(form.C_star) * q),
            S=np.zeros((1, 1)),
            D_f=self.D_s.reshape(-1, 1),
            D_b=self.D_u.reshape(-1, 1),
            X_w=(self.base * self.weights).reshape(-1, 1),
            J_w=self.base[:n].reshape(-1, 1),
        )


def map_pieces(
    plant: SwitchedSystem, splits: Sequence[SplitDynamics], exosystem: Exosystem, breakpoints: Array, weights: Array
) -> tuple[list[MapPiece], Indices]:
    """The distinct pieces, and which of them lies before, between and after the breakpoints, (m + 2,).

    Args:
        plant: the plant.
        splits: split internal dynamics of each of its intervals.
        exosystem: as it was given, not weighted.
        breakpoints: those of the map (m + 1,) [s], see `map_breakpoints`.
        weights: of the exosystem's states (q,), see `visibility`.
    """
    exosystem = exosystem.weighted(weights)
    middles = inner_times(breakpoints)
    found: dict[tuple[int, int, bool], int] = {}
    pieces: list[MapPiece] = []
    kind = np.empty(len(middles), dtype=np.intp)
    owners = zip(plant.interval(middles).tolist(), exosystem.interval(middles).tolist(), strict=True)
    for j, (k, e) in enumerate(owners):
        identity = (int(plant.numbers[k]), int(exosystem.numbers[e]), j in (0, len(middles) - 1))
        if identity not in found:
            found[identity] = len(pieces)
            pieces.append(_map_piece(plant.systems[k], splits[k], exosystem.A[e], exosystem.C[e], identity[2], weights))
        kind[j] = found[identity]
    return pieces, kind


def inner_times(breakpoints: Array) -> Array:
    """One time inside each piece (m + 2,)."""
    middles = (breakpoints[:-1] + breakpoints[1:]) / 2
    return np.concatenate([[breakpoints[0] - 1.0], middles, [breakpoints[-1] + 1.0]])


def map_breakpoints(plant: SwitchedSystem, exosystem: Exosystem) -> Array:
    """Switch times of plant and exosystem, and stops between them where the exosystem grows or decays; 0 if nothing switches."""
    edges = np.union1d(plant.switch_times, exosystem.switch_times)
    if not edges.size:
        return np.zeros(1)
    rates = np.array([np.max(np.abs(np.linalg.eigvals(A_e).real)) for A_e in exosystem.A])
    growth = rates[exosystem.interval((edges[:-1] + edges[1:]) / 2)] * np.diff(edges)
    long = np.flatnonzero(growth > LARGEST_GROWTH)
    stops = [np.linspace(edges[j], edges[j + 1], int(np.ceil(growth[j] / LARGEST_GROWTH)) + 1)[1:-1] for j in long]
    return np.sort(np.concatenate([edges, *stops]))


def _map_piece(system: StateSpace, split: SplitDynamics, A_e: Array, C_e: Array, endless: bool, weights: Array) -> MapPiece:
    n, m = system.n_states, system.n_inputs
    if endless and np.any(C_e):
        _require_no_resonance(system, A_e, C_e)
    plan = InverseSystem.of(system, split).driven(Generator(A_e, C_e))
    from_s, from_u, from_w = (X[: n + m] for X in (plan.system.forward.X, plan.system.backward.X, plan.X_w))
    steady_s, steady_u = plan.steady() if endless else (np.zeros_like(plan.D_f), np.zeros_like(plan.D_b))
    return MapPiece(
        split=split,
        A_e=A_e,
        from_s=from_s,
        from_u=from_u,
        base=from_w + from_s @ steady_s + from_u @ steady_u,
        D_s=np.zeros_like(plan.D_f) if endless else plan.D_f,
        D_u=np.zeros_like(plan.D_b) if endless else plan.D_b,
        steady_s=steady_s,
        steady_u=steady_u,
        plan=plan,
        weights=weights,
    )


def _kron(A: Array, B: Array) -> Array:
    return np.asarray(np.kron(A, B), dtype=np.float64)


def _require_no_resonance(system: StateSpace, A_e: Array, C_e: Array) -> None:
    try:
        francis(system, A_e, C_e)
    except InversionError as error:
        raise InversionError(f"the exosystem runs, or holds its output, without end: {error}") from error


def internal_parts(piece: MapPiece, G: Array) -> tuple[Array, Array]:
    """L_s N G and L_u N G: the internal coordinates of a map G (n, q)."""
    eta = piece.split.internal.form.N @ G
    return piece.split.L_s @ eta, piece.split.L_u @ eta
