"""What the inputs do to the outputs' highest derivatives along a motion: where that vanishes, the inverse ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RelativeDegreeError
from invtrack.inversion.nonlinear.shooting import Motion, Shooting

SINGULAR = 1e-3
"""The decoupling matrix counts as singular where it has fallen to this share of that at the start, in some direction."""

NEARLY = 0.1
"""Below this share of it at the start, it is what keeps a motion from being followed further."""


@dataclass(frozen=True)
class Decoupling:
    """How small B_y becomes along a motion, and when [s].

    ratio: the smallest |eigenvalue| of B_y(start)^-1 B_y(t), in which units do not matter; negative where det B_y has changed its
    sign.
    """

    ratio: float
    time: float


def decoupling_along(shooting: Shooting, motion: Motion, orders: tuple[int, ...]) -> Decoupling:
    """B_y of the linear models along the motion, rows C_i A^(r_i - 1) B (D where r_i = 0), at the starts of its elements.

    For outputs that depend on positions alone and r = 2, that is the decoupling matrix of the nonlinear plant itself.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        orders: relative degree of each output (p,).
    """
    mesh = shooting.mesh
    inputs = np.einsum("kim,i->km", motion.coefficients, shooting.scheme.basis[0])
    B_y = np.empty((len(mesh), len(orders), len(orders)))
    for k in np.unique(mesh.interval):
        chosen = np.flatnonzero(mesh.interval == k)
        found = shooting.dynamics[k].derivatives(motion.points[chosen], inputs[chosen], rough=True)
        rows = []
        for i, order in enumerate(orders):
            row: Array = found.C[:, i : i + 1]
            for _ in range(order - 1):
                row = row @ found.A
            rows.append(found.D[:, i : i + 1] if order == 0 else row @ found.B)
        B_y[chosen] = np.concatenate(rows, axis=1)
    relative = np.linalg.solve(np.broadcast_to(B_y[0], B_y.shape), B_y)
    smallest = np.min(np.abs(np.linalg.eigvals(relative)), axis=1)
    ratios = np.where(np.linalg.det(relative) < 0, -smallest, smallest)
    least = int(np.argmin(ratios))
    return Decoupling(float(ratios[least]), float(mesh.edges[least]))


def require_hold_of_outputs(shooting: Shooting, motion: Motion, orders: tuple[int, ...] | None, amplitude: float) -> float | None:
    """The smallest ratio of B_y along a motion to that at its start (see `Decoupling`).

    None without a vector relative degree, where nothing of the kind is known.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        orders: relative degree of each output (p,).
        amplitude: share of the motion; below 1 it could be followed no further, and a ratio that is merely small says why.

    Raises RelativeDegreeError where the ratio falls to nothing, or below.
    """
    if orders is None:
        return None
    found = decoupling_along(shooting, motion, orders)
    if found.ratio < (SINGULAR if amplitude == 1.0 else NEARLY):
        how = "changes its sign" if found.ratio < 0 else f"falls to {found.ratio:.2g} of what it is at the start"
        part = "" if amplitude == 1.0 else f", with {amplitude:.3g} of the motion, beyond which none was found"
        raise RelativeDegreeError(
            f"the inputs lose hold of the outputs on the way: B_y {how} at t = {found.time:.6g} s{part}; beyond such a point "
            "solutions are false. Ask for a motion that stays clear of it, or track another output"
        )
    return found.ratio
