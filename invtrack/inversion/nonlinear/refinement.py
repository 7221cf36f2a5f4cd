"""How well a motion on a mesh meets its outputs between the points where they are matched, and where the mesh must be finer."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.nonlinear.shooting import ElementChain, Motion, Shooting
from invtrack.plans.runge_kutta import legendre
from invtrack.references.signal import PiecewiseSignal

MARGIN = 0.3
"""Share of the accuracy that a refined element is to reach."""

MOST_STEPS = 8
"""By how much steps of integration become shorter at once, at most."""

EVERY = 4
"""Of so many elements in a row the accuracy of the integration is looked at once."""

MOST_PARTS = 4
"""Into how many parts an element is split at once, at most."""


@dataclass(frozen=True, eq=False)
class DenseError:
    """Errors of each element (N,), as shares of the outputs' motions and the states' peaks.

    Args:
        output: largest |y - y_d| from start to end, by an integration with twice as many steps.
        between: the same less what interpolates it between the matched points: what the mesh is to blame for.
        defect: what that integration makes of its end.
    """

    output: Array
    between: Array
    defect: Array

    @property
    def worst(self) -> Array:
        """The largest of each element (N,)."""
        return np.maximum(self.output, self.defect)


def dense_error(shooting: Shooting, motion: Motion, reference: PiecewiseSignal, size: Array) -> DenseError:
    """The errors of a motion between its points; `between` and `defect` hardly change where little of it is left to find.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        reference: the wanted outputs.
        size: peaks of the plan's states (n,).
    """
    scheme, dynamics = shooting.scheme, shooting.dynamics[0]
    nodes = shooting.nodes(motion)
    looked = np.linspace(0, scheme.steps, 2 * scheme.count + 1).astype(np.intp)  # the matched points among them
    shares = looked / scheme.steps
    y = shooting.outputs(nodes[:, looked], np.einsum("kim,ji->kjm", motion.coefficients, legendre(scheme.count, shares)))
    away = dynamics.output_difference(y, wanted_at(shooting.mesh, reference, shares)) / shooting.motion_size
    return DenseError(
        np.max(np.abs(away), axis=(1, 2)),
        np.max(np.abs(away - _through_points(away, scheme)), axis=(1, 2)),
        defects_of(shooting, motion, reference.breakpoints, size),
    )


def defects_of(shooting: ElementChain, motion: Motion, stops: Array, size: Array) -> Array:
    """What twice as many steps make of the ends of elements (N,), as shares of sizes (n,): of some of them, and of those near by.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        stops: times beside which all elements are looked at.
        size: peaks of the plan's states (n,).
    """
    mesh, dynamics, scheme = shooting.mesh, shooting.dynamics[0], shooting.scheme
    looked = np.union1d(np.arange(0, len(mesh), EVERY), mesh.beside(stops))
    fine = shooting.ends_of(motion, looked, replace(scheme, refinement=2 * scheme.refinement))
    gaps = dynamics.difference(fine, shooting.nodes(motion)[looked, -1])[:, dynamics.state_coordinates]
    nearest = np.searchsorted((looked[1:] + looked[:-1]) / 2, np.arange(len(mesh)))
    return np.asarray(np.max(np.abs(gaps) / size, axis=1)[nearest])


def _through_points(away: Array, scheme: Scheme) -> Array:
    """The polynomials through misses (N, k, p) at the matched points, at all k even shares of an element."""
    shares, result = np.linspace(0.0, 1.0, away.shape[1]), np.empty_like(away)
    for output, points in enumerate(scheme.points // scheme.refinement):
        weights = np.linalg.solve(legendre(scheme.count, shares[points]).T, legendre(scheme.count, shares).T)  # (s, k)
        result[:, :, output] = away[:, points, output] @ weights
    return result


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


def steps_for(defect: Array, accuracy: float, order: int) -> int:
    """By how much the steps of integration must be shorter for defects (N,), which fall with this power of them."""
    worst = float(np.max(defect))
    return 1 if worst <= accuracy else int(np.clip(np.ceil((worst / (MARGIN * accuracy)) ** (1 / order)), 2, MOST_STEPS))
