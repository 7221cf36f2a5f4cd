"""Feedforward with state feedback around a planned trajectory."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.control.gains import GainSchedule
from invtrack.control.protocol import Instants
from invtrack.errors import ControlError
from invtrack.signals.nominal import NominalTrajectory

Array = NDArray[np.float64]


class TrackingController:
    """u = u_ff(t) - K_k (x - x_ref(t)), the feedforward taken in the middle of the time for which the input is held.

    nominal: where u_ff and x_ref come from. gains: a GainSchedule, whose switch times may differ from the plan's; a constant gain
    K (p, n); or None for feedforward alone. Holding a value for h costs an error of order h when it is the one at the start, h^2
    when it is the one in the middle.

    Raises ControlError where the gain's shape does not fit the plan.
    """

    def __init__(self, nominal: NominalTrajectory, gains: GainSchedule | ArrayLike | None = None) -> None:
        first = nominal.model.systems[0]
        shape = (first.n_channels, first.n_states)
        if gains is None:
            gains = np.zeros(shape)
        if not isinstance(gains, GainSchedule):
            gains = GainSchedule((np.asarray(gains, dtype=float),), np.zeros(0))
        if gains.gains[0].shape != shape:
            raise ControlError(f"gains have shape {gains.gains[0].shape}, expected {shape} for this plan's inputs and states")
        self._nominal = nominal
        self._gains = gains

    @property
    def nominal(self) -> NominalTrajectory:
        """The planned trajectory."""
        return self._nominal

    @property
    def gains(self) -> GainSchedule:
        """The feedback gains."""
        return self._gains

    @property
    def breakpoints(self) -> Array:
        """Breakpoints of the plan and switch times of the gains [s]."""
        return np.union1d(self._nominal.breakpoints, self._gains.switch_times)

    @property
    def stateless(self) -> bool:
        """True: the law depends on time and state alone."""
        return True

    def begin(self, instants: Instants) -> TrackingLaw:
        """The law for one run: plan and gains looked up for all its instants at once."""
        feedforward = self._nominal(instants.time + instants.hold / 2, inside=instants.inside).u
        x_ref = self._nominal(instants.time, inside=instants.inside).x
        interval = self._gains.interval(instants.inside)
        offset = feedforward.copy()
        for k, gain in enumerate(self._gains.gains):
            chosen = interval == k
            offset[chosen] += x_ref[chosen] @ gain.T
        return TrackingLaw(offset, [self._gains.gains[k] for k in interval])


class TrackingLaw:
    """u = offset_i - K_i x with everything that does not depend on the measurement worked out before the run."""

    def __init__(self, offset: Array, gains: list[Array]) -> None:
        self._offset = offset
        self._gains = gains

    def update(self, index: int, measurement: NDArray[np.float64]) -> Array:
        """Input (p,) at instant number `index`."""
        result: Array = self._offset[index] - self._gains[index].dot(measurement)
        return result
