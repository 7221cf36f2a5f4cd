"""References that lead from rest to rest: what they hold before and after."""

from __future__ import annotations

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import TrajectoryError
from invtrack.references.signal import PiecewiseSignal

HELD = 1e-12
"""A reference holds still where its state changes by less than this share of the terms that make up the change."""


def held_outputs(reference: PiecewiseSignal, what: str) -> tuple[Array, Array]:
    """Outputs (p,) held before and after. Raises TrajectoryError, about `what` asks for them, where none are."""
    for end, side in ((0, "before"), (-1, "after")):
        S, w = reference.generators[reference.kind[end]].S, reference.anchors[end]
        w = w[: len(S)]
        if np.any(np.abs(S @ w) > HELD * np.abs(S) @ np.abs(w)):
            raise TrajectoryError(
                f"the reference goes on moving {side} its breakpoints; {what} leads from rest to rest, as invtrack.rest_to_rest "
                "and invtrack.sampled_reference do"
            )
    edges = reference.breakpoints
    return reference(edges[:1] - 1.0)[0], reference(edges[-1:] + 1.0)[0]
