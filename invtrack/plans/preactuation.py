"""The input of a plan before its manoeuvre, as the sum of modes that grow towards it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, real_numbers, require_share
from invtrack.errors import TrajectoryError
from invtrack.linear.propagation import flow
from invtrack.plans.plan import Plan, require_plan

UNEXCITED = 1e-12
"""A mode with less than this share of the input before the manoeuvre is rounding."""

SAME_RATE = 1e-6
"""Modes whose real parts differ by less than this share are equally slow (rounding splits repeated ones)."""

INDEPENDENT = 1e-5
"""Smallest singular value of unit eigenvectors with which they still span their subspace: below, the modes are not semisimple."""

YIELDED_RATE = 0.95
"""Share of the decay rate that a bound is given for where the slowest modes are not semisimple."""

SAMPLES = 40_000
"""Points at which an input is looked at, at most."""


@dataclass(frozen=True, eq=False)
class InputGrowth:
    """u(t_0 - sigma) - u_rest = X exp(-A sigma) z, A antistable, in modes: the same is sum_j shares_j exp(-rates_j sigma).

    Args:
        A, X, z: (n_z, n_z), (p, n_z) and (n_z,); without states where there is no preactuation.
        u_rest: input at rest before the manoeuvre (p,).
        rates: eigenvalues of A whose modes appear in the input (k,) [rad/s].
        shares: what each of these modes adds to the input at t_0 (p, k).
        vectors: eigenvectors of A that belong to the rates (n_z, k).
    """

    A: Array
    X: Array
    z: Array
    u_rest: Array
    rates: ComplexArray
    shares: ComplexArray
    vectors: ComplexArray

    def size(self, sigma: Array, shift: float = 0.0) -> Array:
        """exp(shift sigma) |u(t_0 - sigma) - u_rest| at each sigma >= 0 [s]."""
        states = flow(shift * np.eye(len(self.A)) - self.A, np.broadcast_to(self.z, (len(sigma), len(self.z))), sigma)
        return np.asarray(np.linalg.norm(states @ self.X.T, axis=1))


def input_growth(plan: Plan) -> InputGrowth:
    """The modes of the plan's tail before the manoeuvre. Raises TrajectoryError for one in which the reference goes on moving."""
    require_plan(plan)
    tail, u_0 = plan.trajectory.before, plan.model.operating_point.u0
    n = plan.model.n_states
    rows = slice(n, n + plan.model.n_inputs)
    if not tail.holds_still and np.any(tail.X_w[rows] @ tail.S):
        raise TrajectoryError(
            "the plan is not at rest before its manoeuvre: the reference moves there for ever; let it hold still before its start"
        )
    u_rest = u_0 + tail.held[rows]
    if not tail.departs:
        return _none(u_rest)
    A, X, z = -tail.departure.M, tail.X[rows], tail.v
    rates, vectors = np.linalg.eig(A)
    shares = (X @ vectors) * np.linalg.solve(vectors, z.astype(complex))
    size = np.linalg.norm(shares, axis=0)
    excited = size > UNEXCITED * max(float(np.max(size)), UNEXCITED * float(np.linalg.norm(np.abs(X) @ np.abs(z))))
    if not np.any(excited):
        return _none(u_rest)
    return InputGrowth(A, X, z, u_rest, rates[excited], shares[:, excited], vectors[:, excited])


def _none(u_rest: Array) -> InputGrowth:
    none = np.zeros(0, dtype=complex)
    return InputGrowth(np.zeros((0, 0)), np.zeros((len(u_rest), 0)), np.zeros(0), u_rest, none, none[None], none[None])


@dataclass(frozen=True)
class PreactuationBound:
    """|u(t) - u_rest| <= M exp(alpha (t - t_0)) for all t < t_0, in the Euclidean norm over the inputs (in their units).

    alpha [rad/s] is the real part of the slowest mode in the input before the manoeuvre where `semisimple`; where its eigenvalue is
    defective only rates below that admit a bound, and alpha is 0.95 of it. u_rest is the input at rest before the manoeuvre, t_0
    [s] the manoeuvre's start. Without preactuation M is 0 and alpha infinite.
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


def plan_preactuation_time(plan: Plan, level: float = 0.01) -> float:
    """Time [s] before the manoeuvre's start from which on |u - u_rest| gets above `level` of its peak; 0 if it never does.

    Euclidean norm over the inputs, peak over the whole plan, u_rest the input at rest before the manoeuvre. It is the envelope that
    counts: an input that oscillates is counted from where it first exceeds the level.

    Raises TrajectoryError for a level outside 0 ... 1, or a plan that is not at rest before its manoeuvre.
    """
    require_share("level, a share of the peak input such as 0.01,", level, error=TrajectoryError)
    growth = input_growth(plan)
    if not len(growth.z):
        return 0.0
    bound = _bound(growth, plan.manoeuvre[0])
    limit = level * _peak(plan, growth, bound)
    if limit >= bound.M:
        return 0.0
    horizon = math.log(bound.M / limit) / bound.alpha
    sigma = np.linspace(0.0, horizon, _count(horizon, growth))
    above = np.flatnonzero(growth.size(sigma) > limit)
    if not above.size:
        return 0.0
    last = int(above[-1])
    if last == len(sigma) - 1:
        return horizon

    def excess(s: float) -> float:
        return float(growth.size(np.array([s]))[0]) - limit

    low, high = sigma[last], sigma[last + 1]
    if excess(low) <= 0 or excess(high) >= 0:  # the crossing lies on one of the two samples, to within rounding
        return float(min(low, high, key=lambda s: abs(excess(s))))
    return float(scipy.optimize.brentq(excess, low, high))


def preactuation_bound(plan: Plan) -> PreactuationBound:
    """The exponential that bounds the input before the manoeuvre, as tight as its slowest modes let it be.

    M is the least one to within the resolution of the search and, far from the manoeuvre, the sum over the slowest modes. Modes
    whose share is rounding (1e-12) are left out. Source: Devasia 1996 (non-hyperbolic internal dynamics), section 2.5, Lemma, whose
    M is a product of norms.

    Raises TrajectoryError for a plan that is not at rest before its manoeuvre.
    """
    growth = input_growth(plan)
    return _bound(growth, plan.manoeuvre[0]) if len(growth.z) else PreactuationBound(math.inf, 0.0, plan.manoeuvre[0])


def _bound(growth: InputGrowth, t_0: float) -> PreactuationBound:
    slowest = float(np.min(growth.rates.real))
    slow = growth.rates.real <= slowest * (1 + SAME_RATE)
    semisimple = float(np.linalg.svd(growth.vectors[:, slow], compute_uv=False)[-1]) > INDEPENDENT
    if not semisimple:
        alpha = YIELDED_RATE * slowest
        sigma = np.linspace(0.0, 60.0 / (slowest - alpha), SAMPLES)
        return PreactuationBound(alpha, _largest(growth, sigma, alpha), t_0, False)
    late = _quasiperiodic_peak(growth.rates[slow], growth.shares[:, slow])
    gaps, sizes = growth.rates.real[~slow] - slowest, np.linalg.norm(growth.shares[:, ~slow], axis=0)
    # Up to `horizon` the input is looked at; beyond it the faster modes together are below 1 % of the slowest ones.
    ratio = np.maximum(100 * len(sizes) * sizes / late, 1.0)
    horizon = float(np.max(np.log(ratio) / gaps, initial=0.0))
    horizon = min(horizon, 60.0 / slowest)
    after = late + float(np.sum(sizes * np.exp(-gaps * horizon)))
    sigma = np.linspace(0.0, max(horizon, np.finfo(float).tiny), _count(horizon, growth))
    return PreactuationBound(slowest, max(after, _largest(growth, sigma, slowest)), t_0)


def _largest(growth: InputGrowth, sigma: Array, shift: float) -> float:
    """Largest exp(shift sigma) |u - u_rest| up to the last sigma: the largest sample and what may lie between two of them."""
    samples = growth.size(sigma, shift)
    slope = float(np.sum(np.abs(growth.rates - shift) * np.linalg.norm(growth.shares, axis=0)))
    # Modes that are nearly parallel have large opposite shares, and their sum says little: then the samples' own differences do.
    between = min(slope * float(sigma[1] - sigma[0]) / 2, 2 * float(np.max(np.abs(np.diff(samples)))))
    return float(np.max(samples)) + between


def _quasiperiodic_peak(rates: ComplexArray, shares: ComplexArray) -> float:
    """Bound on |sum_j shares_j exp(-j Im(rates_j) sigma)| over all sigma, reached where the frequencies have no common measure."""
    real, upper = np.abs(rates.imag) <= SAME_RATE * np.abs(rates), rates.imag > SAME_RATE * np.abs(rates)
    peak = float(np.linalg.norm(np.sum(shares[:, real].real, axis=1)))
    for share in shares[:, upper].T:
        peak += 2 * float(np.linalg.norm(np.column_stack([share.real, share.imag]), 2))
    return peak


def _count(horizon: float, growth: InputGrowth) -> int:
    return int(np.clip(np.ceil(200 * horizon * np.max(np.abs(growth.rates))), 200, SAMPLES))


def _peak(plan: Plan, growth: InputGrowth, bound: PreactuationBound) -> float:
    """Largest |u - u_rest| of the plan (its part before the manoeuvre from the modes)."""
    edges = np.unique(np.concatenate([plan.breakpoints, [plan.end]]))
    middle, half = (edges[:-1] + edges[1:]) / 2, np.diff(edges) / 2
    nodes = np.cos(np.linspace(0.0, np.pi, max(64, 8192 // max(len(middle), 1))))
    times = (middle[:, None] + half[:, None] * nodes).ravel()
    inside = np.repeat(middle, len(nodes))
    within = float(np.max(np.linalg.norm(plan.inputs(times, inside=inside) - growth.u_rest, axis=1), initial=0.0))
    horizon = 10.0 / bound.alpha
    return max(within, float(np.max(growth.size(np.linspace(0.0, horizon, _count(horizon, growth))))))
