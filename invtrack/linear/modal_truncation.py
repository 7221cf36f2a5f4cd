"""Reduction to the slowest modes of a plant."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from invtrack.arguments import flag
from invtrack.arrays import ComplexArray
from invtrack.errors import ModelError
from invtrack.linear.invariant_parts import invariant_parts
from invtrack.linear.reduction import Projection, Reduction, checked, chosen, damped, require_square
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import as_switched

ONE_FREQUENCY = 1e-6
"""Modes whose natural frequencies differ by less than this share are kept, or cut, together."""


def modal_truncation(
    model: Any, *, band: float, accuracy: float = 0.01, modes: int | None = None, residual_stiffness: bool = False
) -> Reduction:
    """The plant with its slowest modes alone, exactly as they are; what is cut does not act on them.

    Kept are the modes at rest (rigid-body modes), those that grow, and of all others, by natural frequency, as many as it takes
    for the inverse of the reduced model to lose no more than `accuracy` of the full model's output at any frequency of the band:
    |(G - G_r) G_r^-1| on a grid that is close around the poles of both. Which numbers were tried, and what they lose, is
    `considered`.

    residual_stiffness adds what the modes that are cut make of a constant input, -C_c A_c^-1 B_c, as a feedthrough: much less is
    lost, and the relative degree is another, 0: the input then follows the reference without a derivative of it, and the zeros are
    others, as many as there are states.

    Args:
        model: StateSpace, or anything with A, B, C, D, with as many inputs as outputs.
        band: up to which frequency the reduced model is to be right [rad/s]: what the reference holds. A slew of the duration T
            by `rest_to_rest` of smoothness 2 holds 0.1 % of its velocity's energy beyond about 15 / T.
        accuracy: share of the output that may be lost, between 0 and 1.
        modes: how many to keep, an oscillation being one, in place of what the accuracy asks for.
        residual_stiffness: see above.

    Raises ModelError for a model that switches (one projection for all of its intervals is `balanced_truncation`'s), unequal
    numbers of inputs and outputs, options out of range, and where every mode is needed.
    """
    plant = as_switched(model)
    limits = checked(band, accuracy, modes)
    add_stiffness = flag("residual_stiffness", residual_stiffness, error=ModelError)
    method = "modal truncation with residual stiffness" if add_stiffness else "modal truncation"
    require_square(plant, method)
    if len(plant.distinct) > 1:
        raise ModelError(
            "modal truncation keeps the modes of one model, and a switched plant has others in each interval, so its state could "
            "not be continuous; use invtrack.linear.balanced_truncation, which has one projection for all intervals"
        )
    candidates = _candidates(plant.systems[0], add_stiffness)
    return chosen(method, plant, candidates, band=limits[0], accuracy=limits[1], modes=limits[2])


def _candidates(system: StateSpace, residual_stiffness: bool) -> Iterator[Projection]:
    """Projections on more and more modes."""
    units = plant_units(system)
    A, B = system.A * units / units[:, None], system.B / units[:, None]
    is_damped = damped(system)
    values = np.linalg.eigvals(A).astype(complex)
    ladder = np.sort(np.abs(values[is_damped(values)]))
    # Between two neighbours the cut goes through their geometric mean.
    steps = np.flatnonzero(ladder[1:] > (1 + ONE_FREQUENCY) * ladder[:-1])
    cuts = [ladder[0] / 2, *np.sqrt(ladder[steps] * ladder[steps + 1])] if ladder.size else []
    for cut in cuts:

        def kept(s: complex, cut: float = cut) -> bool:
            return abs(s) < cut or not bool(is_damped(np.array([s]))[0])

        parts = invariant_parts(A, kept)
        N = np.zeros((len(A), system.n_inputs))
        if residual_stiffness:
            N = parts.W_2 @ np.linalg.solve(-parts.A_2, parts.L_2 @ B)
        count = _oscillations(values[is_damped(values) & (np.abs(values) < cut)])
        if len(parts.A_1):
            yield Projection((parts.L_1 / units,), parts.W_1 * units[:, None], N * units[:, None], count)


def _oscillations(values: ComplexArray) -> int:
    """Number of modes, of which a complex pair is one."""
    return int(np.sum(values.imag >= 0))
