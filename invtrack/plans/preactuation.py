"""The exponential that bounds a plan's input before its manoeuvre, or after it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, real_numbers
from invtrack.errors import TrajectoryError
from invtrack.plans.input_tail import SAME_RATE, SAMPLES, InputTail, input_tail
from invtrack.plans.plan import Plan, require_plan

INDEPENDENT = 1e-5
"""Smallest singular value of unit eigenvectors with which they still span their subspace: below, the modes are not semisimple."""

YIELDED_RATE = 0.95
"""Share of the decay rate that a bound is given for where the slowest modes are not semisimple."""


@dataclass(frozen=True)
class PreactuationBound:
    """|u(t) - u_rest| <= M exp(alpha (t - t_0)) for all t < t_0, in the Euclidean norm over the inputs (in their units).

    alpha [rad/s] is the real part of the slowest mode in the input before the manoeuvre where `semisimple`; where its eigenvalue is
    defective only rates below that admit a bound, and alpha is 0.95 of it. u_rest is the input at rest before the manoeuvre, t_0
    [s] the manoeuvre's start, or where the plan's modes before it end, if that is earlier. Without preactuation there M is 0 and
    alpha infinite.
    """

    alpha: float
    M: float
    t_0: float
    semisimple: bool = True

    def __call__(self, t: ArrayLike) -> Array:
        """M exp(alpha (t - t_0)) at times t (m,) [s], all of them at most t_0."""
        times = np.atleast_1d(real_numbers("times [s]", t))
        if np.any(times > self.t_0):
            raise TrajectoryError(f"the bound holds before the manoeuvre's start t_0 = {self.t_0:.6g} s, got {times.max():.6g} s")
        return np.zeros(len(times)) if self.M == 0 else self.M * np.exp(self.alpha * (times - self.t_0))


def preactuation_bound(plan: Plan) -> PreactuationBound:
    """The exponential that bounds the input before the manoeuvre, as tight as its slowest modes let it be.

    M is the least one to within the resolution of the search and, far from the manoeuvre, the sum over the slowest modes. Modes
    whose share is rounding (1e-12) are left out. Source: Devasia 1996 (non-hyperbolic internal dynamics), section 2.5, Lemma, whose
    M is a product of norms.

    Raises TrajectoryError for a plan that is not at rest before its manoeuvre.
    """
    require_plan(plan)
    tail = input_tail(plan, "before")
    if not tail:
        return PreactuationBound(math.inf, 0.0, tail.edge)
    alpha, M, semisimple = tail_bound(tail)
    return PreactuationBound(alpha, M, tail.edge, semisimple)


def tail_bound(tail: InputTail) -> tuple[float, float, bool]:
    """alpha [rad/s] and M of |u - u_rest| <= M exp(-alpha sigma), and whether the slowest modes are semisimple.

    The tail must not be empty, and must die out.
    """
    slowest = tail.slowest
    slow = -tail.rates.real <= slowest * (1 + SAME_RATE)
    semisimple = float(np.linalg.svd(tail.vectors[:, slow], compute_uv=False)[-1]) > INDEPENDENT
    if not semisimple:
        alpha = YIELDED_RATE * slowest
        sigma = np.linspace(0.0, 60.0 / (slowest - alpha), SAMPLES)
        return alpha, _largest(tail, sigma, alpha), False
    late = tail.amplitude(slow)
    gaps, sizes = -tail.rates.real[~slow] - slowest, np.linalg.norm(tail.shares[:, ~slow], axis=0)
    # Up to `horizon` the input is looked at; beyond it the faster modes together are below 1 % of the slowest ones.
    ratio = np.maximum(100 * len(sizes) * sizes / late, 1.0)
    horizon = min(float(np.max(np.log(ratio) / gaps, initial=0.0)), 60.0 / slowest)
    after = late + float(np.sum(sizes * np.exp(-gaps * horizon)))
    return slowest, max(after, _largest(tail, tail.distances(horizon), slowest)), True


def _largest(tail: InputTail, sigma: Array, shift: float) -> float:
    """Largest exp(shift sigma) |u - u_rest| up to the last sigma: the largest sample and what may lie between two of them."""
    samples = tail.size(sigma, shift)
    slope = float(np.sum(np.abs(tail.rates + shift) * np.linalg.norm(tail.shares, axis=0)))
    # Modes that are nearly parallel have large opposite shares, and their sum says little: then the samples' own differences do.
    between = min(slope * float(sigma[1] - sigma[0]) / 2, 2 * float(np.max(np.abs(np.diff(samples)))))
    return float(np.max(samples)) + between
