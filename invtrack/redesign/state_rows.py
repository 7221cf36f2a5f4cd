"""Combinations of states by name, such as the twist of a shaft."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import RedesignError
from invtrack.lti.state_space import StateSpace

Array = NDArray[np.float64]

StateRow = Mapping[str, float] | ArrayLike
"""Weights by state names, {"th1": 1.0, "th2": -1.0}, or one number per state."""


def state_row(name: str, row: StateRow, system: StateSpace) -> Array:
    """The row (n,) that the states, as deviations from the operating point, are multiplied with.

    Raises RedesignError for states that there are not, another number of weights than states, and weights that are not finite or
    all zero. `name` is what the message calls the combination.
    """
    states = list(system.state_names)
    if isinstance(row, Mapping):
        unknown = [state for state in row if state not in states]
        if unknown or not row:
            raise RedesignError(
                f"{name!r}: expected weights of some of the states {states}, got {dict(row)}"
                + (f", of which {unknown} are unknown" if unknown else "")
            )
        row = [row.get(state, 0.0) for state in states]
    values = np.asarray(row, dtype=float)
    if values.shape != (len(states),):
        raise RedesignError(
            f"{name!r}: expected {len(states)} weights, one for each of the states {states}, got shape {values.shape}"
        )
    if not np.all(np.isfinite(values)) or not np.any(values):
        raise RedesignError(f"{name!r}: expected finite weights that are not all zero, got {values.tolist()}")
    return values
