"""The Riccati equation of optimal feedback, backward along a plan, in square-root form.

Over a stretch of time with constant A and B the equation is solved exactly: with costates, x_1 = F x_0 - G lambda_1 and
lambda_0 = H x_0 + F' lambda_1, hence X_0 = H + F' X_1 (I + G X_1)^-1 F with G, H >= 0. Of two stretches one after the other F, G, H
follow from those of each without a subtraction (structure-preserving doubling: E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, Linear Algebra
and its Applications 396, 2005), so that stretches may be long against the fastest modes; X is carried on as a factor, X = L L', by
orthogonal transformations alone (T. Kailath, A. Sayed, B. Hassibi, Linear Estimation, 2000, section 12.2), and stays >= 0.
"""

from __future__ import annotations

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.plans.linearizations import Linearizations

SHORT = 0.5
"""Parts are short enough for a matrix exponential where their Hamiltonian times their length is below this."""

IN_MEMORY = 2**22
"""Numbers that exponentials are made of, held in memory at once."""


def riccati_along(along: Linearizations, Q: Array, R: Array, last: Array) -> Array:
    """Gains K = R^-1 B'X (N, m, n) in the middles of N stretches, X being `last` (n, n) at their end.

    Source: the Hamiltonian matrix of the regulator problem, for instance B. Anderson, J. Moore, Optimal Control, 1990, section 2.3.
    """
    size = 1 / np.sqrt(np.where(np.diag(last) > 0, np.diag(last), 1.0))  # of states that cost as much as each other
    A, B = along.A * size / size[:, None], along.B / size[:, None]
    F, G_root, H_root = _stretches(A, B @ np.linalg.solve(R, B.transpose(0, 2, 1)), Q * np.outer(size, size), along.lengths / 2)
    n, L = len(last), _root((last * np.outer(size, size))[None])[0]
    gains = np.empty((len(along), B.shape[2], n))
    for k in range(len(along) - 1, -1, -1):
        L = _carried(L, F[k], G_root[k], H_root[k])
        gains[k] = np.linalg.solve(R, (B[k].T @ L) @ L.T)
        L = _carried(L, F[k], G_root[k], H_root[k])
    return np.asarray(gains / size)


def _carried(L: Array, F: Array, G_root: Array, H_root: Array) -> Array:
    """L with L L' = H + F' X (I + G X)^-1 F, for X = L L', G = G_root G_root', H = H_root H_root'."""
    n = len(L)
    rows = np.zeros((3 * n, 2 * n))
    rows[:n, :n] = np.eye(n)
    rows[n : 2 * n, :n], rows[n : 2 * n, n:] = L.T @ G_root, L.T @ F
    rows[2 * n :, n:] = H_root.T
    return np.asarray(scipy.linalg.qr(rows, mode="r", overwrite_a=True, check_finite=False)[0][n : 2 * n, n:].T)


def _stretches(A: Array, S: Array, Q: Array, lengths: Array) -> tuple[Array, Array, Array]:
    """F and roots of G and H (N, n, n) over stretches of these lengths (N,) [s]; S = B R^-1 B'."""
    N, n = A.shape[:2]
    cost = np.sqrt(float(np.max(np.abs(S), initial=0.0) / (np.max(np.abs(Q)) or 1.0))) or 1.0  # a unit in which S and Q are alike
    hamiltonian = np.empty((N, 2 * n, 2 * n))
    hamiltonian[:, :n, :n], hamiltonian[:, :n, n:] = A, -S / cost
    hamiltonian[:, n:, :n], hamiltonian[:, n:, n:] = -Q * cost, -A.transpose(0, 2, 1)
    sizes = np.linalg.norm(hamiltonian, ord=1, axis=(1, 2)) * lengths
    doublings = np.maximum(np.ceil(np.log2(np.maximum(sizes / SHORT, 1.0))), 0).astype(int)
    F, G, H = (np.empty((N, n, n)) for _ in range(3))
    block = max(1, IN_MEMORY // (2 * n) ** 2)
    for count in np.unique(doublings):
        alike = np.flatnonzero(doublings == count)
        for chosen in np.split(alike, range(block, len(alike), block)):
            flow = scipy.linalg.expm(hamiltonian[chosen] * (lengths[chosen] / 2.0**count)[:, None, None])
            F[chosen], G[chosen], H[chosen] = _doubled(*_scattering(flow), int(count))
    return F, _root(G * cost), _root(H / cost)


def _scattering(flow: Array) -> tuple[Array, Array, Array]:
    """F, G, H (k, n, n) of flows [x; lambda] -> flow [x; lambda] (k, 2 n, 2 n)."""
    n = flow.shape[1] // 2
    from_left = np.linalg.solve(
        flow[:, n:, n:], np.concatenate([-flow[:, n:, :n], np.broadcast_to(np.eye(n), (len(flow), n, n))], 2)
    )
    H, F_transposed = from_left[:, :, :n], from_left[:, :, n:]
    return F_transposed.transpose(0, 2, 1), _symmetric(-flow[:, :n, n:] @ F_transposed), _symmetric(H)


def _doubled(F: Array, G: Array, H: Array, times: int) -> tuple[Array, Array, Array]:
    """F, G, H over stretches 2^times as long."""
    unit = np.eye(F.shape[1])
    for _ in range(times):
        inner = np.linalg.solve(unit + G @ H, np.concatenate([F, G @ F.transpose(0, 2, 1)], axis=2))
        W, V = inner[:, :, : F.shape[1]], inner[:, :, F.shape[1] :]
        G, H, F = _symmetric(G + F @ V), _symmetric(H + F.transpose(0, 2, 1) @ H @ W), F @ W
    return F, G, H


def _root(matrices: Array) -> Array:
    """Factors P with P P' = the positive semidefinite matrices (k, n, n)."""
    values, vectors = np.linalg.eigh(_symmetric(matrices))
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0))[:, None, :])


def _symmetric(matrices: Array) -> Array:
    return np.asarray((matrices + matrices.transpose(0, 2, 1)) / 2)
