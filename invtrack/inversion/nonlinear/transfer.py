"""A motion carried over to another mesh: its own states and inputs within its window, its tails outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.inversion.nonlinear.shooting import ElementChain, Motion
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.runge_kutta import Steps, legendre
from invtrack.plans.tail import Tail

QUADRATURE = 4
"""Points on an element at which inputs are read, at least: tails are exponentials."""

SAME = 1e-9
"""Edges closer than this share of an element are one and the same, computed in two ways."""


@dataclass(frozen=True, eq=False)
class Outside:
    """A motion about rest on one side of a mesh.

    Args:
        dynamics, rest: where it comes from, or goes to.
        tail: [x; u] as deviations from rest, x in the tangent space there.
    """

    dynamics: Dynamics
    rest: Rest
    tail: Tail

    def points(self, distance: Array) -> Array:
        """States (k, .) at distances (k,) [s] from the mesh."""
        tangents = self.tail.values(distance, slice(self.dynamics.size), 0.0)
        return self.dynamics.retract(np.repeat(self.rest.point[None], len(distance), axis=0), tangents)

    def inputs(self, distance: Array) -> Array:
        """Inputs (k, m) there."""
        return self.rest.inputs + self.tail.values(distance, slice(self.dynamics.size, None), 0.0)


@dataclass(frozen=True, eq=False)
class Known:
    """A motion that is known on its mesh, and on both sides of it."""

    shooting: ElementChain
    motion: Motion
    outside: tuple[Outside, Outside]

    def on(self, mesh: Mesh, count: int) -> Motion:
        """The same on another mesh, with that many coefficients of each input on an element."""
        return Motion(self._points(mesh.edges), self._coefficients(mesh, count), self.motion.bend)

    def _points(self, times: Array) -> Array:
        """States (k, .) at times (k,) [s]: a step of integration, or less, from the nodes before them."""
        mesh, motion, scheme = self.shooting.mesh, self.motion, self.shooting.scheme
        own, share = self._located(times)
        result = motion.points[own].copy()
        partly, one = np.flatnonzero(share > 0), Steps(scheme.method, 1, scheme.count)
        nodes = self.shooting.nodes(motion) if len(partly) else np.zeros(0)
        for k in np.unique(mesh.interval[own[partly]]):
            within = partly[mesh.interval[own[partly]] == k]
            elements, shares = own[within], share[within]
            passed = np.minimum((shares * scheme.steps).astype(np.intp), scheme.steps - 1)
            begins = passed / scheme.steps
            inputs = _between(motion.coefficients[elements], begins, shares)
            lengths = (shares - begins) * mesh.lengths[elements]
            result[within] = self.shooting.dynamics[k].motion(nodes[elements, passed], inputs, one, lengths)[:, -1]
        for outside, chosen, distance in self._beyond(times):
            result[chosen] = outside.points(distance)
        return result

    def _coefficients(self, mesh: Mesh, count: int) -> Array:
        """Of the inputs' projections on polynomials, as a quadrature has them that is exact for the motion's own (N, s, m).

        An input that is to be held is read in the middle, as controllers and tails do.
        """
        own = self.motion.coefficients
        nodes, weights = np.polynomial.legendre.leggauss(1 if count == 1 else max(count, own.shape[1], QUADRATURE))
        shares = (nodes + 1) / 2
        times = (mesh.edges[:-1, None] + mesh.lengths[:, None] * shares).ravel()
        elements, share = self._located(times)
        elements = np.minimum(elements, len(own) - 1)
        u = np.einsum("ki,kim->km", legendre(own.shape[1], share), own[elements])
        for outside, chosen, distance in self._beyond(times):
            u[chosen] = outside.inputs(distance)
        projection = (2 * np.arange(count) + 1)[:, None] * (legendre(count, shares) * weights[:, None] / 2).T
        return np.asarray(np.einsum("ij,kjm->kim", projection, u.reshape(len(mesh), len(shares), -1)))

    def _located(self, times: Array) -> tuple[Indices, Array]:
        """The element of each time (k,), and which share of it has passed; the last edge begins an element N."""
        edges, lengths = self.shooting.mesh.edges, self.shooting.mesh.lengths
        own = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, len(lengths) - 1)
        share = np.clip((times - edges[own]) / lengths[own], 0.0, 1.0)
        at_end = share > 1 - SAME
        return own + at_end, np.where(at_end | (share < SAME), 0.0, share)

    def _beyond(self, times: Array) -> list[tuple[Outside, Indices, Array]]:
        """What lies before and after the window: which times, and how far out [s]."""
        edges = self.shooting.mesh.edges
        distances = (edges[0] - times, times - edges[-1])
        slack = SAME * self.shooting.mesh.lengths[[0, -1]]
        found = [(outside, np.flatnonzero(d > s)) for outside, d, s in zip(self.outside, distances, slack, strict=True)]
        return [(outside, chosen, d[chosen]) for (outside, chosen), d in zip(found, distances, strict=True) if len(chosen)]


def _between(coefficients: Array, begins: Array, ends: Array) -> Array:
    """Those of the same polynomials between two shares (k,) of their elements (k, s, m)."""
    count = coefficients.shape[1]
    samples = (np.polynomial.legendre.leggauss(count)[0] + 1) / 2
    shares = begins[:, None] + (ends - begins)[:, None] * samples
    within = legendre(count, shares.ravel()).reshape(len(begins), count, count)
    return np.linalg.solve(legendre(count, samples), np.einsum("kji,kim->kjm", within, coefficients))
