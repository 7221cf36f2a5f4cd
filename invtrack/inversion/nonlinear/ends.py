"""Conditions at the two ends of a motion: from which directions it may leave rest, and along which it must come back to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.inversion.nonlinear.elements import Scheme, map_at_rest
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.linear.state_space import StateSpace
from invtrack.linear.zeros import zeros
from invtrack.plans.dynamics import Dynamics

NEUTRAL = 1e-5
"""Multipliers up to 1 + this count as not expanding: states that act on nothing, and zeros at the origin."""

SLOW = 1.0
"""A zero z is resolved by elements of length H where |z| H is below this: it shows as a multiplier exp(z H)."""


@dataclass(frozen=True, eq=False)
class End:
    """An equilibrium and the discrete inverse dynamics x -> M x of elements there, outputs kept.

    Args:
        rest: the equilibrium.
        M: in balanced coordinates (n, n).
        scale: of these, x = scale * (balanced x) (n,).
        inputs: coefficients of the inputs on an element that keep the outputs, from x at its start (s m, n).
        zeros: invariant zeros of the linear model there [rad/s].
        gap: smallest |log |lambda|| of the multipliers that stand for no zero which the elements resolve.
    """

    rest: Rest
    M: Array
    scale: Array
    inputs: Array
    zeros: ComplexArray
    gap: float

    @classmethod
    def of(cls, dynamics: Dynamics, rest: Rest, scheme: Scheme, length: float, zeros: ComplexArray) -> End:
        """The end at an equilibrium, for elements of that length [s]. Raises LinAlgError where the input acts on no output."""
        maps = map_at_rest(dynamics, rest.point, rest.inputs, scheme, length)
        M, (scale, _) = scipy.linalg.matrix_balance(maps.exact[0], permute=False, separate=True)
        return cls(rest, M, scale, -maps.inverse[0][0], zeros, _gap(np.linalg.eigvals(M), zeros * length))

    @property
    def expanding(self) -> int:
        """How many multipliers lie outside the unit circle."""
        return int(np.sum(np.abs(np.linalg.eigvals(self.M)) > 1 + NEUTRAL))

    def start_rows(self) -> Array:
        """Rows L (n - n_u, n): L (x - rest) = 0 for a motion that has left rest, long before; orthonormal in balanced units."""
        return self._rows(expanding=False)

    def end_rows(self) -> Array:
        """Rows R (n_u, n): R (x - rest) = 0 for a motion that comes to rest."""
        return self._rows(expanding=True)

    def leaving(self, away: Array, count: int) -> Array:
        """The last `count` states (count, n), measured from rest, of a motion on its way from rest to `away` (n,)."""
        Q, T = _invariant(self.M, expanding=True)
        z, found = Q.T @ (away / self.scale), np.empty((count, len(away)))
        for k in range(count - 1, -1, -1):
            z = scipy.linalg.solve(T, z) if len(z) else z
            found[k] = self.scale * (Q @ z)
        return found

    def returning(self, away: Array, count: int) -> Array:
        """The next `count` states (count, n), measured from rest, of a motion on its way to rest from `away` (n,)."""
        Q, T = _invariant(self.M, expanding=False)
        z, found = Q.T @ (away / self.scale), np.empty((count, len(away)))
        for k in range(count):
            z = T @ z
            found[k] = self.scale * (Q @ z)
        return found

    def _rows(self, *, expanding: bool) -> Array:
        """A basis of the left-invariant subspace of the multipliers outside the unit circle, or of the others."""
        return np.asarray(_invariant(self.M.T, expanding=expanding)[0].T / self.scale)


def _invariant(M: Array, *, expanding: bool) -> tuple[Array, Array]:
    """Q with M Q = Q T, and T, for the multipliers of M outside the unit circle or for the others."""

    def chosen(re: float, im: float) -> bool:
        return bool((np.hypot(re, im) > 1 + NEUTRAL) == expanding)

    T, Q, count = scipy.linalg.schur(M, sort=chosen)
    return Q[:, :count], T[:count, :count]


def zeros_at(dynamics: Dynamics, rest: Rest) -> ComplexArray:
    """Invariant zeros [rad/s] of the linear model at an equilibrium, those of states that outputs do not show among them."""
    found = dynamics.derivatives(rest.point[None], rest.inputs[None])
    return zeros(StateSpace(found.A[0], found.B[0], found.C[0], found.D[0]))


def unstable(found: ComplexArray, unit: float) -> int:
    """How many zeros lie in the right half plane; unit [rad/s]: of what is judged."""
    return int(np.sum(found.real > NEUTRAL * unit))


def _gap(multipliers: ComplexArray, resolved: ComplexArray) -> float:
    """Smallest |log |lambda|| of the multipliers but those nearest to exp(z H) of the zeros, z H (k,), that are resolved."""
    left = list(multipliers)
    for zero in sorted(resolved[np.abs(resolved) < SLOW], key=abs):
        if left:
            left.pop(int(np.argmin(np.abs(np.array(left) - np.exp(zero)))))
    sizes = np.abs(np.array(left))
    return float(np.min(np.abs(np.log(np.maximum(sizes, np.finfo(float).tiny))), initial=np.inf))
