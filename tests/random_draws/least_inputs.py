"""Whether the inputs of a plan are the least ones that follow the reference: no change of them that no output shows is cheaper.

The motions that no output shows come from the reduction of the system matrix (see `invariant_zeros`), not from invtrack.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import scipy.interpolate
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.plans.plan import Plan
from tests.random_draws.invariant_zeros import (
    EPS,
    MARGIN,
    Judgement,
    Verdict,
    compressed,
    conditioned_modes,
    without_infinite_zeros,
)
from tests.random_draws.plants import Matrices, Units
from tests.random_draws.shooting import NODES, WEIGHTS, Steps

PLACES = (1 + np.polynomial.legendre.leggauss(8)[0]) / 2
"""Gauss points of a cell, as shares of its length."""

MOST_GROWTH = 20.0
"""No change grows, or has to grow, by more than e to this power within a window, in which rounding would drown it."""

MOST_CELLS = 80
"""Cells of a window at most, where the plant's order does not take more; it is shorter then."""

FURTHER = 20
"""Changes beyond those that it takes to bring the plant to rest again."""


@dataclass(frozen=True, eq=False)
class HiddenMotions:
    """x = V z, u = K z + N w with z' = A z + B w: all motions that no output shows, in what w moves and what it does not.

    Args:
        A, B: (k, k) and (k, m - p), in coordinates of which w moves the first `moved` ones and no others.
        K, N: (m, k) and (m, m - p).
        moved: how many.
        clear: whether every rank on the way was clear.
    """

    A: Array
    B: Array
    K: Array
    N: Array
    moved: int
    clear: bool

    @classmethod
    def of(cls, plant: Matrices) -> HiddenMotions | None:
        """Those of a plant with more inputs than outputs; None where it has no right inverse."""
        size = float(np.linalg.norm(np.block([[plant.A, plant.B], [plant.C, plant.D]]), 2))
        reduced, _, clear = without_infinite_zeros(plant, size)
        if reduced is None:
            return None
        N = scipy.linalg.null_space(reduced.D)
        K = -np.linalg.pinv(reduced.D) @ reduced.C
        A, B = reduced.A + reduced.B @ K, reduced.B @ N
        T, moved, certain = _reached(A, B, float(np.linalg.norm(A, 2)), float(np.linalg.norm(B, 2)))
        return cls(T.T @ A @ T, T.T @ B, K @ T, N, moved, clear and certain)

    def judgement(self, R: Array) -> Judgement:
        """Whether a least input exists, with the modes of the optimum (they come in pairs on both sides of the axis) as zeros.

        Zeros that w does not move decide by themselves. On the axis may also lie modes that cost nothing: either answer is right.
        """
        k, none = self.moved, np.zeros(0)
        left = conditioned_modes(self.A[k:, k:], float(np.linalg.norm(self.A, 2)) if self.A.size else 0.0)
        H = self.optimum(R)
        modes = conditioned_modes(H, float(np.linalg.norm(H, 2)) if H.size else 0.0)
        verdict: Verdict = "solvable" if self.clear else "band"
        for (values, resolved), on_axis in ((left, "on the axis"), (modes, "band")):
            distance = np.abs(values.real)
            if verdict == "solvable" and np.any(distance <= 10 * resolved):
                verdict = "on the axis" if on_axis == "on the axis" else "band"
            elif verdict == "solvable" and np.any(distance < MARGIN * resolved):
                verdict = "band"
        return Judgement(verdict, np.concatenate([left[0], modes[0]]), none, 0)

    def optimum(self, R: Array) -> Array:
        """The Hamiltonian matrix (2 moved, 2 moved) of the least integral of u'R u."""
        k = self.moved
        A, B, K = self.A[:k, :k], self.B[:k], self.K[:, :k]
        weight, cross = self.N.T @ R @ self.N, self.N.T @ R @ K
        law = np.linalg.solve(weight, cross)
        A = A - B @ law
        return np.block([[A, -B @ np.linalg.solve(weight, B.T)], [-(K.T @ R @ K - cross.T @ law), -A.T]])


def _reached(A: Array, B: Array, A_size: float, B_size: float) -> tuple[Array, int, bool]:
    """T orthogonal with the states that B reaches through A first, how many they are, and whether every rank was clear."""
    T, reached, clear = np.eye(len(A)), 0, True
    block, size = B, B_size
    while reached < len(A):
        U, rank, certain = compressed(block, size)
        clear &= certain
        T = np.hstack([T[:, :reached], T[:, reached:] @ U])
        if not rank:
            break
        block, size = (T.T @ A @ T)[reached + rank :, reached : reached + rank], A_size
        reached += rank
    return T, reached, clear


@dataclass(frozen=True, eq=False)
class _Changes:
    """Changes of the input that no output shows, from rest to rest within a window: u = sum of c_j (K z_j + N w_j).

    w_j is a bump over two cells of the window, in one direction. Within a cell z is the polynomial that obeys z' = A z + B w at
    Gauss points (collocation, of order 16); c is any vector for which z is at rest again where the window ends.

    Args:
        motions: of the plant.
        edges: of the cells (M + 1,), all of one length [s].
        z: of each change at the start and at the Gauss points of each cell (M, 9, k, j).
        w: at the same places (M, 9, m - p, j).
        left: what the changes leave at the end of the window (k, j).
    """

    motions: HiddenMotions
    edges: Array
    z: Array
    w: Array
    left: Array

    @classmethod
    def of(cls, motions: HiddenMotions, edges: Array) -> _Changes:
        """All bumps over cells with these edges (M + 1,)."""
        A, B = motions.A[: motions.moved, : motions.moved], motions.B[: motions.moved]
        (k, extra), h, cells = B.shape, float(edges[1] - edges[0]), len(edges) - 1
        places = np.append(0.0, PLACES)
        rising, falling = _bump(places / 2), _bump((1 + places) / 2)
        integrals = _integrals(PLACES)
        solver = scipy.linalg.lu_factor(np.eye(len(PLACES) * k) - h * np.kron(integrals[:-1], A)) if k else None
        w = np.zeros((cells, len(places), extra, cells - 1, extra))
        for bump in range(cells - 1):
            w[bump, :, range(extra), bump, range(extra)] = rising
            w[bump + 1, :, range(extra), bump, range(extra)] = falling
        w = w.reshape(cells, len(places), extra, -1)
        z, state = np.zeros((cells, len(places), k, w.shape[-1])), np.zeros((k, w.shape[-1]))
        for cell in range(cells if solver is not None else 0):
            push = np.einsum("ij,jab->iab", h * integrals, B @ w[cell, 1:])
            inner = scipy.linalg.lu_solve(solver, (state + push[:-1]).reshape(-1, w.shape[-1])).reshape(len(PLACES), k, -1)
            z[cell] = np.concatenate([state[None], inner])
            state = state + push[-1] + h * np.einsum("j,jab->ab", integrals[-1], A @ inner)
        return cls(motions, edges, z, w, state)

    def inputs(self, cell: int, t: Array) -> Array:
        """Of each change, the input at times within a cell (t, m, j)."""
        since = (t - self.edges[cell]) / (self.edges[cell + 1] - self.edges[cell])
        at = scipy.interpolate.BarycentricInterpolator(np.append(0.0, PLACES), np.eye(len(PLACES) + 1))(since)
        k = self.motions.moved
        z, w = (np.einsum("ti,iab->tab", at, values[cell]) for values in (self.z, self.w))
        return np.asarray(self.motions.K[:, :k] @ z + self.motions.N @ w)


def _bump(s: Array) -> Array:
    """16 s^2 (1 - s)^2."""
    return 16 * s**2 * (1 - s) ** 2


def _integrals(places: Array) -> Array:
    """Of the polynomials that are 1 at one place in [0, 1] and 0 at the others, the integrals up to each place and up to 1."""
    powers = np.vander(places, increasing=True)
    order = np.arange(1, len(places) + 1)
    up_to = np.append(places, 1.0)[:, None] ** order / order
    return np.asarray(np.linalg.solve(powers.T, up_to.T).T)


def gain(plan: Plan, plant: Matrices, units: Units, R: Array, zeros: ComplexArray) -> float:
    """The root of the share of its cost, counted in a window around the manoeuvre, that a plan's input could still save there.

    Of all combinations of the changes of a window the best one is taken: with J the integral of u'R u, b of u'R v_j and G of
    v_i'R v_j, what is saved is b'c for G c = b, as far as they leave the plant at rest.
    """
    motions = HiddenMotions.of(plant)
    assert motions is not None
    held, root = _held(plant, R), np.linalg.cholesky(R).T
    start, end = plan.manoeuvre
    duration = max(end - start, 1e-3)
    modes = np.linalg.eigvals(motions.A[: motions.moved, : motions.moved])
    pace = max(float(np.linalg.norm(M, 2)) if M.size else 0.0 for M in (motions.A[: motions.moved, : motions.moved], plant.A))
    grows = max(float(np.max(np.abs(modes.real), initial=0.0)), 1e-9)
    least = (motions.moved + FURTHER) // motions.N.shape[1] + 2
    cells = int(np.clip(np.ceil(2 * duration * pace), least, max(least, MOST_CELLS)))
    length = min(2 * duration, cells / max(pace, 1e-9), MOST_GROWTH / grows)
    changes = _Changes.of(motions, start + (duration - length) / 2 + length * np.linspace(0.0, 1.0, cells + 1))
    steps = Steps.of([pace], zeros, duration)
    cost, along, size = 0.0, np.zeros(changes.left.shape[1]), np.zeros((changes.left.shape[1],) * 2)
    for cell, (a, b) in enumerate(itertools.pairwise(changes.edges.tolist())):
        for first, last in itertools.pairwise(_edges(plan, a, b, steps).tolist()):
            t, shares = first + (last - first) * (1 + NODES) / 2, (WEIGHTS * (last - first) / 2)[:, None]
            s = plan(t)
            u = (s.u / units.u - (s.y_d / units.y) @ held.T) @ root.T
            v = np.sqrt(shares)[:, :, None] * (root @ changes.inputs(cell, t))
            u, v = (np.sqrt(shares) * u).ravel(), v.reshape(-1, v.shape[-1])
            cost, along, size = cost + float(u @ u), along + u @ v, size + v.T @ v
    left = changes.left / np.maximum(np.max(np.abs(changes.left), axis=1, keepdims=True, initial=0.0), np.finfo(float).tiny)
    free = scipy.linalg.null_space(left)
    best, slope = free.T @ size @ free, free.T @ along
    scale = np.sqrt(np.diag(best))
    saved = slope / scale @ np.linalg.lstsq(best / np.outer(scale, scale), slope / scale, rcond=1e-10)[0]
    return float(np.sqrt(max(saved, 0.0) / cost)) if cost > 0 else 0.0


def _edges(plan: Plan, a: float, b: float, steps: Steps) -> Array:
    """Edges of stretches of a cell from a to b [s], fine next to where the plan may be fast."""
    stops = np.union1d(plan.breakpoints, plan.reference.breakpoints)
    layer = np.array([0.0, *(since + h for since, h in steps.layer(max(b - a, steps.coarse)))])
    inner = np.concatenate([stops[:, None] + layer, stops[:, None] - layer]).ravel()
    found = np.unique(np.concatenate([[a, b], inner[(inner > a) & (inner < b)]]))
    return found[np.append(True, np.diff(found) > 1e-13 * max(abs(a), abs(b), 1.0))]


def _held(plant: Matrices, R: Array) -> Array:
    """N_u (m, p): the least u'R u that holds each output at one, by its optimality conditions; zero where one cannot be held."""
    n, p, m = len(plant.A), plant.p, plant.B.shape[1]
    M = np.block([[plant.A, plant.B], [plant.C, plant.D]])
    K = np.block([[np.zeros((n, n + m)), M.T[:n]], [np.zeros((m, n)), R, M.T[n:]], [M, np.zeros((n + p, n + p))]])
    wanted = np.vstack([np.zeros((2 * n + m, p)), np.eye(p)])
    found = np.linalg.lstsq(K, wanted, rcond=EPS * MARGIN)[0]
    possible = np.max(np.abs(K @ found - wanted)) < 1e-6
    return np.asarray(found[n : n + m] if possible else np.zeros((m, p)))
