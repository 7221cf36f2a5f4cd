"""Conditions at the two ends of a motion: from which directions it may leave rest, and along which it must come back to it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.inversion.nonlinear.elements import Scheme, map_at_rest
from invtrack.inversion.nonlinear.powers import Powers
from invtrack.inversion.nonlinear.rest import Rest
from invtrack.linear.state_space import StateSpace
from invtrack.linear.zeros import zeros
from invtrack.plans.dynamics import Dynamics
from invtrack.plans.tail import Side

NEUTRAL = 1e-5
"""Multipliers up to 1 + this count as not expanding: states that act on nothing, and zeros at the origin."""

LASTING = 1.5
"""Multipliers with |log |lambda|| above this die out within the elements before and after a manoeuvre, twelve at least."""

ALTERNATING = 2.5
"""Multipliers with angles above this [rad] alternate from element to element, as no motion in time does."""

SLOW = 1.0
"""A zero z is resolved by elements of length H where |z| H is below this: it shows as a multiplier near exp(z H)."""

SLOW_PER_COEFFICIENT = 0.5
"""The same for each coefficient of an input on an element, where that is more."""


@dataclass(frozen=True, eq=False)
class Departure:
    """Motions about rest that die out away from a manoeuvre: x = X exp(A t) phi, u = U exp(A t) phi, as deviations from rest.

    phi are powers of coordinates, at t = 0; the coordinates themselves where motions are small.

    They are those of the elements themselves: x at the nodes is as elements carry it on, and u has the mean over each element that
    keeps the outputs at their points; where inputs are held, that is its value in the middle, which a controller holds.

    Args:
        side: of the manoeuvre.
        A: (K, K) [1/s].
        X, U: states, in the tangent space at rest, and inputs (n, K), (m, K).
        V: coordinates V x of the state x, what lies in other motions left aside (k, n); where some have powers, of the others
            after what these powers make of the state.
        powers: of these.
    """

    side: Side
    A: Array
    X: Array
    U: Array
    V: Array
    powers: Powers

    def start(self, away: Array) -> Array:
        """phi at t = 0 (K,) for a state that far from rest (n,)."""
        return self.powers.values(self._coordinates(away))

    def part(self, away: Array) -> Array:
        """What of a state that far from rest (n,) lies in these motions (n,)."""
        return np.asarray(self.X @ self.start(away))

    def slopes(self, away: Array) -> Array:
        """The derivatives of that part (n, n)."""
        w, k = self._coordinates(away), self.powers.variables
        to_powers, to_coordinates = self.powers.slopes(w), self.V.copy()
        w[k:] = 0.0
        to_coordinates[k:] -= self.V[k:] @ self.X @ self.powers.slopes(w)[:, :k] @ self.V[:k]
        return np.asarray(self.X @ to_powers @ to_coordinates)

    def _coordinates(self, away: Array) -> Array:
        """Those without powers are what is left beside the powers of the others."""
        w, k = self.V @ away, self.powers.variables
        w[k:] = 0.0
        w[k:] = self.V[k:] @ (away - self.X @ self.powers.values(w))
        return np.asarray(w)


@dataclass(frozen=True, eq=False)
class Split:
    """Slow and other motions of a linear map M (n, n): M X = X T and M Z = Z S, with [V; Y] the inverse of [X, Z].

    Args:
        X, T, V: of the slow ones (n, k), (k, k), (k, n).
        Z, S, Y: of the others (n, n - k), (n - k, n - k), (n - k, n).
    """

    X: Array
    T: Array
    V: Array
    Z: Array
    S: Array
    Y: Array


@dataclass(frozen=True, eq=False)
class End:
    """An equilibrium and the discrete inverse dynamics x -> M x of elements there, outputs kept.

    Args:
        rest: the equilibrium.
        length: of the elements [s].
        M: in balanced coordinates (n, n).
        scale: of these, x = scale * (balanced x) (n,).
        inputs: coefficients of the inputs on an element that keep the outputs, from x at its start (s m, n).
        zeros: invariant zeros of the linear model there [rad/s].
        gap: smallest |log |lambda|| of the multipliers that stand for no zero which the elements resolve.
        curved: how motions that are not small leave rest, or come to it; None for small ones.
    """

    rest: Rest
    length: float
    M: Array
    scale: Array
    inputs: Array
    zeros: ComplexArray
    gap: float
    curved: Departure | None = None
    _linear: dict[Side, Departure] = field(default_factory=dict, repr=False)

    @classmethod
    def of(cls, dynamics: Dynamics, rest: Rest, scheme: Scheme, length: float, zeros: ComplexArray) -> End:
        """The end at an equilibrium, for elements of that length [s]. Raises LinAlgError where the input acts on no output."""
        maps = map_at_rest(dynamics, rest, scheme, length)
        M, (scale, _) = scipy.linalg.matrix_balance(maps.exact[0], permute=False, separate=True)
        return cls(rest, length, M, scale, -maps.inverse[0][0], zeros, gap_of(M, zeros * length, scheme.count))

    @property
    def expanding(self) -> int:
        """How many multipliers lie outside the unit circle."""
        return int(np.sum(np.abs(np.linalg.eigvals(self.M)) > 1 + NEUTRAL))

    @property
    def degree(self) -> int:
        """Of the polynomials that are known for tails."""
        return 1 if self.curved is None else self.curved.powers.degree

    def start_rows(self) -> Array:
        """Rows L (n - n_u, n): L (x - rest) = 0 for a motion that has left rest, long before; orthonormal in balanced units."""
        return self._rows(expanding=False)

    def end_rows(self) -> Array:
        """Rows R (n_u, n): R (x - rest) = 0 for a motion that comes to rest."""
        return self._rows(expanding=True)

    def rows_at_rest(self, zeros: ComplexArray, states: Indices, *, expanding: bool) -> Array:
        """Rows S (k, n): S (x - rest) = 0 where some zeros are at rest; orthonormal in balanced units.

        Args:
            zeros: of the linear model [rad/s].
            states: coordinates that are states of that model; the others act on nothing, and have multipliers of their own.
            expanding: whether of these zeros those outside the unit circle count, or the others.
        """
        M = self.M[np.ix_(states, states)]
        multipliers = np.linalg.eigvals(M)
        left, chosen = list(range(len(multipliers))), []
        for zero in zeros:
            chosen.append(left.pop(int(np.argmin(np.abs(multipliers[left] - np.exp(zero * self.length))))))
        own = np.isin(np.arange(len(multipliers)), chosen) & ((np.abs(multipliers) > 1 + NEUTRAL) == expanding)
        _, Q, count = scipy.linalg.schur(M.T, sort=lambda re, im: bool(own[np.argmin(np.abs(multipliers - complex(re, im)))]))
        rows = np.zeros((count, len(self.M)))
        rows[:, states] = Q[:, :count].T
        return rows / self.scale

    def conditions(self, side: Side, away: Array) -> tuple[Array, Array]:
        """What the state is to meet where a motion leaves rest, or comes to it, by how much it misses that, and how that changes.

        away: the state less rest (n,). Returns rows (c, n) for a change of the state, and the misses (c,).
        """
        rows = self.start_rows() if side == "before" else self.end_rows()
        if self.curved is None:
            return rows, rows @ away
        return rows - rows @ self.curved.slopes(away), rows @ (away - self.curved.part(away))

    def departure(self, side: Side) -> Departure:
        """Motions about rest that die out away from a manoeuvre, on that side of it, but not within a few elements."""
        if self.curved is not None:
            return self.curved
        if side not in self._linear:
            split = self.split(self.lasting(side))
            A = np.zeros((0, 0)) if len(split.T) == 0 else np.real(scipy.linalg.logm(split.T)) / self.length
            U = self.inputs_of(A, self.inputs[: len(self.rest.inputs)] @ split.X)
            self._linear[side] = Departure(side, A, split.X, U, split.V, Powers(len(A), 1))
        return self._linear[side]

    def inputs_of(self, A: Array, means: Array) -> Array:
        """U (m, K) for which U exp(A t) phi has the means (m, K) phi over an element, or, where inputs are held, in its middle."""
        step, count = A * self.length, len(A)
        if len(self.inputs) == len(self.rest.inputs):
            reading = scipy.linalg.expm(step / 2)
        else:
            reading = scipy.linalg.expm(np.block([[step, np.eye(count)], [np.zeros((count, 2 * count))]]))[:count, count:]
        return np.asarray(np.linalg.solve(reading.T, means.T).T)

    def lasting(self, side: Side) -> ComplexArray:
        """Multipliers of the motions that die out away from a manoeuvre on that side of it, but not within a few elements."""
        multipliers = np.linalg.eigvals(self.M)
        outward = np.abs(multipliers) > 1 + NEUTRAL if side == "before" else np.abs(multipliers) < 1 - NEUTRAL
        slow = np.abs(np.log(np.maximum(np.abs(multipliers), np.finfo(float).tiny))) < LASTING
        return np.asarray(multipliers[outward & slow & (np.abs(np.angle(multipliers)) < ALTERNATING)])

    def split(self, chosen: ComplexArray) -> Split:
        """The motions with the chosen multipliers, of those of M, conjugates among them, and the others."""
        multipliers = np.linalg.eigvals(self.M)
        own_ones = np.isin(multipliers, chosen)

        def own(re: float, im: float) -> bool:
            return bool(own_ones[np.argmin(np.abs(multipliers - complex(re, im)))])

        T, Q, count = scipy.linalg.schur(self.M, sort=own)
        slow, others = Q[:, :count], Q[:, count:]
        mixed = scipy.linalg.solve_sylvester(T[:count, :count], -T[count:, count:], -T[:count, count:]) if count else T[:0]
        return Split(
            X=self.scale[:, None] * slow,
            T=T[:count, :count],
            V=(slow.T - mixed @ others.T) / self.scale,
            Z=self.scale[:, None] * (slow @ mixed + others),
            S=T[count:, count:],
            Y=others.T / self.scale,
        )

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
    found = rest.derivatives(dynamics)
    return zeros(StateSpace(found.A[0], found.B[0], found.C[0], found.D[0]))


def unstable(found: ComplexArray, unit: float) -> int:
    """How many zeros lie in the right half plane; unit [rad/s]: of what is judged."""
    return int(np.sum(found.real > NEUTRAL * unit))


def gap_of(M: Array, zeros: ComplexArray, count: int) -> float:
    """Smallest |log |lambda|| of the multipliers of M (n, n) but those nearest to exp(z H) of the zeros that elements resolve.

    zeros: z H (k,); count: coefficients of each input on an element.
    """
    left = list(np.linalg.eigvals(M))
    for zero in sorted(zeros[np.abs(zeros) < max(SLOW, SLOW_PER_COEFFICIENT * count)], key=abs):
        if left:
            left.pop(int(np.argmin(np.abs(np.array(left) - np.exp(zero)))))
    sizes = np.abs(np.array(left))
    return float(np.min(np.abs(np.log(np.maximum(sizes, np.finfo(float).tiny))), initial=np.inf))
