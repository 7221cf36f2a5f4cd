"""Forced response of a linear system across very many pieces, without a Python step for each."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from invtrack.lti.propagation import Propagator

Array = NDArray[np.float64]


def forced_states(propagator: Propagator, added: Array, lengths: Array) -> Array:
    """z_0 = 0, z_(j+1) = exp(A L_j) z_j + g_j for pieces j = 0 ... m - 1 of one system z' = A z + ...: all z_j, (m + 1, n).

    propagator: of A; added: what is added over each piece, g (m, n); lengths: L (m,) [s]. The pieces are worked on in about sqrt(m)
    blocks side by side, each from zero; then the blocks' starts follow one from the other, and what each start adds within its
    block is put on top. The cost is linear in m.
    """
    m, n = added.shape
    result = np.zeros((m + 1, n))
    if m == 0 or n == 0:
        return result
    width = math.isqrt(m - 1) + 1
    blocks = -(-m // width)
    g = np.zeros((blocks * width, n))
    L = np.zeros(blocks * width)
    g[:m], L[:m] = added, lengths
    g, L = g.reshape(blocks, width, n), L.reshape(blocks, width)
    inner = np.zeros((blocks, width + 1, n))
    for j in range(width):
        inner[:, j + 1] = propagator.states(inner[:, j], L[:, j]) + g[:, j]
    elapsed = np.concatenate([np.zeros((blocks, 1)), np.cumsum(L, axis=1)], axis=1)
    start = np.zeros((blocks, n))
    for k in range(1, blocks):
        start[k] = propagator.states(start[k - 1 : k], elapsed[k - 1, -1:])[0] + inner[k - 1, -1]
    owner = np.repeat(np.arange(blocks), width + 1)
    inner += propagator.outputs(np.eye(n), start, owner, elapsed.ravel()).reshape(inner.shape)
    result[:m] = inner[:, :width].reshape(-1, n)[:m]
    last = m - (blocks - 1) * width
    result[m] = inner[-1, last]
    return result
