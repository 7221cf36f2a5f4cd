"""Linear models along a motion, where feedback around it is designed."""

from __future__ import annotations

import numpy as np

from invtrack.inversion.nonlinear.elements import legendre
from invtrack.inversion.nonlinear.shooting import Motion, Shooting
from invtrack.plans.linearizations import Linearizations


def linearizations_along(shooting: Shooting, motion: Motion) -> Linearizations:
    """A and B in the middles of even parts of each element, as many as its input has coefficients."""
    mesh, scheme = shooting.mesh, shooting.scheme
    count = scheme.count
    shares = (np.arange(count) + 0.5) / count
    nodes = shooting.nodes(motion)[:, scheme.refinement * (2 * np.arange(count) + 1)]
    inputs = np.einsum("kim,ji->kjm", motion.coefficients, legendre(count, shares))
    states = shooting.dynamics[0].state_coordinates
    A = np.empty((len(mesh), count, len(states), len(states)))
    B = np.empty((len(mesh), count, len(states), inputs.shape[2]))
    for interval in np.unique(mesh.interval):
        chosen = np.flatnonzero(mesh.interval == interval)
        points, u = nodes[chosen].reshape(-1, nodes.shape[2]), inputs[chosen].reshape(-1, inputs.shape[2])
        found = shooting.dynamics[interval].derivatives(points, u)
        A[chosen] = found.A[:, states][:, :, states].reshape(len(chosen), count, *A.shape[2:])
        B[chosen] = found.B[:, states].reshape(len(chosen), count, *B.shape[2:])
    starts = (mesh.edges[:-1, None] + mesh.lengths[:, None] * np.arange(count) / count).ravel()
    return Linearizations(np.append(starts, mesh.edges[-1]), A.reshape(-1, *A.shape[2:]), B.reshape(-1, *B.shape[2:]))
