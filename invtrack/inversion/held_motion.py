"""The motion with held inputs: that of the continuous inverse, and what has to be added for holding its mean input."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.inversion.held_end import HeldEnd
from invtrack.inversion.held_mean import HeldMean
from invtrack.inversion.nonlinear.boundary_value import TwoPointProblem
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.inversion.sampled_element import SampledElement
from invtrack.linear.switched import SwitchedSystem


@dataclass(frozen=True, eq=False)
class HeldMotion:
    """States x (N + 1, n) at the edges of N holds and inputs u (N, m) over them, from the first interval's x0 and absolute."""

    mesh: Mesh
    x: Array
    u: Array

    @classmethod
    def of(
        cls,
        plant: SwitchedSystem,
        mean: HeldMean,
        mesh: Mesh,
        elements: Sequence[tuple[Indices, SampledElement]],
        ends: tuple[HeldEnd, HeldEnd],
    ) -> HeldMotion:
        """The bounded motion with held inputs whose outputs are exact once in each hold.

        What is solved for is its departure from the continuous inverse, of the order of the hold squared, and as accurate as that.

        Args:
            plant, mean: the plant, and the continuous inverse at its holds.
            mesh, elements: the holds, and which are of each kind.
            ends: conditions before and after.
        """
        N, n = len(mesh), plant.n_states
        M, b, back = np.empty((N, n, n)), np.empty((N, n)), np.empty((N + 1, n, n))
        into = np.empty_like(back)
        for chosen, element in elements:
            M[chosen], into[chosen], back[chosen] = element.exact, element.coordinates.into, element.coordinates.back
            b[chosen] = mean.missed[chosen] - mean.outputs[chosen] @ element.push.T
        into[-1], back[-1] = into[-2], back[-2]
        for k in np.flatnonzero(np.diff(plant.numbers[mesh.interval])).tolist():  # where coordinates change
            M[k], b[k] = into[k + 1] @ (back[k] @ M[k]), into[k + 1] @ (back[k] @ b[k])
        b += np.einsum("kij,kj->ki", into[1:], mean.jumps)
        (first, last), x = ends, mean.states
        left, right = first.left_by(x[0] - plant.rest_states[0]), last.left_by(x[-1] - plant.rest_states[-1])
        q = TwoPointProblem.of(M, first.rows, last.rows, np.ones(n)).solve(b, -left, -right)
        u = mean.inputs.copy()
        for chosen, element in elements:
            u[chosen] -= mean.outputs[chosen] @ element.gain.T + q[chosen] @ element.back.T
        return cls(mesh, x + np.einsum("kij,kj->ki", back, q), u)
