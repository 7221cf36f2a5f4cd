"""Feedforward with feedback of an estimated state: what a controller with a few sensors does."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.control.gains import GainSchedule
from invtrack.control.observer import Observer, measured
from invtrack.control.plan_follower import PlanFollower
from invtrack.control.protocol import Instants
from invtrack.errors import ControlError
from invtrack.lti.state_space import StateSpace
from invtrack.signals.nominal import NominalTrajectory

Array = NDArray[np.float64]


class OutputFeedbackController(PlanFollower):
    """u = u_ff - K_k e_hat, e_hat the estimated deviation e = x - x_ref from the plan.

    At each update, with the plan's measurement y_ref = y0 + C_m x_ref:

        e_hat = e_prior + M (y_m - y_ref - C_m e_prior),    u = u_ff - K e_hat,    e_prior <- A_d e_hat - B_d K e_hat.

    Deviations are estimated and not states, so on the plan nothing is to be corrected and sampling costs no error there. Through a
    parameter jump e_hat continues: plan and plant are continuous in the state.

    nominal, gains, period: as for TrackingController. observer: designs M for each interval of the plan's model. measurement_delay
    [s]: how late the sensors are known to be; y_ref is then taken as much earlier. The plan's model says what is measured
    (`StateSpace.measurement`).

    Raises ControlError where gains or period do not fit, or a measurement depends on the input at once.
    """

    def __init__(
        self,
        nominal: NominalTrajectory,
        gains: GainSchedule | ArrayLike,
        observer: Observer,
        *,
        period: float | None = None,
        measurement_delay: float = 0.0,
    ) -> None:
        super().__init__(nominal, gains, period)
        if not measurement_delay >= 0:
            raise ControlError(f"measurement_delay must not be negative, got {measurement_delay} s")
        for system in nominal.model.systems:
            measured(system)
        self._observer, self._delay = observer, measurement_delay

    @property
    def measures(self) -> Literal["state", "sensors"]:
        """The sensors."""
        return "sensors"

    @property
    def stateless(self) -> bool:
        """False: the estimate is a state."""
        return False

    def begin(self, instants: Instants) -> OutputFeedbackLaw:
        """The law for one run: plan looked up, observer gains designed for each interval and hold that occurs."""
        model = self.nominal.model
        x_ref = self.nominal.states(instants.time, inside=instants.inside)
        seen = self.nominal.states(instants.time - self._delay, inside=instants.inside if self._delay <= 0 else None)
        interval = model.interval(instants.inside)
        expected = np.stack([system.measurement.y0 for system in model.systems])[interval]
        for k, system in enumerate(model.systems):
            expected[interval == k] += seen[interval == k] @ system.measurement.C.T
        gain_of = self.gains.interval(instants.inside)
        # Holds are equal but for rounding within an interval: one design serves all that agree to 9 digits.
        keys = list(zip(interval.tolist(), gain_of.tolist(), [float(f"{hold:.9g}") for hold in instants.hold], strict=True))
        designs = {key: self._design(model.systems[key[0]], self.gains.gains[key[1]], key[2]) for key in dict.fromkeys(keys)}
        return OutputFeedbackLaw(self.mean_feedforward(instants), x_ref, expected, [designs[key] for key in keys])

    def _design(self, system: StateSpace, gain: Array, hold: float) -> _Design:
        n, p = system.n_states, system.n_channels
        augmented = np.block([[system.A, system.B], [np.zeros((p, n + p))]]) * hold
        transition = scipy.linalg.expm(augmented)[:n]
        return _Design(gain, self._observer.gain(system, hold), system.measurement.C, transition[:, :n] - transition[:, n:] @ gain)


@dataclass(frozen=True, eq=False)
class _Design:
    """K (p, n), M (n, m), C_m (m, n) and the closed loop's transition A_d - B_d K (n, n) over one hold."""

    K: Array
    M: Array
    C_m: Array
    closed_loop: Array


class OutputFeedbackLaw:
    """The estimator and the law, prepared for one run; it starts on the plan."""

    def __init__(self, feedforward: Array, x_ref: Array, expected: Array, designs: list[_Design]) -> None:
        self._feedforward, self._x_ref, self._expected, self._designs = feedforward, x_ref, expected, designs
        self._prior = np.zeros(x_ref.shape[1])
        self._estimate = x_ref[0]

    @property
    def estimate(self) -> Array:
        """The estimated state (n,) of the latest update."""
        estimate: Array = self._estimate
        return estimate

    def update(self, index: int, measurement: NDArray[np.float64]) -> Array:
        """Input (p,) at instant number `index`."""
        design = self._designs[index]
        innovation = measurement - self._expected[index] - design.C_m.dot(self._prior)
        deviation = self._prior + design.M.dot(innovation)
        self._prior = design.closed_loop.dot(deviation)
        self._estimate = self._x_ref[index] + deviation
        result: Array = self._feedforward[index] - design.K.dot(deviation)
        return result
