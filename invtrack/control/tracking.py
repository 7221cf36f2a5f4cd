"""Feedforward with state feedback around a planned trajectory."""

from __future__ import annotations

from typing import Literal

from numpy.typing import ArrayLike

from invtrack.control.affine import AffineLaw
from invtrack.control.gains import GainSchedule
from invtrack.control.plan_follower import PlanFollower
from invtrack.control.protocol import Instants
from invtrack.signals.nominal import NominalTrajectory


class TrackingController(PlanFollower):
    """u = u_ff(t) - K_k (x - x_ref(t)), u_ff averaged over the time for which the input is held.

    nominal, gains, period: see PlanFollower. A held input costs an error of order h if it is the wanted one at the start of the
    hold h, h^2 if it is the mean over it.

    Raises ControlError as PlanFollower does.
    """

    def __init__(
        self, nominal: NominalTrajectory, gains: GainSchedule | ArrayLike | None = None, *, period: float | None = None
    ) -> None:
        super().__init__(nominal, gains, period)

    @property
    def measures(self) -> Literal["state", "sensors"]:
        """The state."""
        return "state"

    @property
    def stateless(self) -> bool:
        """True: the law depends on time and state alone."""
        return True

    def begin(self, instants: Instants) -> AffineLaw:
        """The law for one run: plan and gains looked up for all its instants at once."""
        x_ref = self.nominal.states(instants.time, inside=instants.inside)
        return AffineLaw.around(self.mean_feedforward(instants), x_ref, self.gains, instants.inside)
