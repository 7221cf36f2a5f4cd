"""Whether a plan is a motion of its plant: from the plan's own states the plant is integrated under its input, stretch by stretch.

x(b) = exp(A h) x(a) + integral of exp(A (b - s)) B u(s) ds, with the exact matrix exponential and 12 Gauss points for the integral,
over stretches so short that both are exact to rounding. Nothing of the plan's certificate is used.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.plans.plan import Plan
from tests.random_draws.plants import Matrices, Units

STRETCHES = 300
"""Stretches of the coarse kind per piece of a plan at most; they cover it unless that takes more, and are spread evenly then."""

IN_TAILS = 24
"""Stretches before and after the manoeuvre, their distances from it growing by a constant factor."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)

FLOOR = 1e-6
"""A state or output smaller than this share of the largest one is measured against that share: in the drawn units all are of
moderate size, and one that stays at rest far from where the plant is pushed is rounding."""

AT_REST = (0.0, 1.0, 10.0, 100.0)
"""How many lengths of the manoeuvre beyond its ends a plan is looked at."""


@dataclass(frozen=True)
class Contradiction:
    """By how much a plan misses each condition, as a share of the size of the terms of that condition (the largest in time).

    Args:
        dynamics: x at the end of a stretch against the integration of x' = A x + B u from its start.
        output: C x + D u, and the plan's y, against the reference.
        continuity: x on both sides of a breakpoint.
        ends: the distance from rest at the plan's ends and beyond.
    """

    dynamics: float
    output: float
    continuity: float
    ends: float

    @property
    def worst(self) -> float:
        """The largest of them; NaN counts as infinite."""
        found = max(self.dynamics, self.output, self.continuity, self.ends)
        return np.inf if np.isnan([self.dynamics, self.output, self.continuity, self.ends]).any() else found


@dataclass(frozen=True, eq=False)
class Interval:
    """A plant that holds between two times [s], with the exponentials that the integration needs."""

    plant: Matrices
    start: float
    end: float

    @cached_property
    def size(self) -> float:
        """Norm of A [rad/s]."""
        return float(np.linalg.norm(self.plant.A, 2))

    @cached_property
    def _flows(self) -> dict[float, tuple[Array, Array]]:
        """What `flow` has found."""
        return {}

    def flow(self, h: float) -> tuple[Array, Array]:
        """exp(A h) (n, n), and the weights (12, n, p) of B u at the Gauss points of a stretch of length h."""
        if h not in self._flows:
            left = np.concatenate([h * (1 - NODES) / 2, [h]])
            flows = scipy.linalg.expm(self.plant.A * left[:, None, None])
            self._flows[h] = flows[-1], (flows[:-1] @ self.plant.B) * (WEIGHTS * h / 2)[:, None, None]
        return self._flows[h]


def contradiction(
    plan: Plan, plants: Sequence[Matrices], switch_times: Array, units: Units, *, zeros: ComplexArray
) -> Contradiction:
    """How far a plan is from its plant and its reference.

    Args:
        plan: in the units in which invtrack got the plant.
        plants: that of each interval, in units of moderate size.
        switch_times: when they change [s].
        units: by which the two differ.
        zeros: the modes of their inverses [rad/s], which say how fast inputs can change.
    """
    bounds = [-np.inf, *switch_times.tolist(), np.inf]
    intervals = [Interval(plant, *span) for plant, span in zip(plants, itertools.pairwise(bounds), strict=True)]
    values = _Values(plan, units)
    sums = _Sums(len(plants[0].A), plants[0].p)
    stops = np.union1d(np.union1d(plan.breakpoints, plan.reference.breakpoints), switch_times)
    steps = Steps.of([interval.size for interval in intervals], zeros, max(stops[-1] - stops[0], 1e-3))
    for interval in intervals:
        sums.add(interval, values, np.array(list(_stretches(interval, stops, plan, steps))))
    return Contradiction(
        dynamics=share(sums.x_miss, sums.x_size),
        output=share(sums.y_miss, sums.y_size),
        continuity=share(values.jumps(stops), sums.x_size),
        ends=_away_from_rest(values, intervals, sums),
    )


def _stretches(interval: Interval, stops: Array, plan: Plan, steps: Steps) -> Iterator[tuple[float, float]]:
    """Start [s] and length [s] of what is integrated: every piece of the plan in the interval, and the tails before and after."""
    inner = stops[(stops > interval.start) & (stops < interval.end)]
    edges = [t for t in (interval.start, *inner.tolist(), interval.end) if np.isfinite(t)]
    for a, b in itertools.pairwise(edges):
        for since, h in steps.over(b - a):
            yield a + since, h
    outward = list(steps.outward(1.5 * max(plan.preactuation, plan.postactuation)))
    if not np.isfinite(interval.start):
        yield from ((edges[0] - since - h, h) for since, h in outward)
    if not np.isfinite(interval.end):
        yield from ((edges[-1] + since, h) for since, h in outward)


@dataclass(frozen=True)
class Steps:
    """Lengths of stretches [s] that 12 Gauss points integrate to rounding: `coarse`, but from `fine` on at the ends of a piece.

    A fast part of the input that dies out within a period of its own lives next to a breakpoint, on one side or the other: there
    the stretches are half as long as their distance from it.
    """

    fine: float
    coarse: float

    @classmethod
    def of(cls, sizes: Sequence[float], zeros: ComplexArray, duration: float) -> Steps:
        """For plants of these norms [rad/s], for inverses with these modes [rad/s], for a polynomial over `duration` [s]."""
        lasting = np.abs(zeros)[np.abs(zeros.real) < np.abs(zeros.imag)]
        coarse = 2.0 / max(*sizes, 8.0 / duration, float(np.max(lasting, initial=0.0)))
        return cls(min(coarse, 1.0 / float(np.max(np.abs(zeros), initial=1e-9))), coarse)

    def layer(self, limit: float) -> list[tuple[float, float]]:
        """Distance from a breakpoint, and length, of the stretches next to it; no further than `limit` [s] from it."""
        found, since, h = [], 0.0, self.fine
        while h < self.coarse and since + h <= limit:
            found.append((since, h))
            since, h = since + h, h * 1.5
        return found

    def over(self, length: float) -> list[tuple[float, float]]:
        """Distance from its start, and length, of the stretches that cover a piece of this `length` [s]."""
        layer = self.layer(length / 3)
        start = layer[-1][0] + layer[-1][1] if layer else 0.0
        h = min(self.coarse, length - 2 * start)
        count = min(int(np.ceil((length - 2 * start) / h)), STRETCHES)
        middle = [(float(since), h) for since in np.linspace(start, length - start - h, count)]
        return [*layer, *middle, *((length - since - h, h) for since, h in layer)]

    def outward(self, reach: float) -> list[tuple[float, float]]:
        """Distance from the manoeuvre, and length, of stretches out to `reach` [s], where times still resolve them."""
        layer = self.layer(np.inf)
        start = layer[-1][0] + layer[-1][1] if layer else 0.0
        furthest = min(max(reach, 20 * self.coarse), 1e9 * self.coarse)
        far = np.concatenate([[0.0], np.geomspace(self.coarse, furthest, IN_TAILS)])
        return [*layer, *((start + float(since), self.coarse) for since in far)]


class _Values:
    """A plan's values in the units in which the plant was drawn."""

    def __init__(self, plan: Plan, units: Units) -> None:
        self.plan, self.units = plan, units

    def at(self, t: Array, inside: Array | float) -> tuple[Array, Array, Array, Array]:
        """x, u, y and y_d at times (k,) within the pieces that hold the times `inside`."""
        s = self.plan(t, inside=np.broadcast_to(inside, t.shape))
        return s.x / self.units.x, s.u / self.units.u, s.y / self.units.y, s.y_d / self.units.y

    def jumps(self, stops: Array) -> Array:
        """Largest jump of each state at a breakpoint (n,)."""
        around = np.concatenate([[stops[0] - 1.0], (stops[:-1] + stops[1:]) / 2, [stops[-1] + 1.0]])
        left, right = (self.plan.states(stops, inside=side) for side in (around[:-1], around[1:]))
        return np.max(np.abs(left - right), axis=0) / self.units.x


class _Sums:
    """The largest misses so far, and the largest terms."""

    def __init__(self, n: int, p: int) -> None:
        self.x_miss, self.x_size, self.x_peak = np.zeros(n), np.zeros(n), np.zeros(n)
        self.y_miss, self.y_size = np.zeros(p), np.zeros(p)

    def add(self, interval: Interval, values: _Values, stretches: Array) -> None:
        """Integrate over stretches (k, 2), each from its start [s] for its length [s], and note what differs."""
        start, h = stretches.T[:, :, None]
        t = start + h * np.concatenate([[0.0], (1 + NODES) / 2, [1.0]])
        planned = values.at(t.ravel(), np.broadcast_to(start + h / 2, t.shape).ravel())
        x, u, y, y_d = (part.reshape(*t.shape, -1) for part in planned)
        plant, (flow, drive) = interval.plant, zip(*map(interval.flow, h[:, 0].tolist()), strict=True)
        reached = np.einsum("kab,kb->ka", flow, x[:, 0]) + np.einsum("kgnp,kgp->kn", drive, u[:, 1:-1])
        terms = np.abs(x) @ np.abs(plant.A).T + np.abs(u) @ np.abs(plant.B).T
        self.x_miss = np.maximum(self.x_miss, np.max(np.abs(reached - x[:, -1]), axis=0))
        self.x_peak = np.maximum(self.x_peak, np.max(np.abs(x), axis=(0, 1)))
        self.x_size = np.maximum(self.x_size, np.max(np.abs(x) + h[:, :, None] * terms, axis=(0, 1)))
        shown = x @ plant.C.T + u @ plant.D.T
        self.y_miss = np.maximum(self.y_miss, np.max(np.maximum(np.abs(shown - y_d), np.abs(y - y_d)), axis=(0, 1)))
        possible = np.abs(x) @ np.abs(plant.C).T + np.abs(u) @ np.abs(plant.D).T + np.abs(y_d)
        self.y_size = np.maximum(self.y_size, np.max(possible, axis=(0, 1)))


def share(miss: Array, size: Array) -> float:
    """The largest miss as a share of its terms; NaN and infinity stay what they are."""
    return float(np.max(miss / np.maximum(size, max(FLOOR * float(np.max(size)), np.finfo(float).tiny))))


def _away_from_rest(values: _Values, intervals: Sequence[Interval], sums: _Sums) -> float:
    """Distance from rest at the plan's ends and beyond: of x from zero before, of x from staying and A x + B u from zero after."""
    plan = values.plan
    length = max(plan.manoeuvre[1] - plan.manoeuvre[0], 1.0)
    beyond = np.array(AT_REST) * length
    before, _, _, _ = values.at(plan.start - beyond, plan.start - length)
    x, u, _, _ = values.at(plan.end + beyond, plan.end + length)
    A, B = intervals[-1].plant.A, intervals[-1].plant.B
    terms = np.abs(x) @ np.abs(A).T + np.abs(u) @ np.abs(B).T + sums.x_peak
    return max(
        share(np.max(np.abs(before), axis=0), sums.x_size),
        share(np.max(np.abs(x - x[:1]), axis=0), sums.x_size),
        share(np.max(np.abs(x @ A.T + u @ B.T), axis=0), np.max(terms, axis=0)),
    )
