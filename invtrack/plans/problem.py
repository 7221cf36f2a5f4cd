"""A reference as deviation from a plant's operating point, cut where it has to be so that it can be followed backward in time."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import TrajectoryError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

LARGEST_DECAY = 3.0
"""Time constants that a mode of the reference may decay over within one piece: backward, its rounding errors grow by e^3."""


def require_reference(plant: SwitchedSystem | StateSpace, reference: object) -> None:
    """Raises TrajectoryError unless `reference` is a signal with one channel per output of `plant`."""
    if not isinstance(reference, PiecewiseSignal):
        raise TrajectoryError(
            "expected a reference such as invtrack.rest_to_rest(0.0, 1.0, duration=2.0) or invtrack.sampled_reference(times, "
            f"values), got {type(reference).__name__}"
        )
    if reference.n_channels != plant.n_channels:
        raise TrajectoryError(
            f"the reference has {reference.n_channels} channels, the plant {plant.n_channels} outputs "
            f"{list(plant.outputs.names)}; stack one signal per output with invtrack.stack"
        )


def decay_stops(reference: PiecewiseSignal) -> Array:
    """Further breakpoints [s], none for references without decaying modes.

    The antistable internal dynamics are integrated backward over each piece together with the reference's generator w' = S w, whose
    stable modes grow in that direction: from a w that has all but decayed nothing of them could be recovered.
    """
    rates = np.array([max(0.0, -float(np.min(np.linalg.eigvals(g.S).real, initial=0.0))) for g in reference.generators])
    edges = reference.breakpoints
    decay = rates[reference.kind[1:-1]] * np.diff(edges)
    long = np.flatnonzero(decay > LARGEST_DECAY)
    stops = [np.linspace(edges[j], edges[j + 1], int(np.ceil(decay[j] / LARGEST_DECAY)) + 1)[1:-1] for j in long]
    return np.concatenate([np.zeros(0), *stops])


def deviation_reference(plant: SwitchedSystem, reference: PiecewiseSignal) -> PiecewiseSignal:
    """The reference as deviation from the operating point, with breakpoints at the jumps and wherever decaying modes need them."""
    y_0 = plant.operating_point.y0
    deviation = reference + constant(-y_0, at=reference.manoeuvre[0]) if np.any(y_0) else reference
    return deviation.refined([*plant.switch_times, *decay_stops(deviation)])
