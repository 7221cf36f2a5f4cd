"""What states of a plant may be compared with each other, and at which sizes."""

from __future__ import annotations

import numpy as np
import scipy.sparse.csgraph
from numpy.typing import NDArray

from invtrack.lti.balancing import balancing_scale
from invtrack.lti.switched import SwitchedSystem

Array = NDArray[np.float64]

RESOLVED = 1e-3
"""A state that stays below this share of those comparable to it may consist of their rounding alone."""


def unit_ratios(plant: SwitchedSystem) -> Array:
    """Size (n, n) that state i has where state j is 1, from how strongly they act on each other; 0 for those that do not.

    They act through the plant, and through an inverse, which makes the input from the outputs: a base that can stand anywhere
    acts on nothing else in the plant, but where the tip is to stand says where it has to.
    """
    systems = list({id(system): system for system in plant.systems}.values())
    A, B, C = (np.max([np.abs(getattr(system, name)) for system in systems], axis=0) for name in "ABC")
    n, p = B.shape
    loop = np.block([[A, B, np.zeros((n, p))], [np.zeros((p, n + p)), np.ones((p, p))], [C, np.zeros((p, 2 * p))]])
    _, part = scipy.sparse.csgraph.connected_components(loop, directed=True, connection="strong")
    scale, part = balancing_scale(loop, within_parts=True)[:n], part[:n]
    return np.asarray(np.where(part[:, None] == part, scale[:, None] / scale, 0.0))


def comparable_size(size: Array, ratios: Array) -> Array:
    """Sizes (..., n) of states, none below the share RESOLVED of what those comparable to it (`unit_ratios`) would make of it."""
    return np.asarray(np.maximum(size, RESOLVED * np.max(ratios * size[..., None, :], axis=-1, initial=0.0)))
