"""Sizes of states, for those that are rounding and have none of their own."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.linear.scaling import parts
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem

RESOLVED = 1e-3
"""A state that stays below this share of those comparable to it may consist of their rounding alone."""


def unit_ratios(plant: SwitchedSystem) -> Array:
    """Size (n, n) that state i has where state j is 1, from how strongly they act on each other; 0 for those that do not.

    They act through the plant, and through an inverse, which makes the input from the outputs: the position of a base that can
    stand anywhere acts on nothing else in the plant, but an inverse finds it from where the tip is to be.
    """
    A, B, C = (np.max([np.abs(getattr(system, name)) for system in plant.distinct], axis=0) for name in "ABC")
    (n, m), p = B.shape, len(C)
    loop = np.block([[A, B, np.zeros((n, p))], [np.zeros((m, n + m)), np.ones((m, p))], [C, np.zeros((p, m + p))]])
    part, units = parts(loop)[:n], np.exp2(np.mean([np.log2(plant_units(system)) for system in plant.distinct], axis=0))
    return np.asarray(np.where(part[:, None] == part, units[:, None] / units, 0.0))


def comparable_size(size: Array, ratios: Array) -> Array:
    """Sizes (..., n) of states, each at least the share RESOLVED of what comparable ones (`unit_ratios`) make of it."""
    return np.asarray(np.maximum(size, RESOLVED * np.max(ratios * size[..., None, :], axis=-1, initial=0.0)))


def idle_states(plant: SwitchedSystem) -> NDArray[np.bool_]:
    """Which states no input and no jump of the rest moves, not even through other states (n,): from rest on they stay there."""
    A, B = (np.max([np.abs(getattr(system, name)) for system in plant.distinct], axis=0) > 0 for name in "AB")
    moved = np.any(B, axis=1) | np.any(plant.shifts, axis=0)
    for _ in range(plant.n_states):
        moved = moved | np.any(A[:, moved], axis=1)
    return np.asarray(~moved, dtype=bool)


def with_idle_sizes(size: Array, rate: Array, plant: SwitchedSystem) -> Array:
    """Sizes (n,) of states, those of idle ones by what shows in the states and outputs that they act on (the share RESOLVED of it).

    What an idle state holds is rounding, and has no size of its own. One that acts on nothing is as large as one likes. size (n,):
    of the states; rate (n,): of the terms that make up their derivatives.
    """
    idle = idle_states(plant)
    if not np.any(idle):
        return size
    A, C = (np.max([np.abs(getattr(system, name)) for system in plant.distinct], axis=0) for name in "AC")
    effects = np.vstack([A - np.diag(np.diag(A)), C])
    settled = np.concatenate([~idle, np.ones(len(C), dtype=bool)])
    size, ratios = np.where(idle, 0.0, size), unit_ratios(plant)
    while True:
        terms = np.concatenate([np.where(idle, A @ size, rate), C @ size])[:, None]
        acts = (effects > 0) & settled[:, None] & (terms > 0)  # what only idle states show tells nothing of their size
        reach = np.min(np.where(acts, terms / np.where(acts, effects, 1.0), np.inf), axis=0)
        found = idle & ~settled[: len(A)] & np.isfinite(reach)
        if not np.any(found):
            return np.where(settled[: len(A)], size, np.inf)
        size = np.where(found, RESOLVED * reach, size)
        alike = np.max(ratios * size, axis=1)  # those that act on each other both ways are of comparable size
        size = np.where(idle & (size == 0), alike, size)
        settled[: len(A)] |= idle & (size > 0)
