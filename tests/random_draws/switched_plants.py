"""Random plants that jump, with outputs and derivatives that are the same functions of the state on both sides, or others."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.profiles import rest_to_rest
from invtrack.references.signal import PiecewiseSignal
from tests.linear.random_plants import rotation
from tests.random_draws.plants import Matrices, Units

MOST_JUMPS = 5
LEAST_DISTANCE = 0.05
"""Of the zeros from the axis [rad/s]."""

KINDS = {"same C*": 0.5, "other gains": 0.15, "other derivatives": 0.15, "other relative degree": 0.1, "other outputs": 0.1}
"""What a jump leaves of C*, the outputs and their derivatives as functions of the state, and the share of the draws."""


@dataclass(frozen=True, eq=False)
class DrawnJumps:
    """A plant for each interval, in units of moderate size, with what invtrack gets.

    Args:
        family: what the jumps leave of C*.
        plants: that of each interval, all with the same states.
        degrees: the relative degree of each interval.
        switch_times: (N,) [s].
        units: in which invtrack gets them.
        model: the plants in these units.
        reference: in these units too, from rest to rest from t = 0 on.
        duration: of its motion [s].
    """

    family: str
    plants: tuple[Matrices, ...]
    degrees: tuple[tuple[int, ...], ...]
    switch_times: Array
    units: Units
    model: SwitchedSystem
    reference: PiecewiseSignal
    duration: float


def drawn_jumps(seed: int, number: int) -> DrawnJumps:
    """The switched plant of this number in the sequence that `seed` starts."""
    rng = np.random.default_rng([seed, number, 1])
    family = str(rng.choice(list(KINDS), p=list(KINDS.values())))
    p, jumps = int(rng.integers(1, 4)), int(rng.integers(1, MOST_JUMPS + 1))
    degrees = tuple(int(r) for r in rng.integers(1, 4, p))
    n_z = int(rng.integers(0, 7))
    n = sum(degrees) + n_z
    T = _coordinates(rng, n)
    drawn = [_interval(rng, family if k else "first", degrees, n_z) for k in range(jumps + 1)]
    plants = tuple(plant.turned(T) for plant, _ in drawn)
    duration = float(rng.uniform(1.5, 4.0))
    first, last = (-1.0, 0.0) if family == "other gains" and rng.random() < 0.5 else (-1.0, duration + 1.0)
    times = first + (last - first) * (np.arange(jumps) + rng.uniform(0.1, 0.9, jumps)) / jumps
    units = Units.drawn(rng, n, p)
    target = rng.normal(size=p)
    return DrawnJumps(
        family=family,
        plants=plants,
        degrees=tuple(which for _, which in drawn),
        switch_times=times,
        units=units,
        model=SwitchedSystem([units.model(plant) for plant in plants], times),
        reference=rest_to_rest(np.zeros(p), target * units.y, duration, smoothness=max(degrees)),
        duration=duration,
    )


def _coordinates(rng: np.random.Generator, n: int) -> Array:
    """Any, or such in which some of the outputs and derivatives are states themselves, to within the rounding of the others."""
    if rng.random() < 0.5:
        return rotation(rng, n) @ np.diag(rng.uniform(0.5, 2.0, n)) @ rotation(rng, n)
    lower = np.tril(rng.normal(size=(n, n)) / np.sqrt(n), k=-1) * (rng.random((n, 1)) < 0.7)
    return (np.eye(n) + lower)[rng.permutation(n)]


def _interval(rng: np.random.Generator, family: str, degrees: tuple[int, ...], n_z: int) -> tuple[Matrices, tuple[int, ...]]:
    """A plant in coordinates [outputs with their derivatives; eta], and its relative degree."""
    p, rho = len(degrees), sum(degrees)
    n = rho + n_z
    A, B, C = np.zeros((n, n)), np.zeros((n, p)), np.zeros((p, n))
    gain = rotation(rng, p) @ np.diag(rng.uniform(1.0, 3.0, p)) @ rotation(rng, p)
    sooner = int(rng.integers(p)) if family == "other relative degree" else -1
    found, first = list(degrees), 0
    for i, r in enumerate(degrees):
        C[i, first] = rng.uniform(0.5, 2.0) if family == "other gains" else 1.0
        slopes = rng.uniform(0.5, 2.0, r - 1) if family == "other derivatives" else np.ones(r - 1)
        A[range(first, first + r - 1), range(first + 1, first + r)] = slopes
        A[first + r - 1] = rng.normal(size=n) / np.sqrt(n)
        B[first + r - 1] = gain[i]
        if i == sooner and r > 1:  # the input acts on the derivative before the last, too
            B[first + r - 2] = gain[i] * rng.choice([-1.0, 1.0])
            found[i] = r - 1
        first += r
    A[rho:, :rho], A[rho:, rho:] = rng.normal(size=(n_z, rho)) / np.sqrt(n), _internal(rng, n_z)
    if family == "other outputs":
        C, found = rng.normal(size=(p, n)), [1] * p
    return Matrices(A, B, C, np.zeros((p, p))), tuple(found)


def _internal(rng: np.random.Generator, n: int) -> Array:
    """Internal dynamics whose eigenvalues keep their distance from the axis."""
    while True:
        Q = rng.normal(size=(n, n)) / np.sqrt(max(n, 1)) + rng.normal() * np.eye(n)
        if n == 0 or np.min(np.abs(np.linalg.eigvals(Q).real)) > LEAST_DISTANCE:
            return Q
