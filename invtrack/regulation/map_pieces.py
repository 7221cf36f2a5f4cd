"""The pieces of an exosystem map: one plant, one exosystem, and the split equations of Z = [Z_s; Z_u] between two breakpoints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.errors import InversionError
from invtrack.inversion.bounded_solution.pieces import InversePiece, inverse_piece
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import TwoSidedGenerator
from invtrack.references.exosystem import Exosystem
from invtrack.references.signal import Generator
from invtrack.regulation.francis import francis

Array = NDArray[np.float64]

Place = Literal["before", "inside", "after"]

LARGEST_GROWTH = 3.0
"""Time constants of the exosystem within one piece: over more of them Z, relative to x_e, would grow or decay beyond e^3."""


@dataclass(frozen=True, eq=False)
class MapPiece:
    """G and F of one plant and one exosystem: [G; F] = base + from_s Z_s + from_u Z_u.

    Z_s' = A_s Z_s - Z_s A_e + D_s, forward from the piece's start, Z_u' = A_u Z_u - Z_u A_e + D_u, backward from its end. On pieces
    without end Z_s, Z_u are distances from the bounded particular solution steady_s, steady_u, which is then in `base`, and D_s and
    D_u are zero. Shapes: from_s (n + p, n_s), from_u (n + p, n_u), base (n + p, q), D_s (n_s, q), D_u (n_u, q). All of this holds
    for the exosystem's states times their `weights` (q,). plan: the generator of [x; u; y] for one trajectory of it.
    """

    place: Place
    split: SplitDynamics
    A_e: Array
    from_s: Array
    from_u: Array
    base: Array
    D_s: Array
    D_u: Array
    steady_s: Array
    steady_u: Array
    plan: TwoSidedGenerator
    weights: Array

    @cached_property
    def constant(self) -> float:
        """The constant beside the entries of Z: a power of two with which the drive D / constant is no larger than the dynamics."""
        drive = max(float(np.max(np.abs(D), initial=0.0)) for D in (self.D_s, self.D_u))
        pace = max(float(np.linalg.norm(A)) for A in (self.split.A_s, self.split.A_u, self.A_e))
        return float(2.0 ** np.ceil(np.log2(drive / pace))) if drive > 0 and pace > 0 else 1.0

    @cached_property
    def generator(self) -> TwoSidedGenerator:
        """[G; F] row by row, in the states' own units, from v = [Z row by row; constant]; vec(Z A_e) = (I x A_e') vec(Z)."""
        none, base = np.zeros((0, 0)), (self.base * self.weights).reshape(-1, 1) / self.constant
        no_columns, zero = np.zeros((base.size, 0)), np.zeros_like(base)
        M_s, M_u = (self._driven(A, D) for A, D in ((self.split.A_s, self.D_s), (self.split.A_u, self.D_u)))
        X_s, X_u = np.kron(self.from_s, np.diag(self.weights)), np.kron(self.from_u, np.diag(self.weights))
        if self.place == "before":
            return TwoSidedGenerator(none, no_columns, M_u, np.hstack([X_u, base]))
        if self.place == "after":
            return TwoSidedGenerator(M_s, np.hstack([X_s, base]), none, no_columns)
        return TwoSidedGenerator(M_s, np.hstack([X_s, base]), M_u, np.hstack([X_u, zero]))

    @property
    def settled(self) -> TwoSidedGenerator:
        """[G; F] of an endless piece whose Z is zero: constant for all time, where its equations might grow without bound."""
        none, base = np.zeros((0, 0)), (self.base * self.weights).reshape(-1, 1) / self.constant
        no_columns, still = np.zeros((base.size, 0)), np.zeros((1, 1))
        if self.place == "before":
            return TwoSidedGenerator(none, no_columns, still, base)
        return TwoSidedGenerator(still, base, none, no_columns)

    def _driven(self, A: Array, D: Array) -> Array:
        q = len(self.A_e)
        K = np.kron(A, np.eye(q)) - np.kron(np.eye(len(A)), self.A_e.T)
        return np.block([[K, D.reshape(-1, 1) / self.constant], [np.zeros((1, len(K) + 1))]])


def map_pieces(
    plant: SwitchedSystem, splits: Sequence[SplitDynamics], exosystem: Exosystem, breakpoints: Array, weights: Array
) -> tuple[list[MapPiece], NDArray[np.intp]]:
    """The distinct pieces, and which of them lies before, between and after the breakpoints, (m + 2,); weights: `visibility`."""
    exosystem = exosystem.weighted(weights)
    middles = inner_times(breakpoints)
    keys: list[tuple[int, int, Place]] = []
    for j, (k, e) in enumerate(zip(plant.interval(middles).tolist(), exosystem.interval(middles).tolist(), strict=True)):
        keys.append((k, e, "before" if j == 0 else "after" if j == len(middles) - 1 else "inside"))
    found: dict[tuple[int, int, int, Place], int] = {}
    pieces: list[MapPiece] = []
    kind = np.empty(len(keys), dtype=np.intp)
    for j, (k, e, place) in enumerate(keys):
        identity = (id(plant.systems[k]), id(exosystem.A[e]), id(exosystem.C[e]), place)
        if identity not in found:
            found[identity] = len(pieces)
            pieces.append(_map_piece(plant.systems[k], splits[k], exosystem.A[e], exosystem.C[e], place, weights))
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


def _map_piece(system: StateSpace, split: SplitDynamics, A_e: Array, C_e: Array, place: Place, weights: Array) -> MapPiece:
    n, p = system.n_states, system.n_channels
    endless = place != "inside"
    if endless and np.any(C_e):
        _require_no_resonance(system, A_e, C_e)
    inverse = inverse_piece(system, split, Generator(A_e, C_e), endless=endless)
    n_s, n_u = len(split.A_s), len(split.A_u)
    from_s, from_w = inverse.inside.X_f[: n + p, :n_s], inverse.inside.X_f[: n + p, n_s:]
    from_u = inverse.inside.X_b[: n + p, :n_u]
    return MapPiece(
        place=place,
        split=split,
        A_e=A_e,
        from_s=from_s,
        from_u=from_u,
        base=from_w + from_s @ inverse.steady_s + from_u @ inverse.steady_u,
        D_s=np.zeros_like(inverse.D_s) if endless else inverse.D_s,
        D_u=np.zeros_like(inverse.D_u) if endless else inverse.D_u,
        steady_s=inverse.steady_s,
        steady_u=inverse.steady_u,
        plan=_plan(inverse, place),
        weights=weights,
    )


def _plan(inverse: InversePiece, place: Place) -> TwoSidedGenerator:
    return {"before": inverse.before, "inside": inverse.inside, "after": inverse.after}[place]


def _require_no_resonance(system: StateSpace, A_e: Array, C_e: Array) -> None:
    try:
        francis(system, A_e, C_e)
    except InversionError as error:
        raise InversionError(f"the exosystem runs, or holds its output, without end: {error}") from error


def internal_parts(piece: MapPiece, G: Array) -> tuple[Array, Array]:
    """L_s N G and L_u N G: the internal coordinates of a map G (n, q)."""
    eta = piece.split.internal.form.N @ G
    return piece.split.L_s @ eta, piece.split.L_u @ eta


def transition(piece: MapPiece, length: float, direction: Literal["forward", "backward"]) -> tuple[Array, Array]:
    """E, p with vec(Z) at the far end = E vec(Z) at the near one + p, over `length` [s]: Z_s forward, Z_u backward."""
    M = piece.generator.M_f if direction == "forward" else -piece.generator.M_b
    carried = scipy.linalg.expm(M * length)
    return carried[:-1, :-1], carried[:-1, -1] * piece.constant
