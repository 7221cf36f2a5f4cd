"""Solutions of linear systems over time: at many times at once, over many pieces, and over holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.linear.scaling import balancing_scale, pace_of, parts
from invtrack.linear.transition_powers import DrivenPowers, OwnPowers, TransposedPowers
from invtrack.linear.transition_series import TransitionSeries

APART = 16.0
"""States that nothing couples with others, and whose pace differs from theirs by this factor or more, are carried by themselves."""

FEW = 16
"""With fewer states nothing is gained by that."""

BLOCK = 16
"""Pieces that follow one from the other in a block, of which all are worked on at once."""

VAN_LOAN_NORM = 0.5
"""Norm up to which a Gramian is read off one exponential; beyond, that of a shorter time is doubled, which cancels nothing."""


@dataclass(frozen=True, eq=False)
class _Group:
    """States that are carried at a pace of their own.

    Args:
        states: which they are (k,).
        shared: how many of these, the last ones, drive other groups, too, and count there.
        series: their transitions.
    """

    states: Indices | slice
    shared: int
    series: TransitionSeries

    def rows(self, X: Array) -> Array:
        """Columns of X (r, q) that belong to these states."""
        own = X[:, self.states]
        if self.shared:
            own[:, own.shape[1] - self.shared :] = 0.0
        return own


class Propagator:
    """exp(M tau) for one matrix M (q, q) and many tau >= 0 [s]; see `TransitionSeries`.

    States that nothing couples, be they fast and slow modes that were taken apart, are carried each at their own pace.
    """

    def __init__(self, M: Array, groups: Sequence[_Group] | None = None) -> None:
        """M (q, q); groups: of its states, where they are known from another matrix's."""
        self.M, self._groups = M, _grouped(M) if groups is None else groups

    @property
    def size(self) -> int:
        """Number of states q."""
        return len(self.M)

    @property
    def pace(self) -> float:
        """How fast exp(M t) changes [rad/s], free of the units of its states; 0 without states."""
        return max(group.series.powers.pace for group in self._groups)

    @cached_property
    def eigenvalues(self) -> ComplexArray:
        """Those of M [rad/s], the ones that several groups share more than once."""
        return np.concatenate([group.series.powers.eigenvalues for group in self._groups])

    @property
    def growth(self) -> float:
        """The largest real part of M's eigenvalues [1/s]; minus infinity without states."""
        return float(np.max(self.eigenvalues.real, initial=-math.inf))

    @property
    def lasting_pace(self) -> float:
        """How fast [rad/s] exp(M t) changes beyond its first moments, in which modes die out within a radian of theirs."""
        modes = self.eigenvalues
        return float(np.max(np.abs(modes[np.abs(modes.real) < np.abs(modes.imag)]), initial=0.0))

    @cached_property
    def transposed(self) -> Propagator:
        """That of M', which shares what is worked out for M."""
        groups = [_Group(group.states, 0, TransitionSeries(TransposedPowers(group.series.powers))) for group in self._groups]
        return Propagator(self.M.T, groups)

    def driven(self, D: Array, S: Array) -> Propagator:
        """That of [M D; 0 S], which shares what is worked out for M: D (q, r), S (r, r)."""
        M = np.block([[self.M, D], [np.zeros((len(S), self.size)), S]])
        both = np.arange(self.size, len(M))
        groups = []
        for number, group in enumerate(self._groups):
            states = slice(None) if len(self._groups) == 1 else np.concatenate([np.arange(self.size)[group.states], both])
            own = group.series.powers
            block = M if isinstance(states, slice) else M[np.ix_(states, states)]
            powers = OwnPowers(block) if math.isinf(own.step) else DrivenPowers(own, D[group.states], S)
            groups.append(_Group(states, len(S) if number else 0, TransitionSeries(powers)))
        return Propagator(M, groups)

    def matrices(self, tau: Array) -> Array:
        """exp(M tau_i) (m, q, q) for times tau (m,) [s], not negative."""
        result = np.zeros((len(tau), self.size, self.size))
        for group in self._groups:
            states = np.arange(self.size)[group.states]
            result[:, states[:, np.newaxis], states] = group.series.matrices(tau)
        return result

    def states(self, v: Array, tau: Array) -> Array:
        """exp(M tau_i) v_i for states v (m, q) and times tau (m,) [s]: (m, q)."""
        result, owner = np.empty_like(v), np.arange(len(tau))
        for group in self._groups:
            own = v[:, group.states]
            result[:, group.states] = group.series.outputs(np.eye(own.shape[1]), own, owner, tau)
        return result

    def outputs(self, X: Array, v: Array, owner: Indices, tau: Array, *, resolution: float = 0.0) -> Array:
        """X exp(M tau_i) v[owner_i] at many times: (m, k).

        Times in order, or in ordered stretches, share most of the work; long stretches of evenly spaced ones nearly all of it.

        Args:
            X: (k, q).
            v: states to start from (g, q).
            owner: which of these each time belongs to (m,).
            tau: times since the start (m,), not negative [s].
            resolution: how far off the times may be (from rounding of the absolute times behind tau) and still count as evenly
                spaced [s].
        """
        values = [
            group.series.outputs(group.rows(X), v[:, group.states], owner, tau, resolution=resolution) for group in self._groups
        ]
        return values[0] if len(values) == 1 else np.asarray(np.sum(values, axis=0))


def _grouped(M: Array) -> list[_Group]:
    """The states of M (q, q) in groups that nothing couples and whose paces are APART, or all of them in one."""
    part = parts(M, one_way=True) if len(M) >= FEW else np.zeros(len(M), dtype=np.intp)
    members = [np.flatnonzero(part == number) for number in range(int(part.max(initial=-1)) + 1)]
    paces = np.array([pace_of(M[np.ix_(states, states)]) for states in members]) if len(members) > 1 else np.zeros(len(members))
    order = np.argsort(paces)
    edges = np.flatnonzero((paces[order][1:] > APART * paces[order][:-1]) & (paces[order][:-1] > 0)) + 1
    if not len(edges):
        return [_Group(slice(None), 0, TransitionSeries(OwnPowers(M)))]
    found = [np.sort(np.concatenate([members[k] for k in chosen])) for chosen in np.split(order, edges)]
    return [_Group(states, 0, TransitionSeries(OwnPowers(M[np.ix_(states, states)]))) for states in found]


def flow(M: Array, v: Array, tau: Array) -> Array:
    """exp(M tau_i) v_i for all i at once: M (q, q), v (m, q), tau (m,) [s], not negative. See `Propagator`."""
    return Propagator(M).states(v, tau)


def forced_states(propagator: Propagator, added: Array, lengths: Array) -> Array:
    """z_0 = 0, z_(j+1) = exp(A L_j) z_j + g_j for pieces j = 0 ... m - 1 of one system z' = A z + ...: all z_j, (m + 1, n).

    propagator: of A; added: what is added over each piece, g (m, n); lengths: L (m,) [s]. Blocks of BLOCK pieces are worked on side
    by side, each from zero; their starts follow one from the other in the same way; then what each start adds within its block is
    put on top. The cost is linear in m.
    """
    m, n = added.shape
    result = np.zeros((m + 1, n))
    if m == 0 or n == 0:
        return result
    blocks = -(-m // BLOCK)
    g, L = np.zeros((blocks * BLOCK, n)), np.zeros(blocks * BLOCK)
    g[:m], L[:m] = added, lengths
    g, L = g.reshape(blocks, BLOCK, n), L.reshape(blocks, BLOCK)
    inner = np.zeros((blocks, BLOCK + 1, n))
    for j in range(min(m, BLOCK)):
        inner[:, j + 1] = (propagator.states(inner[:, j], L[:, j]) if j else 0.0) + g[:, j]
    if blocks > 1:
        elapsed = np.cumsum(L, axis=1)
        start = forced_states(propagator, inner[:-1, -1], elapsed[:-1, -1])
        owner = np.repeat(np.arange(blocks), BLOCK)
        inner[:, 1:] += propagator.outputs(np.eye(n), start, owner, elapsed.ravel()).reshape(blocks, BLOCK, n)
    result[1:] = inner[:, 1:].reshape(-1, n)[:m]
    return result


def zero_order_hold(A: Array, B: Array, hold: float) -> tuple[Array, Array]:
    """A_d (n, n), B_d (n, p) with x(t + hold) = A_d x(t) + B_d u for x' = A x + B u, u constant over `hold` [s].

    [A_d B_d; 0 1] = exp([A B; 0 0] hold). A (n, n), B (n, p); p may be 0.
    """
    n, p = B.shape
    step = scipy.linalg.expm(np.block([[A, B], [np.zeros((p, n + p))]]) * hold)[:n]
    return step[:, :n], step[:, n:]


def held_through(stretches: Iterable[tuple[Array, Array, float]]) -> tuple[Array, Array]:
    """A_d, B_d of one hold in which the system changes: stretches (A, B, duration [s]), at least one, in their order."""
    steps = [zero_order_hold(*stretch) for stretch in stretches]
    A_d, B_d = steps[0]
    for A_next, B_next in steps[1:]:
        A_d, B_d = A_next @ A_d, A_next @ B_d + B_next
    return A_d, B_d


def sampled_noise(A: Array, G: Array, hold: float) -> tuple[Array, Array]:
    """A_d (n, n) and the covariance Q_d (n, n) that white noise adds to the state over `hold` [s], for x' = A x + G w.

    Q_d = integral of exp(A s) G G' exp(A's) over 0 < s < hold; G (n, k), w of unit intensity.
    """
    transition, covariance = transition_and_gramian(A.T, G @ G.T, hold)
    return transition.T, covariance


def transition_and_gramian(M: Array, Q: Array, duration: float) -> tuple[Array, Array]:
    """exp(M duration), and the integral of exp(M's) Q exp(M s) over 0 < s < duration [s]: M, Q (q, q), Q symmetric.

    Source: C. Van Loan, "Computing integrals involving the matrix exponential", IEEE Trans. Automatic Control 23(3), 1978; for
    longer times from doublings of short ones.
    """
    scale = balancing_scale(M, within_parts=True)
    M, Q = duration * M * scale / scale[:, None], duration * scale[:, None] * Q * scale
    q, norm = len(M), float(np.linalg.norm(M, 1))
    doublings = max(0, int(np.ceil(np.log2(norm / VAN_LOAN_NORM)))) if norm > 0 else 0
    both = scipy.linalg.expm(np.block([[-M.T, Q], [np.zeros_like(M), M]]) / 2**doublings)
    transition = both[q:, q:]
    gramian = transition.T @ both[:q, q:]
    for _ in range(doublings):
        gramian = gramian + transition.T @ gramian @ transition
        transition = transition @ transition
    gramian = gramian / scale[:, None] / scale
    return scale[:, None] * transition / scale, (gramian + gramian.T) / 2
