"""Linear systems over a hold of their input: what state, input and noise at its start make of the state at its end, exactly."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.linear.scaling import balancing_scale

Array = NDArray[np.float64]

VAN_LOAN_NORM = 0.5
"""Norm up to which a Gramian is read off one exponential; beyond, that of a shorter time is doubled, which cancels nothing."""


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
