"""One hold of a linear plant: what comes out of it for a constant input, and the discrete inverse that meets the outputs in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.inversion.nonlinear.elements import ElementMaps
from invtrack.inversion.nonlinear.ends import End, gap_of
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.state_space import StateSpace

LEAST_GAP = 0.3
"""Least |log |lambda|| of the modes of the sampled inverse that stand for no zero with which it is taken."""


@dataclass(frozen=True, eq=False)
class SampledElement:
    """x_end = exact x + push y_d, u = gain y_d - back x for the state x at the start of a hold and outputs y_d met within it.

    Args:
        length: of the hold [s].
        shares: of it after which each output is met (p,).
        exact, push: (n, n) and (n, p).
        back, gain: (m, n) and (m, p).
    """

    length: float
    shares: Array
    exact: Array
    push: Array
    back: Array
    gain: Array

    @classmethod
    def of(cls, system: StateSpace, length: float, at_end: tuple[bool, ...]) -> SampledElement:
        """The element, each output met at its end or in its middle. Raises LinAlgError where the input acts on no output in it."""
        shares = np.where(at_end, 1.0, 0.5)
        A_d, B_d = zero_order_hold(system.A, system.B, length)
        sampled = {share: zero_order_hold(system.A, system.B, share * length) for share in np.unique(shares).tolist()}
        out_x = np.array([system.C[i] @ sampled[share][0] for i, share in enumerate(shares.tolist())])
        out_u = np.array([system.C[i] @ sampled[share][1] + system.D[i] for i, share in enumerate(shares.tolist())])
        maps = ElementMaps(A_d[None], B_d[None], out_x[None], out_u[None])
        back, gain = (each[0] for each in maps.inverse)
        return cls(length, shares, maps.exact[0], B_d @ gain, back, gain)

    def end(self, zeros: ComplexArray) -> End:
        """Conditions before or after elements like this one, zeros [rad/s] being the plant's."""
        n, m = self.push.shape[0], self.back.shape[0]
        M, (scale, _) = scipy.linalg.matrix_balance(self.exact, permute=False, separate=True)
        rest = Rest(np.zeros(n), np.zeros(m), 0.0)
        return End(rest, self.length, M, scale, -self.back, zeros, gap_of(M, zeros * self.length, 1))
