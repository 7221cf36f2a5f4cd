"""Random plants of many kinds, each with a reference that is smooth enough for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.linear.state_space import StateSpace
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.linear.random_plants import block, rotation

LARGEST_ORDER = 60
MOST_CHANNELS = 5
STATE_SCALE = 20
"""States are scaled by powers of two up to 2^+-20, about 1e+-6: exactly, so that the plant stays the same to the last bit."""
CHANNEL_SCALE = 10
"""Inputs and outputs, up to 2^+-10, about 1e+-3."""


@dataclass(frozen=True, eq=False)
class Matrices:
    """x' = A x + B u, y = C x + D u in units in which all entries are of moderate size."""

    A: Array
    B: Array
    C: Array
    D: Array

    @property
    def p(self) -> int:
        """Number of outputs, and of inputs where there are not more."""
        return len(self.D)

    def turned(self, T: Array) -> Matrices:
        """In the coordinates T x."""
        return Matrices(
            *(np.asarray(M) for M in (T @ np.linalg.solve(T.T, self.A.T).T, T @ self.B, np.linalg.solve(T.T, self.C.T).T)), self.D
        )


@dataclass(frozen=True, eq=False)
class Units:
    """By which powers of two states (n,), inputs (p,) and outputs (p,) are multiplied before a model is handed to invtrack."""

    x: Array
    u: Array
    y: Array

    @classmethod
    def drawn(cls, rng: np.random.Generator, n: int, p: int) -> Units:
        """Random ones."""
        state = np.exp2(rng.integers(-STATE_SCALE, STATE_SCALE + 1, n))
        u, y = np.exp2(rng.integers(-CHANNEL_SCALE, CHANNEL_SCALE + 1, (2, p)))
        return cls(state, u, y)

    def model(self, unit: Matrices) -> StateSpace:
        """The same plant in these units, which changes no digit of any entry."""
        return StateSpace(
            unit.A * self.x[:, None] / self.x,
            unit.B * self.x[:, None] / self.u,
            unit.C * self.y[:, None] / self.x,
            unit.D * self.y[:, None] / self.u,
        )


@dataclass(frozen=True, eq=False)
class DrawnPlant:
    """A plant, the units in which invtrack gets it, and a reference from rest to rest in these units.

    orders: how many derivatives of the outputs the inverse needs at most (the highest order of a zero at infinity).
    """

    family: str
    unit: Matrices
    units: Units
    model: StateSpace
    reference: PiecewiseSignal


def drawn_plant(seed: int, number: int) -> DrawnPlant:
    """The plant of this number in the sequence that `seed` starts."""
    rng = np.random.default_rng([seed, number])
    families = list(FAMILIES)
    family = families[int(rng.choice(len(families), p=[FAMILIES[name][1] for name in families]))]
    unit, order = FAMILIES[family][0](rng)
    units = Units.drawn(rng, len(unit.A), unit.p)
    target = rng.normal(size=unit.p) * (rng.random(unit.p) < 0.7)
    target[rng.integers(unit.p)] = 1.0
    reference = rest_to_rest(np.zeros(unit.p), target * units.y, float(rng.uniform(1.0, 5.0)), smoothness=order)
    return DrawnPlant(family, unit, units, units.model(unit), reference)


def drawn_order(rng: np.random.Generator, least: int) -> int:
    """An order from `least` on: half of the time at most ten, else up to the largest."""
    return int(rng.integers(least, max(least, 10 if rng.random() < 0.5 else LARGEST_ORDER) + 1))


def dense(rng: np.random.Generator) -> tuple[Matrices, int]:
    """No structure at all, and a feedthrough of any rank."""
    n = drawn_order(rng, 2)
    p = int(rng.integers(1, min(MOST_CHANNELS, n) + 1))
    rank = int(rng.integers(0, p + 1)) if rng.random() < 0.5 else 0
    D = rng.normal(size=(p, rank)) @ rng.normal(size=(rank, p))
    A = rng.normal(size=(n, n)) / np.sqrt(n) + rng.normal() * np.eye(n) / 2
    return Matrices(A, rng.normal(size=(n, p)), rng.normal(size=(p, n)), D), 0 if rank == p else 1


def chains(rng: np.random.Generator, *, zero: Callable[[np.random.Generator, int], Array] | None = None) -> tuple[Matrices, int]:
    """A vector relative degree from 0 to 4 for each output, and internal dynamics of a chosen kind, in turned coordinates."""
    p = int(rng.integers(1, MOST_CHANNELS + 1))
    degrees = rng.integers(0 if rng.random() < 0.3 else 1, 5, p)
    degrees[0] = max(degrees[0], 1)
    rho = int(degrees.sum())
    room = drawn_order(rng, max(rho, 2)) - rho
    internal = (zero or DYNAMICS[int(rng.integers(len(DYNAMICS)))])(rng, min(room, 30))
    n_z = len(internal)
    n = rho + n_z
    A, B, C, D = np.zeros((n, n)), np.zeros((n, p)), np.zeros((p, n)), np.zeros((p, p))
    gain = rotation(rng, p) @ np.diag(rng.uniform(1.0, 3.0, p)) @ rotation(rng, p)
    first = 0
    for i, r in enumerate(degrees.tolist()):
        if r == 0:
            C[i], D[i] = rng.normal(size=n) / np.sqrt(n), gain[i]
            continue
        C[i, first] = 1.0
        A[range(first, first + r - 1), range(first + 1, first + r)] = 1.0
        A[first + r - 1], B[first + r - 1] = rng.normal(size=n) / np.sqrt(n), gain[i]
        first += r
    # eta' = Q eta + P zeta + G (y of the outputs without a derivative, which reach it through the input)
    A[rho:, :rho], A[rho:, rho:] = rng.normal(size=(n_z, rho)) / np.sqrt(n), internal
    direct = np.flatnonzero(degrees == 0)
    push = rng.normal(size=(n_z, len(direct))) / np.sqrt(n)
    A[rho:] += push @ C[direct]
    B[rho:] += push @ D[direct]
    return Matrices(A, B, C, D).turned(rotation(rng, n) @ np.diag(rng.uniform(0.5, 2.0, n)) @ rotation(rng, n)), int(degrees.max())


def without_relative_degree(rng: np.random.Generator) -> tuple[Matrices, int]:
    """Outputs mixed with each other, so that one that an input reaches late has a part of one that it reaches early."""
    unit, order = chains(rng)
    mix = rotation(rng, unit.p) @ np.diag(rng.uniform(0.5, 2.0, unit.p)) @ rotation(rng, unit.p)
    return Matrices(unit.A, unit.B, mix @ unit.C, mix @ unit.D), order


def with_hidden_modes(rng: np.random.Generator) -> tuple[Matrices, int]:
    """One of the above, and beside it modes that no input moves, that no output shows, or both."""
    unit, order = (dense, chains, without_relative_degree)[int(rng.integers(3))](rng)
    unit = truncated(unit)
    n = len(unit.A)
    unreached, unseen = (block(*hidden_values(rng)) for _ in range(2))
    a, b = len(unreached), len(unseen)
    coupling = [rng.normal(size=shape) / np.sqrt(n) for shape in ((n, a), (b, n), (b, a))]
    A = np.block(
        [
            [unit.A, coupling[0], np.zeros((n, b))],
            [np.zeros((a, n)), unreached, np.zeros((a, b))],
            [coupling[1], coupling[2], unseen],
        ]
    )
    B = np.vstack([unit.B, np.zeros((a, unit.p)), rng.normal(size=(b, unit.p))])
    C = np.hstack([unit.C, rng.normal(size=(unit.p, a)), np.zeros((unit.p, b))])
    return Matrices(A, B, C, unit.D).turned(rotation(rng, n + a + b)), order


def truncated(unit: Matrices) -> Matrices:
    """The plant, if it leaves room for six more states; a lag for each channel otherwise."""
    if len(unit.A) + 6 <= LARGEST_ORDER:
        return unit
    return Matrices(-np.eye(unit.p), np.eye(unit.p), np.eye(unit.p), np.zeros((unit.p, unit.p)))


def hidden_values(rng: np.random.Generator) -> list[complex]:
    """Modes to hide, 0 to 3 of them, off the imaginary axis."""
    values = rng.normal(size=int(rng.integers(0, 4)))
    return [complex(value + np.copysign(0.1, value)) for value in values]


def mechanism(rng: np.random.Generator) -> tuple[Matrices, int]:
    """Masses in a row between springs and light dampers; forces on some, the same ones or the neighbour of the only one seen."""
    masses = int(rng.integers(2, LARGEST_ORDER // 2 + 1))
    p = int(rng.integers(1, min(MOST_CHANNELS, masses) + 1))
    pushed = np.sort(rng.permutation(masses)[:p])
    apart = int(rng.integers(0, min(3, masses))) if p == 1 else 0
    seen = (pushed + apart) % masses if p == 1 and pushed[0] + apart < masses else pushed
    stretch = np.eye(masses) - np.eye(masses, k=-1)
    k, m = rng.uniform(0.5, 2.0, masses), rng.uniform(0.5, 2.0, masses)
    k[0] *= rng.random() < 0.7  # else free to drift
    K = stretch.T @ (k[:, None] * stretch)
    G = float(10 ** rng.uniform(-4, -1)) * K + float(10 ** rng.uniform(-4, -1)) * np.eye(masses)
    zero, unity = np.zeros((masses, masses)), np.eye(masses)
    A = np.block([[zero, unity], [-K / m[:, None], -G / m[:, None]]])
    B = np.vstack([np.zeros((masses, p)), unity[:, pushed] / m[:, None]])
    C = np.hstack([unity[seen], np.zeros((p, masses))])
    distance = int(seen[0] - pushed[0])
    return Matrices(A, B, C, np.zeros((p, p))), 2 + distance


def degenerate(rng: np.random.Generator) -> tuple[Matrices, int]:
    """No inverse at all: inputs that do the same, outputs that say the same, or fewer modes in common than channels."""
    unit, order = dense(rng)
    if unit.p == 1:
        return Matrices(unit.A, np.zeros_like(unit.B), unit.C, np.zeros((1, 1))), 1
    kind = int(rng.integers(3))
    B, C, D = unit.B.copy(), unit.C.copy(), unit.D.copy()
    mix = rng.normal(size=unit.p - 1)
    if kind == 0:
        B[:, -1], D[:, -1] = B[:, :-1] @ mix, D[:, :-1] @ mix
    elif kind == 1:
        C[-1], D[-1] = mix @ C[:-1], mix @ D[:-1]
    else:  # C (sI - A)^-1 b = 0 for the last input: it moves only states that no output shows
        n = len(unit.A)
        A = np.block([[unit.A, np.zeros((n, 1))], [rng.normal(size=(1, n)), -np.ones((1, 1))]])
        B, C = np.vstack([B, np.zeros((1, unit.p))]), np.hstack([C, np.zeros((unit.p, 1))])
        B[:, -1], D[:, -1], B[-1, -1] = 0.0, 0.0, 1.0
        return Matrices(A, B, C, D).turned(rotation(rng, n + 1)), order
    return Matrices(unit.A, B, C, D), order


def general_zeros(rng: np.random.Generator, room: int) -> Array:
    """Internal dynamics without structure."""
    n = int(rng.integers(0, room + 1))
    return rng.normal(size=(n, n)) / np.sqrt(max(n, 1))


def zeros_near_the_axis(rng: np.random.Generator, room: int) -> Array:
    """One zero, or a pair, at a distance from the axis of 1e-9 to 0.1 of its size."""
    share, side = 10 ** rng.uniform(-9.0, -1.0), rng.choice([-1.0, 1.0])
    near = complex(side * share, 1.0) * rng.uniform(0.3, 3.0) if room > 1 else complex(side * share)
    return coupled(rng, block(near) if room else np.zeros((0, 0)), general_zeros(rng, max(room - 2, 0)))


def zeros_on_the_axis(rng: np.random.Generator, room: int) -> Array:
    """One at the origin, or a pair on the axis."""
    on = complex(0.0, float(rng.uniform(0.3, 3.0))) if room > 1 and rng.random() < 0.7 else 0j
    return coupled(rng, block(on) if room else np.zeros((0, 0)), general_zeros(rng, max(room - 2, 0)))


def repeated_zeros(rng: np.random.Generator, room: int) -> Array:
    """Two or three equal ones, in one chain or independent of each other."""
    count = min(room, int(rng.integers(2, 4)))
    value = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 2.0))
    chain = np.eye(count, k=1) if rng.random() < 0.5 else np.zeros((count, count))
    return coupled(rng, value * np.eye(count) + chain, general_zeros(rng, max(room - count, 0)))


def coupled(rng: np.random.Generator, first: Array, second: Array) -> Array:
    """Both in one matrix, the second acting on the first."""
    joined = scipy.linalg.block_diag(first, second)
    joined[: len(first), len(first) :] = rng.normal(size=(len(first), len(second))) / np.sqrt(max(len(joined), 1))
    return np.asarray(joined)


DYNAMICS = (general_zeros, general_zeros, zeros_near_the_axis, repeated_zeros)

FAMILIES: dict[str, tuple[Callable[[np.random.Generator], tuple[Matrices, int]], float]] = {
    "dense": (dense, 0.30),
    "chains": (chains, 0.20),
    "no vector relative degree": (without_relative_degree, 0.15),
    "hidden modes": (with_hidden_modes, 0.15),
    "mechanism": (mechanism, 0.10),
    "zeros on the axis": (lambda rng: chains(rng, zero=zeros_on_the_axis), 0.05),
    "degenerate": (degenerate, 0.05),
}
"""Each kind of plant, and its share of the draws."""
