"""Coordinates of a plant in which short holds are alike: outputs and derivatives in units of the hold, and internal ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.inversion.inverse_system import InverseSystem
from invtrack.linear.internal_dynamics import ROUNDING_FACTOR


@dataclass(frozen=True, eq=False)
class HoldCoordinates:
    """q = into x, x = back q with q' = A q + B u, y = C q + D u: q holds y_i^(k) h^(k + 1 - r_i) and the internal coordinates z.

    Held for h, an input moves an output of relative degree r by the order of h^r, and the inverse of that is of the order of h^-r:
    in coordinates that mix outputs with others nothing is left of the rest but rounding. In these all is of the order of 1, but for
    the change of z; and what is zero by the definition of a relative degree is zero.

    Args:
        into, back: (n, n).
        A, B, C, D: of the plant in these coordinates.
        prescribed: how many of these are outputs and their derivatives; the others are z = [z_s; z_u] of the inverse.
    """

    into: Array
    back: Array
    A: Array
    B: Array
    C: Array
    D: Array
    prescribed: int

    @classmethod
    def of(cls, inverse: InverseSystem, hold: float) -> HoldCoordinates:
        """Those of the plant with this inverse, for holds [s]."""
        plant, T = inverse.plant, inverse.system.T
        powers = np.concatenate([np.zeros(0), *(np.arange(order)[::-1] for order in inverse.internal.form.orders)])
        units = np.concatenate([hold**powers, np.ones(len(T) - len(powers))])
        into, back = T / units[:, None], np.linalg.solve(T, np.eye(len(T))) * units
        A, B, C = _product(into, plant.A, back), _product(into, plant.B), _product(plant.C, back)
        return cls(into, back, A, B, C, plant.D, len(powers))


def _product(*factors: Array) -> Array:
    """The product of matrices, without entries that are rounding of the terms that they are sums of."""
    terms, product = np.linalg.multi_dot([np.abs(each) for each in factors]), np.linalg.multi_dot(factors)
    rounding = ROUNDING_FACTOR * factors[0].shape[1] * np.finfo(float).eps
    return np.where(np.abs(product) > rounding * terms, product, 0.0)
