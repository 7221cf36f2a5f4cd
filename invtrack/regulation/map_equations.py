"""The boundary value problem of an exosystem map: all columns of G at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.inversion.bounded_solution.junctions import SAME_ROW_TOLERANCE
from invtrack.plans.boundary_value import BoundaryValueSolution, Conditions, solve
from invtrack.regulation.map_pieces import MapPiece, transition

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class _Side:
    """Linear form known + (row blocks) v of something in the unknowns v of one piece: rows (r q, .), known (r q,)."""

    rows: Array
    known: Array


def solve_map(pieces: Sequence[MapPiece], kind: NDArray[np.intp], breakpoints: Array) -> tuple[BoundaryValueSolution, Array, Array]:
    """Z_s at the start and Z_u at the end of each piece: the solution, Z_s (m + 2, n_s, q) and Z_u (m + 2, n_u, q).

    Unknown are vec(Z_u) at the first breakpoint for the piece before it, vec(Z_s) at the last one for the piece after it, and both,
    each at the end from which it is integrated, for the pieces in between. At each breakpoint the internal state N G is continuous,
    in the coordinates of the plant on the right; rows of C* that hold unknowns (outputs that change with the plant) are
    conditions, the others are what decides which exosystem states are admissible.
    """
    sequence = [pieces[k] for k in kind]
    lengths = [0.0, *np.diff(breakpoints).tolist(), 0.0]
    ends = [_state_at_end(piece, length) for piece, length in zip(sequence[:-1], lengths[:-1], strict=True)]
    junctions = [_junction(ends[j], sequence[j], sequence[j + 1], lengths[j + 1]) for j in range(len(breakpoints))]
    first, last = (
        Conditions(np.zeros((0, _unknowns(piece))), np.zeros((0, 0)), np.zeros(0)) for piece in (sequence[0], sequence[-1])
    )
    solution = solve(first, junctions, last)
    q = len(sequence[0].A_e)
    n_s, n_u = (max(len(A) for A in parts) for parts in zip(*((p.split.A_s, p.split.A_u) for p in pieces), strict=True))
    Z_s, Z_u = np.zeros((len(kind), n_s, q)), np.zeros((len(kind), n_u, q))
    for j, (piece, value) in enumerate(zip(sequence, solution.values, strict=True)):
        s, u = _sizes(piece)
        Z_s[j, : s // q], Z_u[j, : u // q] = value[:s].reshape(-1, q), value[s:].reshape(-1, q)
    return solution, Z_s, Z_u


def _sizes(piece: MapPiece) -> tuple[int, int]:
    """How many entries of Z_s and of Z_u are unknowns of a piece."""
    q = len(piece.A_e)
    return (
        0 if piece.place == "before" else len(piece.split.A_s) * q,
        0 if piece.place == "after" else len(piece.split.A_u) * q,
    )


def _per_column(M: Array, q: int) -> Array:
    """What M does to each of q columns, on vec: vec(M Z) = (M x I) vec(Z)."""
    return np.asarray(np.kron(M, np.eye(q)), dtype=np.float64)


def _unknowns(piece: MapPiece) -> int:
    return sum(_sizes(piece))


def _state_at_end(piece: MapPiece, length: float) -> _Side:
    """vec(G) at the end of a piece, in its unknowns."""
    q, n = len(piece.A_e), len(piece.split.internal.form.V)
    from_s, from_u = _per_column(piece.from_s[:n], q), _per_column(piece.from_u[:n], q)
    base: Array = piece.base[:n].reshape(-1)
    if piece.place == "before":
        return _Side(from_u, base)
    E, p = transition(piece, length, "forward")
    return _Side(np.hstack([from_s @ E, from_u]), base + from_s @ p)


def _junction(left: _Side, before: MapPiece, after: MapPiece, length: float) -> Conditions:
    """Continuity of vec(G) between two pieces, in the internal coordinates of the second; rows scaled to unit size."""
    q, form, split = len(before.A_e), after.split.internal.form, after.split
    n, rho, n_s, n_u = len(form.V), len(form.C_star), len(split.A_s), len(split.A_u)
    T = np.vstack([form.C_star, split.L_s @ form.N, split.L_u @ form.N])
    rows_left = _per_column(T, q) @ left.rows
    # The difference first: where nothing switches it is zero to the last bit, and so is what would grow out of it.
    rhs = -(T @ (left.known - after.base[:n].reshape(-1)).reshape(n, q)).reshape(-1)
    columns_s, columns_u = _sizes(after)
    rows_right = np.zeros((len(T) * q, columns_s + columns_u))
    of_s, of_u = slice(rho * q, (rho + n_s) * q), slice((rho + n_s) * q, len(T) * q)
    rows_right[of_s, :columns_s] = -np.eye(n_s * q)
    if after.place == "inside":
        E, p = transition(after, length, "backward")
        rows_right[of_u, columns_s:] = -E
        rhs[of_u] += p
    # Rows of C* that are the same on both sides hold no unknown.
    from_z = np.hstack([before.from_s[:n], before.from_u[:n]])
    row_size = np.max(np.abs(form.C_star) @ np.abs(from_z), axis=1, initial=0.0)
    held = np.max(np.abs(form.C_star @ from_z), axis=1, initial=0.0) > SAME_ROW_TOLERANCE * row_size
    kept = np.concatenate([np.repeat(held, q), np.ones((n_s + n_u) * q, dtype=bool)])
    scale = np.concatenate([np.repeat(row_size[held], q), np.ones((n_s + n_u) * q)])
    return Conditions(rows_left[kept] / scale[:, None], rows_right[kept] / scale[:, None], rhs[kept] / scale)
