"""Whether a reference can be followed through jumps, judged by least squares on the states at the jumps.

The conditions are those of Devasia, Paden, Rossi 1996, Lemma 1: nothing but what the past leaves before the first jump, outputs and
derivatives as wanted after each, the flow of the tracking dynamics in between, and no antistable part in the end. They are few, so
one dense matrix holds them all.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from tests.random_draws.invariant_zeros import judged
from tests.random_draws.plants import Matrices
from tests.random_draws.switched_plants import LEAST_DISTANCE, DrawnJumps

NODES, WEIGHTS = np.polynomial.legendre.leggauss(12)

MET = 1e-9
"""Conditions are met where the least miss is no larger than this share of their right sides' and the solution's size..."""

MISSED = 1e-5
"""...and missed from this one on. Between the two rounding decides."""

MOST_GROWTH = (1e7, 1e11)
"""What grows by more over one interval must not be there at its start, as if the interval had no end: no number tells what it would
be at the end. Between the two either reason is right."""

UNSTABLE = LEAST_DISTANCE / 2
"""Real part from which on a mode counts as antistable [rad/s]."""

JumpVerdict = Literal["solvable", "band", "incompatible", "unbounded", "either"]


@dataclass(frozen=True, eq=False)
class TrackingDynamics:
    """x' = A_y x + B_r y_d^(r) of a plant whose outputs follow y_d, and the rows C* of outputs and derivatives below the r-th."""

    plant: Matrices
    degrees: tuple[int, ...]

    @cached_property
    def rows(self) -> list[Array]:
        """C_i A^k for k = 0 ... r_i of each output (r_i + 1, n)."""
        A, C = self.plant.A, self.plant.C
        powers = [np.linalg.matrix_power(A, k) for k in range(max(self.degrees) + 1)]
        return [np.array([C[i] @ powers[k] for k in range(r + 1)]) for i, r in enumerate(self.degrees)]

    @cached_property
    def star(self) -> Array:
        """C*, (rho, n)."""
        return np.vstack([rows[:-1] for rows in self.rows])

    @cached_property
    def law(self) -> tuple[Array, Array]:
        """A_y (n, n) and B_r (n, p)."""
        B_y = np.array([rows[-2] @ self.plant.B for rows in self.rows])
        A_x = np.array([rows[-1] for rows in self.rows])
        G = np.linalg.inv(B_y)
        return self.plant.A - self.plant.B @ G @ A_x, self.plant.B @ G

    def wanted(self, drawn: DrawnJumps, t: float) -> Array:
        """Y_d (rho,): the values that C* x must have, in the units in which the plants were drawn."""
        return np.concatenate([[self._derivative(drawn, t, k)[i] for k in range(r)] for i, r in enumerate(self.degrees)])

    def highest(self, drawn: DrawnJumps, t: float) -> Array:
        """y_d^(r) (p,)."""
        return np.array([self._derivative(drawn, t, r)[i] for i, r in enumerate(self.degrees)])

    @staticmethod
    def _derivative(drawn: DrawnJumps, t: float, order: int) -> Array:
        return np.asarray(drawn.reference(t, derivative=order)) / drawn.units.y

    def flow(self, drawn: DrawnJumps, L: Array, start: float, end: float) -> tuple[Array, Array]:
        """E and f of L x(end) = E L x(start) + f, for invariant rows L (k, n); backward in time where end < start."""
        A_y, B_r = self.law
        M, N = L @ A_y @ L.T, L @ B_r
        E, f = np.eye(len(M)), np.zeros(len(M))
        low, high = min(start, end), max(start, end)
        stops = np.unique([low, high, *(t for t in (0.0, drawn.duration) if low < t < high)])
        for a, b in itertools.pairwise(stops if end >= start else stops[::-1]):
            count = int(np.ceil(abs(b - a) / 0.25))
            h = (b - a) / count
            for left in a + h * np.arange(count):
                step = scipy.linalg.expm(M * h)
                drive = sum(
                    w * h / 2 * scipy.linalg.expm(M * h * (1 - c) / 2) @ N @ self.highest(drawn, left + h * (1 + c) / 2)
                    for c, w in zip(NODES, WEIGHTS, strict=True)
                )
                E, f = step @ E, step @ f + drive
        return E, f

    def left_invariant(self, *, above: float = -np.inf, up_to: float = np.inf) -> Array:
        """Rows L (k, n) with L A_y = M L, M with the eigenvalues whose real parts lie between these [rad/s]."""
        A_y, _ = self.law
        _, Q, k = scipy.linalg.schur(A_y.T, sort=lambda re, im: above < re <= up_to)
        return np.asarray(Q[:, :k].T)


@dataclass(frozen=True, eq=False)
class JumpJudgement:
    """The verdict, and the zeros of all intervals (k,)."""

    verdict: JumpVerdict
    zeros: ComplexArray


def judged_jumps(drawn: DrawnJumps) -> JumpJudgement:
    """Whether a bounded continuous state keeps the output exact, and if not, whether the jumps or the ends forbid it."""
    judgements = [judged(plant) for plant in drawn.plants]
    zeros = np.concatenate([judgement.zeros for judgement in judgements])
    ends = (judgements[0], judgements[-1])
    clear = all(j.verdict == "solvable" and np.all(np.abs(j.zeros.real) > LEAST_DISTANCE) for j in ends)
    if not clear:
        return JumpJudgement("band", zeros)
    dynamics = [TrackingDynamics(plant, degrees) for plant, degrees in zip(drawn.plants, drawn.degrees, strict=True)]
    past = _past(drawn, dynamics[0])
    every = _state([*past, *_inner(drawn, dynamics), *_future(drawn, dynamics[-1])])
    if every == "met":
        return JumpJudgement("solvable", zeros)
    reasons = {_first_missed(drawn, dynamics, past, most) for most in MOST_GROWTH}
    if every == "unclear" or "band" in reasons:
        return JumpJudgement("band", zeros)
    return JumpJudgement(reasons.pop() if len(reasons) == 1 else "either", zeros)


def _first_missed(drawn: DrawnJumps, dynamics: list[TrackingDynamics], past: list[Condition], most: float) -> JumpVerdict:
    """Of the conditions in the order of time the first one that cannot be met; what grows more than `most` times is unbounded."""
    conditions = list(past)
    for k in range(len(drawn.switch_times)):
        for kind, more in (("incompatible", [_wanted(drawn, dynamics, k)]), ("unbounded", _flow(drawn, dynamics, k, most))):
            conditions += more
            state = _state(conditions)
            if state != "met":
                return kind if state == "missed" else "band"
    return "unbounded"


Condition = tuple[Array, Array]
"""M (k, N n) and b (k,) of M [x_1; ...; x_N] = b for the states at the jumps."""


def _placed(block: Array, jump: int, drawn: DrawnJumps) -> Array:
    n = block.shape[1]
    row = np.zeros((len(block), n * len(drawn.switch_times)))
    row[:, n * jump : n * (jump + 1)] = block
    return row


def _past(drawn: DrawnJumps, first: TrackingDynamics) -> list[Condition]:
    """But for the antistable part, what the wanted output has made of rest by the first jump."""
    L = first.left_invariant(up_to=UNSTABLE)
    t = float(drawn.switch_times[0])
    return [(_placed(L, 0, drawn), first.flow(drawn, L, 0.0, t)[1] if t > 0 else np.zeros(len(L)))]


def _inner(drawn: DrawnJumps, dynamics: list[TrackingDynamics]) -> list[Condition]:
    numbers = range(len(drawn.switch_times))
    return [*(_wanted(drawn, dynamics, k) for k in numbers), *(row for k in numbers for row in _flow(drawn, dynamics, k, np.inf))]


def _wanted(drawn: DrawnJumps, dynamics: list[TrackingDynamics], k: int) -> Condition:
    """Outputs and derivatives as wanted after jump k."""
    new = dynamics[k + 1]
    return _placed(new.star, k, drawn), new.wanted(drawn, float(drawn.switch_times[k]))


def _flow(drawn: DrawnJumps, dynamics: list[TrackingDynamics], k: int, most: float) -> list[Condition]:
    """The flow from jump k to the next; what grows more than `most` times must not be there, as if the interval had no end."""
    times, new = drawn.switch_times.tolist(), dynamics[k + 1]
    if k + 1 == len(times):
        return []
    fast = max(UNSTABLE, np.log(most) / (times[k + 1] - times[k]))
    found = []
    for antistable in (False, True):  # each part in the direction in which it does not grow
        L = new.left_invariant(above=UNSTABLE, up_to=fast) if antistable else new.left_invariant(up_to=UNSTABLE)
        (a, since), (b, until) = ((k + 1, times[k + 1]), (k, times[k])) if antistable else ((k, times[k]), (k + 1, times[k + 1]))
        E, f = new.flow(drawn, L, since, until)
        found.append((_placed(L, b, drawn) - _placed(E @ L, a, drawn), f))
    L = new.left_invariant(above=fast)
    found.append((_placed(L, k, drawn), new.flow(drawn, L, times[k + 1], times[k])[1]))
    return found


def _future(drawn: DrawnJumps, last: TrackingDynamics) -> list[Condition]:
    """No antistable part in the distance from the equilibrium, once the motion is over."""
    t = float(drawn.switch_times[-1])
    L, plant = last.left_invariant(above=UNSTABLE), last.plant
    E, f = last.flow(drawn, L, max(t, drawn.duration), t)
    n = len(plant.A)
    held = np.concatenate([np.zeros(n), np.asarray(drawn.reference(drawn.duration + 9.0)) / drawn.units.y])
    rest = np.linalg.solve(np.block([[plant.A, plant.B], [plant.C, plant.D]]), held)[:n]
    return [(_placed(L, len(drawn.switch_times) - 1, drawn), E @ L @ rest + f)]


def _state(conditions: list[Condition]) -> Literal["met", "missed", "unclear"]:
    M, b = np.vstack([M for M, _ in conditions]), np.concatenate([b for _, b in conditions])
    unit = np.linalg.norm(M, axis=1)
    keep = unit > 0
    M, b = M[keep] / unit[keep, None], b[keep] / unit[keep]
    x, _, _, values = np.linalg.lstsq(M, b, rcond=1e-10)
    if np.any((values < 1e-7 * values[0]) & (values > 1e-12 * values[0])):
        return "unclear"
    miss = float(np.max(np.abs(M @ x - b)) / max(float(np.max(np.abs(b))), np.finfo(float).tiny))
    return "met" if miss <= MET * max(1.0, float(np.max(np.abs(x)))) else "missed" if miss >= MISSED else "unclear"
