"""Feedforward with feedback of an estimated state: what a controller with a few sensors does."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from invtrack.control.estimating_law import OutputFeedbackLaw, design_holds, drift_of, measured_in
from invtrack.control.gains import GainSchedule
from invtrack.control.observer import Observer, measured
from invtrack.control.plan_follower import PlanFollower
from invtrack.control.protocol import Instants
from invtrack.errors import ControlError
from invtrack.signals.nominal import NominalTrajectory


class OutputFeedbackController(PlanFollower):
    """u = u_ff - K_k e_hat, e_hat the estimated deviation e = x - x_ref from the plan.

    At each update, with the plan's measurement y_ref = y0 + C_m x_ref:

        e_hat = e_prior + M (y_m - y_ref - C_m e_prior),    u = u_ff - K e_hat,    e_prior <- A_d e_hat - B_d K e_hat + d,

    d = A_d x_ref + B_d (u_ff - u0) less the next x_ref: what holding the input over the period costs, most where the plant jumps
    within it. It is known beforehand, so with ideal sensors and from the plan's state e_hat is e, and nothing is lost against a
    measured state. Through a parameter jump e_hat continues: plan and plant are continuous in the state.

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
        if not 0 <= measurement_delay < np.inf:
            raise ControlError(f"measurement_delay must be finite and not negative, got {measurement_delay} s")
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
        designs = design_holds(model, self.gains, self._observer, instants)
        feedforward = self.mean_feedforward(instants)
        drift = drift_of(x_ref, feedforward - model.systems[0].operating_point.u0, designs)
        return OutputFeedbackLaw(feedforward, x_ref, measured_in(model, instants, seen), designs, drift)
