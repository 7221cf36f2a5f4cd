"""Feedforward with state feedback around a planned trajectory."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.control.affine import AffineLaw
from invtrack.control.gains import GainSchedule
from invtrack.control.protocol import Instants
from invtrack.errors import ControlError
from invtrack.signals.nominal import NominalTrajectory

Array = NDArray[np.float64]


class TrackingController:
    """u = u_ff(t) - K_k (x - x_ref(t)), u_ff averaged over the time for which the input is held.

    nominal: where u_ff and x_ref come from. gains: a GainSchedule, whose switch times may differ from the plan's; a constant gain
    K (p, n); or None for feedforward alone. period [s]: time between two updates, the input held in between; None: every physics
    step. A held input costs an error of order h if it is the wanted one at the start of the hold h, h^2 if it is the mean over it.

    Raises ControlError where the gain's shape does not fit the plan or the period is not positive.
    """

    stateless = True

    def __init__(
        self, nominal: NominalTrajectory, gains: GainSchedule | ArrayLike | None = None, *, period: float | None = None
    ) -> None:
        self._nominal = nominal
        self._gains = as_gain_schedule(gains, nominal)
        self._period = checked_period(period)

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
    def period(self) -> float | None:
        """Time [s] between two updates; None: one in every physics step."""
        return self._period

    @property
    def measures(self) -> Literal["state", "sensors"]:
        """The state."""
        return "state"

    def begin(self, instants: Instants) -> AffineLaw:
        """The law for one run: plan and gains looked up for all its instants at once."""
        x_ref = self._nominal.states(instants.time, inside=instants.inside)
        interval = self._gains.interval(instants.inside)
        offset = mean_feedforward(self._nominal, instants)
        for k, gain in enumerate(self._gains.gains):
            chosen = interval == k
            offset[chosen] += x_ref[chosen] @ gain.T
        return AffineLaw(offset, self._gains.gains, interval)


def mean_feedforward(nominal: NominalTrajectory, instants: Instants) -> Array:
    """The plan's input averaged over each hold, (m, p)."""
    return instants.mean_over_hold(lambda times, inside: nominal.inputs(times, inside=inside))


def as_gain_schedule(gains: GainSchedule | ArrayLike | None, nominal: NominalTrajectory) -> GainSchedule:
    """Gains of the shape that a plan needs. Raises ControlError for others."""
    first = nominal.model.systems[0]
    shape = (first.n_channels, first.n_states)
    if gains is None:
        gains = np.zeros(shape)
    if not isinstance(gains, GainSchedule):
        gains = GainSchedule((np.asarray(gains, dtype=float),), np.zeros(0))
    if gains.gains[0].shape != shape:
        raise ControlError(f"gains have shape {gains.gains[0].shape}, expected {shape} for this plan's inputs and states")
    return gains


def checked_period(period: float | None) -> float | None:
    """A controller's period [s]. Raises ControlError unless it is positive (or None)."""
    if period is not None and not (np.isfinite(period) and period > 0):
        raise ControlError(f"the controller's period must be a positive number of seconds or None, got {period}")
    return period
