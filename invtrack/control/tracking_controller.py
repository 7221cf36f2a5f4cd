"""Feedforward and state feedback around a planned trajectory, and what all controllers around a plan have in common."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, require_duration
from invtrack.control.gains import GainSchedule
from invtrack.control.protocol import AffineLaw, DifferenceLaw, Instants, Law
from invtrack.errors import ControlError
from invtrack.plans.plan import Plan, require_plan

FEW_GAINS = 16
"""So many gains are taken into the plan's own rows, where input and state are wanted at the same instants."""


class PlanFollower(ABC):
    """A plan, feedback gains and a period, checked to fit each other.

    Args:
        plan: where u_ff and x_ref come from.
        gains: a GainSchedule, whose switch times may differ from the plan's, such as `lqr(plan, ...)`; a constant gain K (p, n); or
            None for feedforward alone.
        period: time between two updates [s], the input held in between; None: one in every physics step.

    Raises ControlError where the gain's shape does not fit the plan or the period is not positive.
    """

    def __init__(self, plan: Plan, gains: GainSchedule | ArrayLike | None, period: float | None) -> None:
        require_plan(plan, error=ControlError)
        shape = (plan.model.n_inputs, plan.model.n_states)
        if gains is None:
            gains = np.zeros(shape)
        if not isinstance(gains, GainSchedule):
            gains = GainSchedule([gains])
        if gains.gains[0].shape != shape:
            raise ControlError(f"gains have shape {gains.gains[0].shape}, expected {shape} for this plan's inputs and states")
        if period is not None:
            require_duration("the controller's period", period, error=ControlError)
        self._plan, self._gains, self._period = plan, gains, period

    @property
    def plan(self) -> Plan:
        """The planned trajectory."""
        return self._plan

    @property
    def gains(self) -> GainSchedule:
        """The feedback gains."""
        return self._gains

    @property
    def breakpoints(self) -> Array:
        """Breakpoints of the plan and of the gains [s]."""
        return np.union1d(self._plan.breakpoints, self._gains.breakpoints)

    @property
    def period(self) -> float | None:
        """Time [s] between two updates; None: one in every physics step."""
        return self._period

    @property
    @abstractmethod
    def measures(self) -> Literal["state", "sensors"]:
        """What an update is given."""

    @property
    @abstractmethod
    def stateless(self) -> bool:
        """Whether the input depends on time and measurement alone."""

    @abstractmethod
    def begin(self, instants: Instants) -> Law:
        """The law for one run, everything that can be computed ahead done here."""

    def mean_feedforward(self, instants: Instants) -> Array:
        """The plan's input averaged over each hold, (m, p)."""
        return instants.mean_over_hold(lambda times, inside: instants.part_inputs_of(self._plan))


class TrackingController(PlanFollower):
    """u = u_ff(t) - K_k (x - x_ref(t)), u_ff averaged over the time for which the input is held.

    plan, gains, period: see PlanFollower. A held input costs an error of order h if it is the wanted one at the start of the
    hold h, h^2 if it is the mean over it.

    Raises ControlError as PlanFollower does.
    """

    def __init__(self, plan: Plan, gains: GainSchedule | ArrayLike | None = None, *, period: float | None = None) -> None:
        super().__init__(plan, gains, period)

    @property
    def measures(self) -> Literal["state", "sensors"]:
        """The state."""
        return "state"

    @property
    def stateless(self) -> bool:
        """True: the law depends on time and state alone."""
        return True

    def begin(self, instants: Instants) -> AffineLaw | DifferenceLaw:
        """The law for one run: plan and gains looked up for all its instants at once."""
        if self.plan.difference is None and not np.any(instants.hold) and len(self.gains.gains) <= FEW_GAINS:
            which = self.gains.interval(instants.inside)
            offset = np.empty((len(which), self.plan.model.n_inputs))
            for k, K in enumerate(self.gains.gains):
                chosen = which == k
                offset[chosen] = self.plan.inputs_with(K, instants.time[chosen], inside=instants.inside[chosen])
            return AffineLaw(offset, self.gains.gains, which)
        x_ref = instants.states_of(self.plan)
        feedforward = self.mean_feedforward(instants)
        if self.plan.difference is None:
            return AffineLaw.around(feedforward, x_ref, self.gains, instants.inside)
        return DifferenceLaw(feedforward, x_ref, self.gains, instants.inside, self.plan.difference)
