"""Motions about rest that keep the outputs, as holds carry them on: slow ones by their rates, others by their multipliers."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import NonHyperbolicError
from invtrack.inversion.hold_response import NODES, WEIGHTS
from invtrack.inversion.nonlinear.ends import NEUTRAL
from invtrack.inversion.sampled_element import SampledElement
from invtrack.linear.invariant_parts import InvariantParts, invariant_parts
from invtrack.plans.two_sided import TwoSidedSystem

NEAR = (0.03, 0.1)
"""Zeros z are slow where |z| times the hold is below the widest gap that they leave between these."""


@dataclass(frozen=True, eq=False)
class Modes:
    """Motions q = X z with the input u = U z over each hold, and z = Z q for any q: X (n, k), U (m, k), Z (k, n).

    T (k, k): z -> T z over each hold, or by rates, z' = T z [1/s].
    """

    T: Array
    X: Array
    U: Array
    Z: Array

    def divided(self, first: Callable[[complex], bool]) -> tuple[Modes, Modes]:
        """Those with the eigenvalues of T for which `first` holds, and the others."""
        parts = invariant_parts(self.T, first)
        return (
            Modes(parts.A_1, self.X @ parts.W_1, self.U @ parts.W_1, parts.L_1 @ self.Z),
            Modes(parts.A_2, self.X @ parts.W_2, self.U @ parts.W_2, parts.L_2 @ self.Z),
        )

    def by_rates(self, hold: float) -> Modes:
        """The same with rates in place of what becomes of z over each hold [s]."""
        return replace(self, T=np.real(scipy.linalg.logm(self.T)) / hold) if len(self.T) else self

    def joined(self, other: Modes) -> Modes:
        """These and others."""
        X, U = np.hstack([self.X, other.X]), np.hstack([self.U, other.U])
        return Modes(scipy.linalg.block_diag(self.T, other.T), X, U, np.vstack([self.Z, other.Z]))


@dataclass(frozen=True, eq=False)
class HeldModes:
    """All motions about rest that keep the outputs, in groups that do not act on each other.

    Multipliers of slow zeros lie near 1, and near each other. What tells their motions apart are the rates of the continuous
    inverse, and what holds change of these: a hold carries q = X z, z' = A z on but for M X - X exp(A h), which is of the order of
    h^3 and found without cancellation. So nothing is lost where a hold changes z by little more than rounding.

    Args:
        decaying, growing: those of slow zeros, by rates.
        contracting, expanding: the others, by what becomes of them over each hold.
        neutral: by rates, those of zeros on the imaginary axis, and others that neither die out nor grow as they are held.
    """

    decaying: Modes
    growing: Modes
    contracting: Modes
    expanding: Modes
    neutral: Modes

    @classmethod
    def of(cls, inverse: TwoSidedSystem, element: SampledElement) -> HeldModes:
        """Those of a plant with this inverse, for holds like this element. Raises NonHyperbolicError where zeros run together."""
        parts = (inverse.forward, inverse.backward)
        zeros = np.concatenate([np.linalg.eigvals(part.A) for part in parts])
        limit = _limit(np.abs(zeros) * element.length) / element.length
        forward, backward = (invariant_parts(part.A, lambda zero: abs(zero) < limit) for part in parts)
        slow, others = _as_held(*_continuous(inverse, forward, backward, len(element.back)), element)
        on_axis = np.linalg.eigvals(inverse.forward.A[inverse.decaying :, inverse.decaying :])
        bound = _bound(np.abs(np.linalg.eigvals(slow.T).real), int(np.sum(np.abs(on_axis) < limit)))
        decaying, rest = slow.divided(lambda rate: rate.real < -bound)
        growing, neutral = rest.divided(lambda rate: rate.real > bound)
        contracting, rest = others.divided(lambda multiplier: abs(multiplier) < 1 - NEUTRAL)
        expanding, lasting = rest.divided(lambda multiplier: abs(multiplier) > 1 + NEUTRAL)
        return cls(decaying, growing, contracting, expanding, neutral.joined(lasting.by_rates(element.length)))


def _limit(sizes: Array) -> float:
    """In the widest gap, as a ratio, that sizes (k,) leave within NEAR."""
    inside = np.sort(np.concatenate([NEAR, sizes[(sizes > NEAR[0]) & (sizes < NEAR[1])]]))
    widest = int(np.argmax(inside[1:] / inside[:-1]))
    return float(np.sqrt(inside[widest] * inside[widest + 1]))


def _bound(sizes: Array, count: int) -> float:
    """Above so many of the sizes (k,) and below the others: 0 for none."""
    return float(np.mean(np.sort(np.append(sizes, np.inf))[count - 1 : count + 1])) if count else 0.0


def _continuous(
    inverse: TwoSidedSystem, forward: InvariantParts, backward: InvariantParts, inputs: int
) -> tuple[Array, Array, Array]:
    """A, X and U of the slow motions of the continuous inverse, from those of both of its parts; inputs: their number m."""
    rho, n, n_f, n_s = inverse.prescribed, len(inverse.T), len(forward.A_1), len(forward.A_1) + len(backward.A_1)
    A, X, U = np.zeros((n_s, n_s)), np.zeros((n, n_s)), np.zeros((inputs, n_s))
    after = rho + inverse.forward.size
    A[:n_f, :n_f], X[rho:after, :n_f], U[:, :n_f] = forward.A_1, forward.W_1, inverse.forward.X[n : n + inputs] @ forward.W_1
    A[n_f:, n_f:], X[after:, n_f:], U[:, n_f:] = backward.A_1, backward.W_1, inverse.backward.X[n : n + inputs] @ backward.W_1
    return A, X, U


def _as_held(A: Array, X: Array, U: Array, element: SampledElement) -> tuple[Modes, Modes]:
    """The slow motions as holds carry them on, and all others.

    M [X F] = [X F] [exp(A h) + E_x 0; E_f T] with the columns F of the others, where [X F] E = M X - X exp(A h) is what the mean of
    u = U exp(A t) z misses.

    Args:
        A, X, U: of the continuous inverse (k, k), (n, k) and (m, k).
        element: the holds.
    """
    h, k = element.length, len(A)
    M, (scale, _) = scipy.linalg.matrix_balance(element.exact, permute=False, separate=True)
    moving = np.array([U @ scipy.linalg.expm(A * (share * h)) for share in NODES])
    mean = np.einsum("g,gmk->mk", WEIGHTS, moving)
    missed, outputs = (each.T for each in element.changes((mean - moving).transpose(0, 2, 1)))
    F, T = _apart(M, k, h)
    F = scale[:, None] * F

    def coordinates(X: Array, of: Array) -> tuple[Array, Array]:
        """Those of columns in [X F], the first k and the others."""
        columns = np.hstack([X, F]) / scale[:, None]
        size = np.linalg.norm(columns, axis=0)
        found = np.linalg.solve(columns / size, of / scale[:, None]) / size[:, None]
        return found[:k], found[k:]

    E_x, E_f = coordinates(X, missed - element.push @ outputs)
    slow = scipy.linalg.expm(A * h) + E_x
    added = F @ scipy.linalg.solve_sylvester(T, -slow, -E_f)
    Z, Z_f = coordinates(X + added, np.eye(len(X)))
    held = Modes(slow, X + added, mean - element.gain @ outputs - element.back @ added, Z)
    return held.by_rates(h), Modes(T, F, -element.back @ F, Z_f)


def _apart(M: Array, k: int, hold: float) -> tuple[Array, Array]:
    """F (n, n - k) and T with M F = F T for all multipliers of M (n, n) but the k nearest to 1. Raises NonHyperbolicError."""
    multipliers = np.linalg.eigvals(M)
    near = np.isin(np.arange(len(M)), np.argsort(np.abs(multipliers - 1))[:k])
    parts = invariant_parts(M, lambda value: not near[np.argmin(np.abs(multipliers - value))])
    if len(parts.A_2) != k:
        raise NonHyperbolicError(
            f"no inverse for holds of {hold:.3g} s: {k} zeros are slow beside these, but {len(parts.A_2)} modes of the sampled "
            "inverse; plan with another hold"
        )
    return parts.W_1, parts.A_1
