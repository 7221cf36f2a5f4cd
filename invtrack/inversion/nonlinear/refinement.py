"""How well a motion on a mesh meets its outputs between the points where they are matched, and where the mesh must be finer."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.elements import Scheme, legendre
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.shooting import Motion, Shooting
from invtrack.references.signal import PiecewiseSignal

MARGIN = 0.3
"""Share of the accuracy that a refined element is to reach."""

MOST_PARTS = 4
"""Into how many parts an element is split at once, at most."""


PARTS_BEGIN = 6
"""Steps in 2 s times as many are a multiple of 2, 3 and 4: elements that are split into so many parts begin at ends of steps."""


@dataclass(frozen=True, eq=False)
class DenseError:
    """Errors of each element (N,), as shares of the outputs' motions and the states' peaks.

    output: largest |y - y_d| from start to end, from an integration with twice as many steps. defect: what these make of its end.
    """

    output: Array
    defect: Array

    @property
    def worst(self) -> float:
        """The largest of all."""
        return float(max(np.max(self.output), np.max(self.defect)))


def dense_error(shooting: Shooting, motion: Motion, reference: PiecewiseSignal) -> DenseError:
    """The errors of a motion, between its points."""
    fine = Scheme(shooting.scheme.count, shooting.scheme.at_end, 2 * shooting.scheme.refinement)
    nodes = shooting.nodes(motion, fine)
    shares = np.linspace(0.0, 1.0, fine.steps + 1)
    inputs = np.einsum("kim,ji->kjm", motion.coefficients, legendre(fine.count, shares))
    y = shooting.outputs(nodes, inputs)
    away = shooting.dynamics[0].output_difference(y, wanted_at(shooting.mesh, reference, shares))
    gaps = shooting.dynamics[0].difference(nodes[:, -1], motion.points[1:])
    return DenseError(
        np.max(np.abs(away) / shooting.motion_size, axis=(1, 2)), np.max(np.abs(gaps) / shooting.sizes(motion), axis=1)
    )


def wanted_at(mesh: Mesh, reference: PiecewiseSignal, shares: Array) -> Array:
    """The reference at shares (k,) of each element, taken inside it (N, k, p)."""
    times = mesh.edges[:-1, None] + mesh.lengths[:, None] * shares
    inside = np.repeat((mesh.edges[:-1] + mesh.edges[1:]) / 2, len(shares))
    return reference(times.ravel(), inside=inside).reshape(len(mesh), len(shares), -1)


def parts_for(error: Array, accuracy: float, order: int) -> Indices:
    """Into how many parts to split each element (N,), for errors (N,) that fall with this power of its length."""
    wanted = np.maximum(error / (MARGIN * accuracy), 1.0) ** (1 / order)
    parts = np.where(error > accuracy, np.clip(np.ceil(wanted), 2, MOST_PARTS), 1).astype(np.intp)
    return np.asarray(parts)


def steps_for(defect: Array, accuracy: float) -> int:
    """By how much the steps of integration must be shorter for defects (N,), which fall with their fourth power."""
    worst = float(np.max(defect))
    return 1 if worst <= accuracy else int(np.clip(np.ceil((worst / (MARGIN * accuracy)) ** 0.25), 2, MOST_PARTS))


def carried_over(shooting: Shooting, motion: Motion, owner: Indices, shares: Array) -> Motion:
    """The same motion on a mesh whose elements lie in those of the old one.

    Args:
        shooting, motion: on the old mesh.
        owner, shares: for each new element, in which old one it lies (N',), and from which share of it on to which (N', 2).
    """
    count = shooting.scheme.count
    fine = Scheme(count, shooting.scheme.at_end, PARTS_BEGIN * shooting.scheme.refinement)
    nodes = shooting.nodes(motion, fine)
    at = np.round(shares[:, 0] * fine.steps).astype(int)
    points = np.vstack([nodes[owner, at], motion.points[-1:]])
    samples = (np.polynomial.legendre.leggauss(count)[0] + 1) / 2
    within = shares[:, :1] + (shares[:, 1:] - shares[:, :1]) * samples
    values = np.einsum("kjc,kcm->kjm", legendre(count, within.ravel()).reshape(*within.shape, count), motion.coefficients[owner])
    return Motion(points, np.linalg.solve(legendre(count, samples), values))
