"""What the inputs do to the outputs' highest derivatives along a motion: where that vanishes, the inverse ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RelativeDegreeError
from invtrack.inversion.nonlinear.shooting import Motion, Shooting

SINGULAR = 1e-3
"""The decoupling matrix counts as singular where its determinant has fallen to this share of that at the start."""

NEARLY = 0.1
"""Below this share of it at the start, it is what keeps a motion from being followed further."""


@dataclass(frozen=True)
class Decoupling:
    """The smallest ratio of det B_y along a motion to that at its start, negative where it changed sign, and when [s] that is."""

    ratio: float
    time: float


def decoupling_along(shooting: Shooting, motion: Motion, orders: tuple[int, ...]) -> Decoupling:
    """det B_y of the linear models along the motion, rows C_i A^(r_i - 1) B (D where r_i = 0), at the starts of its elements.

    For outputs that depend on positions alone and r = 2, that is the decoupling matrix of the nonlinear plant itself.

    Args:
        shooting, motion: the conditions, and the motion that meets them.
        orders: relative degree of each output (p,).
    """
    mesh = shooting.mesh
    inputs = np.einsum("kim,i->km", motion.coefficients, shooting.scheme.basis[0])
    determinants = np.empty(len(mesh))
    for k in np.unique(mesh.interval):
        chosen = np.flatnonzero(mesh.interval == k)
        found = shooting.dynamics[k].derivatives(motion.points[chosen], inputs[chosen])
        rows = []
        for i, order in enumerate(orders):
            row: Array = found.C[:, i : i + 1]
            for _ in range(order - 1):
                row = row @ found.A
            rows.append(found.D[:, i : i + 1] if order == 0 else row @ found.B)
        determinants[chosen] = np.linalg.det(np.concatenate(rows, axis=1))
    ratios = determinants / determinants[0]
    least = int(np.argmin(ratios))
    return Decoupling(float(ratios[least]), float(mesh.edges[least]))


def require_hold_of_outputs(shooting: Shooting, motion: Motion, orders: tuple[int, ...] | None, amplitude: float) -> float | None:
    """The smallest ratio of det B_y along a motion; None without a vector relative degree, where nothing of the kind is known.

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
            f"the inputs lose hold of the outputs on the way: det B_y {how} at t = {found.time:.6g} s{part}; beyond such a point "
            "solutions are false. Ask for a motion that stays clear of it, or track another output"
        )
    return found.ratio
