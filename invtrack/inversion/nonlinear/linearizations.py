"""Linear models along a motion, where feedback around it is designed."""

from __future__ import annotations

import numpy as np

from invtrack.inversion.nonlinear.shooting import ElementChain, Motion
from invtrack.plans.linearizations import Linearizations
from invtrack.plans.runge_kutta import legendre


def linearizations_along(shooting: ElementChain, motion: Motion) -> Linearizations:
    """A and B in the middles of even parts of each element, as many as its input has coefficients, between those at its knots."""
    mesh, scheme = shooting.mesh, shooting.scheme
    count, knots, states = scheme.count, scheme.knots, shooting.dynamics[0].state_coordinates
    middles = scheme.spread[2 * scheme.refinement * (2 * np.arange(count) + 1)]
    nodes = shooting.nodes(motion)[:, knots]
    inputs = np.einsum("kim,ji->kjm", motion.coefficients, legendre(count, knots / scheme.steps))
    A = np.empty((len(mesh), count, len(states), len(states)))
    B = np.empty((len(mesh), count, len(states), inputs.shape[2]))
    for interval in np.unique(mesh.interval):
        chosen = np.flatnonzero(mesh.interval == interval)
        points, u = nodes[chosen].reshape(-1, nodes.shape[2]), inputs[chosen].reshape(-1, inputs.shape[2])
        found = shooting.dynamics[interval].derivatives(points, u, rough=True)
        for whole, at_knots in ((A, found.A[:, states][:, :, states]), (B, found.B[:, states])):
            whole[chosen] = np.einsum("jl,kl...->kj...", middles, at_knots.reshape(len(chosen), len(knots), *whole.shape[2:]))
    starts = (mesh.edges[:-1, None] + mesh.lengths[:, None] * np.arange(count) / count).ravel()
    return Linearizations(np.append(starts, mesh.edges[-1]), A.reshape(-1, *A.shape[2:]), B.reshape(-1, *B.shape[2:]))
