"""The slowest flexible mode of a plant: the clock by which residual vibration is judged."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from invtrack.errors import PlantError
from invtrack.physics.linearize import linearize
from invtrack.physics.plant import Plant

OSCILLATION_TOLERANCE = 1e-6
"""An eigenvalue counts as an oscillation where its imaginary part exceeds this share of the fastest eigenvalue: a rigid-body mode's
double eigenvalue at zero is split by rounding to about sqrt(eps) of it."""


def slowest_flexible_period(plant: Plant, parameters: Mapping[str, float]) -> float:
    """Period 2 pi / |Im s| [s] of the slowest oscillatory eigenvalue s of the free plant; NaN where nothing oscillates.

    NaN also where the plant cannot be linearized with these parameter values, for instance because a contact is active.
    """
    try:
        eigenvalues = np.linalg.eigvals(linearize(plant, allow_nonequilibrium=True, **parameters).A)
    except PlantError:
        return float("nan")
    frequencies = np.abs(eigenvalues.imag)
    flexible = frequencies[frequencies > OSCILLATION_TOLERANCE * np.max(np.abs(eigenvalues), initial=0.0)]
    return float(2 * np.pi / flexible.min()) if flexible.size else float("nan")
