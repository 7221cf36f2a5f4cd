"""Feedback of an estimated state: a current estimator of the deviation from a wanted state, and the law around a plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, Indices, require_not_negative
from invtrack.control.gains import GainSchedule
from invtrack.control.observer import Observer, measured, require_observer
from invtrack.control.protocol import Instants, numbered
from invtrack.control.tracking_controller import PlanFollower
from invtrack.errors import ControlError
from invtrack.linear.propagation import held_through
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan


@dataclass(frozen=True, eq=False)
class EstimatorDesign:
    """What a hold needs.

    Args:
        K: feedback gain (p, n).
        M: correction (n, m) by what was measured at the start of the hold.
        C_m: what is measured of the state (m, n).
        A_d: the plant's step over the hold, x - rest <- A_d (x - rest) + B_d (u - u0) + moved, from the rest at its start: (n, n).
        B_d: (n, p).
        moved: what jumps of the rest within the hold add (n,).
    """

    K: Array
    M: Array
    C_m: Array
    A_d: Array
    B_d: Array
    moved: Array

    @cached_property
    def closed_loop(self) -> Array:
        """A_d - B_d K (n, n)."""
        result: Array = self.A_d - self.B_d @ self.K
        return result


class OutputFeedbackLaw:
    """e_hat = e_prior + M (y_m - y_ref - C_m e_prior), u = u_ff - K e_hat, e_prior <- (A_d - B_d K) e_hat + d.

    e = x - x_ref is the deviation from a wanted state. The first prior is zero: the plant is where it should be.

    Args:
        feedforward: u_ff (m, p) at the instants of the run.
        x_ref: wanted states (m, n), as deviations from the operating point before all jumps.
        expected: the measurement y_ref (m, .) in the wanted state.
        drift: d (m, n), by how much the deviation changes over each hold although nothing disturbs the plant.
        designs: the distinct estimators.
        which: (m,), the design of each hold.
    """

    def __init__(
        self,
        feedforward: Array,
        x_ref: Array,
        *,
        expected: Array,
        drift: Array,
        designs: list[EstimatorDesign],
        which: Indices,
    ) -> None:
        self._feedforward, self._x_ref, self._expected, self._drift = feedforward, x_ref, expected, drift
        self._designs, self._which = designs, which.tolist()
        self._prior = np.zeros(x_ref.shape[1])
        self._estimate = x_ref[0]

    @classmethod
    def around(
        cls,
        follower: PlanFollower,
        observer: Observer,
        instants: Instants,
        *,
        feedforward: Array,
        x_ref: Array,
        measured_at: Array,
    ) -> OutputFeedbackLaw:
        """The law for one run, an estimator designed for each distinct hold.

        Args:
            follower: whose plan's model and gains it goes by.
            observer: designs the correction M.
            instants: those of the run.
            feedforward: inputs (m, p), averaged over the holds.
            x_ref: wanted states (m, n).
            measured_at: the wanted states (m, n) that the sensors show at the instants: earlier ones where they are late.
        """
        model = follower.plan.model
        designs, which = _design_holds(model, follower.gains, observer, instants)
        return cls(
            feedforward,
            x_ref,
            expected=_measured_in(model, instants, measured_at),
            drift=_drift(model, instants, x_ref, feedforward, designs, which),
            designs=designs,
            which=which,
        )

    @property
    def estimate(self) -> Array:
        """The estimated state (n,) of the latest update."""
        estimate: Array = self._estimate
        return estimate

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) at instant number `index`."""
        design = self._designs[self._which[index]]
        innovation = measurement - self._expected[index] - design.C_m.dot(self._prior)
        deviation = self._prior + design.M.dot(innovation)
        self._prior = design.closed_loop.dot(deviation) + self._drift[index]
        self._estimate = self._x_ref[index] + deviation
        result: Array = self._feedforward[index] - design.K.dot(deviation)
        return result


class OutputFeedbackController(PlanFollower):
    """u = u_ff - K_k e_hat, e_hat the estimated deviation e = x - x_ref from the plan.

    At each update, with the plan's measurement y_ref = y0 + C_m (x_ref - rest):

        e_hat = e_prior + M (y_m - y_ref - C_m e_prior),    u = u_ff - K e_hat,    e_prior <- A_d e_hat - B_d K e_hat + d,

    d = rest + A_d (x_ref - rest) + B_d (u_ff - u0) less the next x_ref: what holding the input over the period costs, most where
    the plant jumps within it. It is known beforehand, so with ideal sensors and from the plan's state e_hat is e, and nothing is
    lost against a measured state. Through a parameter jump e_hat continues: plan and plant are continuous in the state. The plan's
    model says what is measured (`StateSpace.measurement`).

    Args:
        plan: where u_ff and x_ref come from.
        gains: a GainSchedule or a constant gain K (p, n); see PlanFollower.
        observer: designs M for each interval of the plan's model.
        period: time between two updates [s]; None: one in every physics step.
        measurement_delay: how late the sensors are known to be [s]; y_ref is taken as much earlier.

    Raises ControlError where gains or period do not fit, or a measurement depends on the input at once.
    """

    def __init__(
        self,
        plan: Plan,
        gains: GainSchedule | ArrayLike,
        observer: Observer,
        *,
        period: float | None = None,
        measurement_delay: float = 0.0,
    ) -> None:
        super().__init__(plan, gains, period)
        require_not_negative("measurement_delay [s]", measurement_delay, error=ControlError)
        plan.model.map(measured)
        self._observer, self._delay = require_observer(observer), measurement_delay

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
        x_ref = self.plan.states(instants.time, inside=instants.inside)
        seen = self.plan.states(instants.time - self._delay, inside=instants.inside if self._delay <= 0 else None)
        feedforward = self.mean_feedforward(instants)
        return OutputFeedbackLaw.around(self, self._observer, instants, feedforward=feedforward, x_ref=x_ref, measured_at=seen)


def _design_holds(
    model: SwitchedSystem, gains: GainSchedule, observer: Observer, instants: Instants
) -> tuple[list[EstimatorDesign], Indices]:
    """The distinct designs, and which (m,) of them each hold has: one serves all holds that agree in plant, gain and length."""

    def interval(inside: Array) -> Indices:
        """Number of the model in force among the distinct ones."""
        return model.numbers[model.interval(inside)]

    start, gain_of = interval(instants.inside), gains.interval(instants.inside)
    keys, which = numbered(zip(start.tolist(), gain_of.tolist(), instants.segments(interval), strict=True))
    designs = []
    for number, gain, segments in keys:
        system = model.distinct[number]
        M = observer.gain(system, sum(duration for _, duration in segments))
        A_d, B_d = held_through((model.distinct[k].A, model.distinct[k].B, duration) for k, duration in segments)
        moved = _moved_rest(system, [(model.distinct[k], duration) for k, duration in segments])
        designs.append(EstimatorDesign(gains.gains[gain], M, system.measurement.C, A_d, B_d, moved))
    return designs, which


def _moved_rest(first: StateSpace, segments: Sequence[tuple[StateSpace, float]]) -> Array:
    """What a hold through models at rest elsewhere adds to the state (n,), for one that is at rest in the first of them."""
    u_0 = first.operating_point.u0
    pushes = [system.A @ (first.rest - system.rest) + system.B @ (u_0 - system.operating_point.u0) for system, _ in segments]
    if not np.any(pushes):
        return np.zeros(len(first.A))
    steps = ((system.A, push[:, np.newaxis], duration) for (system, duration), push in zip(segments, pushes, strict=True))
    return np.asarray(held_through(steps)[1][:, 0])


def _measured_in(model: SwitchedSystem, instants: Instants, x: Array) -> Array:
    """The measurement y0 + C_m (x - rest) (m, .) in states x (m, n) at the instants of a run."""
    number = model.numbers[model.interval(instants.inside)]
    expected = np.stack([system.measurement.y0 for system in model.distinct])[number]
    for k, system in enumerate(model.distinct):
        expected[number == k] += (x[number == k] - system.rest) @ system.measurement.C.T
    return expected


def _drift(
    model: SwitchedSystem, instants: Instants, x_ref: Array, u: Array, designs: list[EstimatorDesign], which: Indices
) -> Array:
    """Where the plant gets from x_ref over each hold, less the next x_ref (m, n); last row zero.

    By this the deviation changes over a hold although nothing disturbs the plant: because the input is held, above all where the
    plant jumps meanwhile, or because the wanted states are no motion of the plant.

    Args:
        model, instants: of the run.
        x_ref, u: wanted states (m, n) and inputs (m, p).
        designs, which: the distinct designs, and which of them each hold has (m,).
    """
    drift, interval = np.zeros_like(x_ref), model.interval(instants.inside)
    rest, v = model.rest_states[interval], u - model.rest_inputs[interval]
    x, after = x_ref - rest, x_ref[1:] - rest[:-1]
    for number, design in enumerate(designs):
        held = np.flatnonzero(which[:-1] == number)
        drift[held] = x[held] @ design.A_d.T + v[held] @ design.B_d.T + design.moved - after[held]
    return drift
