"""The input of an inverse, from the states and outputs that it is to make."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array, as_divisor
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

WEAK = 1e-8
"""A combination of inputs that moves less than this share of what others do is left as it is where there is a choice."""


def tracking_values(plant: StateSpace, x_rows: Array, rate_rows: Array, y_rows: Array, u_rows: Array | None = None) -> Array:
    """Rows of [x; u; y] from those of x, x' and of the wanted y: [B; D] u = [x' - A x; y - C x].

    The law u = B_y^-1 (chi - A_x x) gives the same in exact arithmetic; with gains B_y far below what A and B can do, as at the end
    of a long chain, it is the difference of huge terms. Equations are weighed by the size of their terms, in units of the states.

    Args:
        plant: with m inputs.
        x_rows, rate_rows, y_rows: (n, k), (n, k) and (p, k).
        u_rows: the input (m, k) to rounding, of more inputs than outputs, where the equations leave a choice.
    """
    units = plant_units(plant)
    A_size = float(np.linalg.norm(plant.A * units / units[:, None]))
    output_size = np.linalg.norm(plant.C * units, axis=1)
    weights = np.concatenate([1 / units / (A_size if A_size > 0 else 1.0), 1 / as_divisor(output_size)])[:, None]
    gains = np.vstack([plant.B, plant.D])
    size = as_divisor(np.linalg.norm(gains * weights, axis=0))
    wanted = np.vstack([rate_rows - plant.A @ x_rows, y_rows - plant.C @ x_rows])
    if u_rows is None:
        u_rows = (np.linalg.pinv(gains * weights / size) @ (wanted * weights)) / size[:, None]
    else:
        missing = (wanted - gains @ u_rows) * weights
        u_rows = u_rows + (np.linalg.pinv(gains * weights / size, rcond=WEAK) @ missing) / size[:, None]
    return np.vstack([x_rows, u_rows, plant.C @ x_rows + plant.D @ u_rows])
