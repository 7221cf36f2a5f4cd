"""Gains designed on a reduced model, for the states of the full one."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.control.gains import GainSchedule
from invtrack.errors import ControlError
from invtrack.linear.reduction import Reduction


def lifted_gains(gains: GainSchedule | ArrayLike, reduction: Reduction) -> GainSchedule:
    """u = -K z on the reduced model as u = -(K W) x on the full one: the feedback sees the states that were kept, z = W x, alone.

    By modal truncation what was cut does not act on z: the closed loop has the poles of the reduced one and, untouched, those that
    were cut. After balanced truncation it does a little; check numpy.linalg.eigvals(A - B K W).

    gains: K (m, k), or one for each interval, such as lqr(reduction.reduced, ...). reduction: as `modal_truncation` and
    `balanced_truncation` make it. Raises ControlError for gains of another shape and what is no reduction.
    """
    expected = "a Reduction, such as invtrack.linear.modal_truncation(model, band=30.0)"
    instance("reduction", reduction, Reduction, expected=expected, error=ControlError)
    given = gains if isinstance(gains, GainSchedule) else GainSchedule([gains])
    shape = (reduction.reduced.n_inputs, reduction.reduced.n_states)
    if given.gains[0].shape != shape:
        raise ControlError(f"gains have shape {given.gains[0].shape}, expected {shape} for the reduced model")
    times = np.union1d(given.switch_times, reduction.full.switch_times)
    before, after = (model.interval(times) for model in (given, reduction.full))
    gains_of, rows_of = np.append(0, before), np.append(0, after)
    return GainSchedule([given.gains[i] @ reduction.W[j] for i, j in zip(gains_of.tolist(), rows_of.tolist(), strict=True)], times)
