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
from invtrack.control.observer import Observer, require_observer
from invtrack.control.protocol import Instants, numbered
from invtrack.control.tracking_controller import PlanFollower
from invtrack.errors import ControlError
from invtrack.linear.propagation import held_through
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan

DELAY_ROUNDING = 1e-9
"""Instants are told apart from those a delay earlier to within this share of the delay."""


@dataclass(frozen=True, eq=False)
class EstimatorDesign:
    """What a hold needs.

    Args:
        K: feedback gain (p, n).
        M: correction (n, m) by what was measured at the start of the hold.
        C_m, D_m: what is measured of the state (m, n), and of the input at once (m, p).
        input_limits: what the actuators pass on (p, 2).
        A_d: the plant's step over the hold, x - rest <- A_d (x - rest) + B_d (u - u0) + moved, from the rest at its start: (n, n).
        B_d: (n, p).
        moved: what jumps of the rest within the hold add (n,).
    """

    K: Array
    M: Array
    C_m: Array
    D_m: Array
    input_limits: Array
    A_d: Array
    B_d: Array
    moved: Array

    @cached_property
    def low(self) -> Array:
        """Smallest input that is passed on (p,)."""
        return self.input_limits[:, 0]

    @cached_property
    def high(self) -> Array:
        """Largest input that is passed on (p,)."""
        return self.input_limits[:, 1]

    @cached_property
    def has_feedthrough(self) -> bool:
        """Whether the input acts on a measurement at once, as a force does on an accelerometer."""
        return bool(np.any(self.D_m))


class OutputFeedbackLaw:
    """e_hat = e_prior + M (y_m - y_ref - C_m e_prior - D_m w), u = u_ff - K e_hat.

    From one hold to the next w <- sat(u) - u_ff, e_prior <- A_d e_hat + B_d w + d. e = x - x_ref is the deviation from a wanted
    state, sat(u) what the actuators pass on of u. The first prior is zero: the plant is where it should be. What is measured at an
    instant is still under the input of the hold before it; before the first, that of the operating point.

    Args:
        feedforward: u_ff (m, p) at the instants of the run.
        x_ref: wanted states (m, n), as deviations from the operating point before all jumps.
        expected: the measurement y_ref (m, .) in the wanted state, with the feedforward in force when it was taken.
        seen_hold: (m,), the hold whose input is in force when a measurement is taken, -1 before the first.
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
        seen_hold: Indices,
        drift: Array,
        designs: list[EstimatorDesign],
        which: Indices,
    ) -> None:
        self.feedforward, self.x_ref, self.expected, self.drift = feedforward, x_ref, expected, drift
        self.designs, self.which, self.seen_hold = designs, which, seen_hold
        self._corrections = np.zeros((len(x_ref) + 1, feedforward.shape[1]))  # w of each hold; the last row: none before the first
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
        delay: float = 0.0,
    ) -> OutputFeedbackLaw:
        """The law for one run, an estimator designed for each distinct hold.

        Args:
            follower: whose plan's model and gains it goes by.
            observer: designs the correction M.
            instants: those of the run.
            feedforward: inputs (m, p), averaged over the holds.
            x_ref: wanted states (m, n).
            measured_at: the wanted states (m, n) that the sensors show at the instants: earlier ones where they are late.
            delay: how late they are [s].
        """
        model = follower.plan.model
        designs, which = _design_holds(model, follower.gains, observer, instants)
        seen_hold = _seen_holds(instants, delay)
        return cls(
            feedforward,
            x_ref,
            expected=_measured_in(model, instants, measured_at, feedforward, seen_hold),
            seen_hold=seen_hold,
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
        design = self.designs[int(self.which[index])]
        innovation = measurement - self.expected[index] - design.C_m.dot(self._prior)
        if design.has_feedthrough:
            innovation -= design.D_m.dot(self._corrections[int(self.seen_hold[index])])
        deviation = self._prior + design.M.dot(innovation)
        feedforward = self.feedforward[index]
        result: Array = feedforward - design.K.dot(deviation)
        correction = self._corrections[index] = np.clip(result, design.low, design.high) - feedforward
        self._prior = design.A_d.dot(deviation) + design.B_d.dot(correction) + self.drift[index]
        self._estimate = self.x_ref[index] + deviation
        return result


class OutputFeedbackController(PlanFollower):
    """u = u_ff - K_k e_hat, e_hat the estimated deviation e = x - x_ref from the plan.

    At each update, with the plan's measurement y_ref = y0 + C_m (x_ref - rest) + D_m (u_ff - u0), u_ff of the hold that ends:

        e_hat = e_prior + M (y_m - y_ref - C_m e_prior - D_m (sat(u) - u_ff)),
        u = u_ff - K e_hat,    e_prior <- A_d e_hat + B_d (sat(u) - u_ff) + d,

    sat(u) what the model's input limits leave of u, so that an input that is cut off does not lead the estimate astray, and
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

    Raises ControlError where gains or period do not fit.
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
        x_ref = instants.states_of(self.plan)
        seen = x_ref if self._delay <= 0 else self.plan.states(instants.time - self._delay)
        feedforward = self.mean_feedforward(instants)
        return OutputFeedbackLaw.around(
            self, self._observer, instants, feedforward=feedforward, x_ref=x_ref, measured_at=seen, delay=self._delay
        )


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
        measurement, limits = system.measurement, system.input_limits
        designs.append(EstimatorDesign(gains.gains[gain], M, measurement.C, measurement.D, limits, A_d, B_d, moved))
    return designs, which


def _moved_rest(first: StateSpace, segments: Sequence[tuple[StateSpace, float]]) -> Array:
    """What a hold through models at rest elsewhere adds to the state (n,), for one that is at rest in the first of them."""
    u_0 = first.operating_point.u0
    pushes = [system.A @ (first.rest - system.rest) + system.B @ (u_0 - system.operating_point.u0) for system, _ in segments]
    if not np.any(pushes):
        return np.zeros(len(first.A))
    steps = ((system.A, push[:, np.newaxis], duration) for (system, duration), push in zip(segments, pushes, strict=True))
    return np.asarray(held_through(steps)[1][:, 0])


def _seen_holds(instants: Instants, delay: float) -> Indices:
    """The hold (m,) whose input is in force when what is known at each instant was measured, -1 before the first.

    Without delay that is the hold which ends there; a late sensor shows what was measured after an update, if it was made then.
    """
    if delay <= 0:
        return np.arange(-1, len(instants.time) - 1)
    return np.searchsorted(instants.time, instants.time - (1 - DELAY_ROUNDING) * delay, side="right") - 1


def _measured_in(model: SwitchedSystem, instants: Instants, x: Array, u: Array, seen_hold: Indices) -> Array:
    """The measurement y0 + C_m (x - rest) + D_m (u - u0) (m, .) in states x (m, n) at the instants of a run.

    u (m, p): inputs of the holds. seen_hold (m,): the hold in force when each measurement is taken, -1 before the first, when the
    plant's input is that of the operating point before all jumps.
    """
    number = model.numbers[model.interval(instants.inside)]
    expected = np.stack([system.measurement.y0 for system in model.distinct])[number]
    in_force = np.where(seen_hold[:, np.newaxis] < 0, model.operating_point.u0, u[seen_hold])
    for k, system in enumerate(model.distinct):
        here, measurement = number == k, system.measurement
        expected[here] += (x[here] - system.rest) @ measurement.C.T
        expected[here] += (in_force[here] - system.operating_point.u0) @ measurement.D.T
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
