"""The ways to move a nonlinear mechanism that are compared: its linear inverse, the inverse of its motion, feedback alone."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

import invtrack
from invtrack.control import amplification
from invtrack.errors import LearningError
from invtrack.inversion import steady_state_feedforward
from invtrack.studies import Case, Column

LEARNING_RUNS = 15
"""At most."""

LONG_BEFORE = -1e6
"""When the mechanism got the parameters that it really has [s]."""

COLUMNS = (
    Column("max error", "of motion", key="error_share"),
    Column("residual vibration", "of motion", key="vibration_share"),
    Column("peak input"),
    Column("preactuation time", "s"),
    Column("planned in", "iterations", key="iterations"),
    Column("departures grow", "times", key="amplification"),
)


@dataclass(frozen=True)
class Motion:
    """A motion of a mechanism, and the feedback weights that all ways share.

    Args:
        name: begins the names of its cases, where there are several motions.
        plant: at rest where the motion begins.
        reference: of its outputs.
        Q, R: weights of states and inputs.
        schedule: changes of parameters on the way.
        linear: the linear model, with the same changes.
        band: highest frequency [rad/s] that an inverse learns from run to run; None: learning is not among the ways.
        contracts: whether it learns; False where this is what the motion shows.
        actual: parameters that the mechanism really has all along, of which no plan knows. With them only the inverse of the motion
            is driven, and learns; without them the linear inverse learns.
        settling: how long each learning run goes on after the motion [s], until feedback has nothing left to correct.
        period: of the vibration that is looked for after the motion [s]; None: that of the slowest flexible mode.
    """

    name: str
    plant: invtrack.Plant
    reference: invtrack.PiecewiseSignal
    Q: Any
    R: Any
    schedule: Sequence[invtrack.Change] = ()
    linear: Callable[[invtrack.Plant], Any] = invtrack.linearize
    band: float | None = None
    contracts: bool = True
    actual: Mapping[str, float] = field(default_factory=dict)
    settling: float = 25.0
    period: float | None = None

    @cached_property
    def size(self) -> float:
        """The largest way of an output."""
        times = np.linspace(*self.reference.breakpoints[[0, -1]], 500)
        return float(np.max(np.ptp(self.reference(times), axis=0)))

    @cached_property
    def model(self) -> Any:
        """The linear model."""
        return self.linear(self.plant)

    @cached_property
    def gains(self) -> invtrack.GainSchedule:
        """Of the linear model."""
        return invtrack.lqr(self.model, Q=self.Q, R=self.R)

    def inverse(self, hold: float | None = None) -> invtrack.TrackingController:
        """The inverse of the motion, with the gains along it; for a zero-order hold of so many seconds if wanted."""
        plan = invtrack.invert(self.plant, self.reference, schedule=self.schedule, hold=hold)
        return invtrack.TrackingController(plan, invtrack.lqr(plan, Q=self.Q, R=self.R))

    def linear_inverse(self) -> invtrack.TrackingController:
        """The inverse of the linear model, with its gains."""
        return invtrack.TrackingController(invtrack.invert(self.model, self.reference), self.gains)

    def feedback_only(self) -> invtrack.TrackingController:
        """The postures at rest with each wanted output, the inputs that hold them, and gains that follow these postures."""
        plan = steady_state_feedforward(self.plant, self.reference, schedule=self.schedule)
        return invtrack.TrackingController(plan, invtrack.lqr(plan, Q=self.Q, R=self.R))

    @property
    def happening(self) -> list[invtrack.Change]:
        """Changes of the mechanism's parameters, those that no plan knows of among them."""
        known = [invtrack.Change(change.time, **{**change.parameters, **self.actual}) for change in self.schedule]
        return [invtrack.Change(LONG_BEFORE, **self.actual), *known] if self.actual else known

    def learned(self, timestep: float) -> invtrack.TrackingController:
        """An inverse after some runs in the simulator, corrected by the errors of the runs before."""
        gains = self.inverse(timestep).gains if self.actual else self.gains

        def drive(plan: invtrack.Plan) -> invtrack.RunResult:
            controller = invtrack.TrackingController(plan, gains)
            end = plan.manoeuvre[1] + self.settling
            return invtrack.simulate(self.plant, controller, schedule=self.happening, timestep=timestep, end=end)

        def planner(reference: invtrack.PiecewiseSignal) -> invtrack.Plan:
            if self.actual:
                return invtrack.invert(self.plant, reference, schedule=self.schedule, hold=timestep)
            return invtrack.invert(self.model, reference)

        found = invtrack.iterate(
            drive, planner, self.reference, band=self.band, runs=LEARNING_RUNS, rehearsal=None if self.contracts else drive
        )
        return invtrack.TrackingController(found.plan, gains)

    def cases(self, timestep: float) -> list[Case]:
        """One for each way; the held inverse is that for the simulation's own steps [s]."""
        ways: dict[str, Callable[[], invtrack.TrackingController]] = {"inverse_for_the_hold": lambda: self.inverse(timestep)}
        if not self.actual:
            ways |= {"inverse": self.inverse, "linear_inverse": self.linear_inverse, "feedback_only": self.feedback_only}
        learning = "inverse_learned" if self.actual else "linear_inverse_learned"
        if self.band is not None:
            ways[learning] = lambda: self.learned(timestep)
        settings = {"schedule": self.happening, "vibration_period": self.period}
        cases = []
        for way, make in ways.items():
            controllers: list[invtrack.TrackingController] = []

            def planned(
                make: Callable[[], invtrack.TrackingController] = make, kept: list[invtrack.TrackingController] = controllers
            ) -> invtrack.TrackingController:
                kept.append(make())
                return kept[-1]

            def numbers(run: invtrack.RunResult, kept: list[invtrack.TrackingController] = controllers) -> dict[str, Any]:
                return self.numbers(run, kept[-1])

            refused = LearningError if way == learning and not self.contracts else None
            name = f"{self.name}_{way}" if self.name else way
            cases.append(Case(name, self.plant, planned, settings=settings, numbers=numbers, refused_by=refused))
        return cases

    def numbers(self, run: invtrack.RunResult, controller: invtrack.TrackingController) -> dict[str, Any]:
        """Metrics of a run, errors also as shares of the motion, and what its plan says of itself."""
        numbers = dict(invtrack.metrics(run))
        vibration = numbers["residual_vibration"]
        plan = controller.plan
        iterations = len(plan.iterations) if isinstance(plan, invtrack.inversion.MotionPlan) else None
        return {
            **numbers,
            "error_share": numbers["max_error"] / self.size,
            "vibration_share": None if vibration is None else vibration / self.size,
            "iterations": iterations,
            "amplification": None if iterations is None else amplification(plan, controller.gains),
            "amplification_of_frozen_gains": None if iterations is None else amplification(plan, self.gains),
        }
