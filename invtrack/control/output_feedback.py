"""Feedback of an estimated state: the estimator and the law that it serves, prepared for one run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.checks import require_not_negative
from invtrack.control.gains import GainSchedule
from invtrack.control.observer import Observer, measured
from invtrack.control.protocol import Instants, Segments
from invtrack.control.tracking_controller import PlanFollower
from invtrack.errors import ControlError
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EstimatorDesign:
    """What a hold needs: K (p, n), M (n, m), C_m (m, n), and the plant's transition over it, x <- A_d x + B_d (u - u0)."""

    K: Array
    M: Array
    C_m: Array
    A_d: Array
    B_d: Array

    @cached_property
    def closed_loop(self) -> Array:
        """A_d - B_d K (n, n)."""
        result: Array = self.A_d - self.B_d @ self.K
        return result


def design_holds(model: SwitchedSystem, gains: GainSchedule, observer: Observer, instants: Instants) -> list[EstimatorDesign]:
    """The design for each hold (m,); one serves all holds that agree in plant, gain and length."""
    interval, gain_of = model.interval(instants.inside), gains.interval(instants.inside)
    keys = list(zip(interval.tolist(), gain_of.tolist(), instants.segments(model.interval), strict=True))
    designs = {}
    for key in dict.fromkeys(keys):
        k, gain, segments = key
        system = model.systems[k]
        M = observer.gain(system, sum(length for _, length in segments))
        designs[key] = EstimatorDesign(gains.gains[gain], M, system.measurement.C, *_transition(model, segments))
    return [designs[key] for key in keys]


def _transition(model: SwitchedSystem, segments: Segments) -> tuple[Array, Array]:
    """A_d (n, n) and B_d (n, p) of a held input over segments of a switched plant."""
    n, p = model.n_states, model.n_channels
    A_d, B_d = np.eye(n), np.zeros((n, p))
    for k, length in segments:
        system = model.systems[k]
        augmented = np.block([[system.A, system.B], [np.zeros((p, n + p))]]) * length
        step = scipy.linalg.expm(augmented)[:n]
        A_d, B_d = step[:, :n] @ A_d, step[:, :n] @ B_d + step[:, n:]
    return A_d, B_d


class OutputFeedbackLaw:
    """e_hat = e_prior + M (y_m - expected - C_m e_prior), u = u_ff - K e_hat, e_prior <- (A_d - B_d K) e_hat + drift.

    e = x - x_ref is the deviation from a wanted state. feedforward (m, p); x_ref (m, n); expected (m, .): the measurement in the
    wanted state; drift (m, n): see `drift_of`. The first prior is that the plant is where it should be.
    """

    def __init__(self, feedforward: Array, x_ref: Array, expected: Array, designs: Sequence[EstimatorDesign], drift: Array) -> None:
        self._feedforward, self._x_ref, self._expected, self._designs = feedforward, x_ref, expected, designs
        self._drift = drift
        self._prior = np.zeros(x_ref.shape[1])
        self._estimate = x_ref[0]

    @property
    def estimate(self) -> Array:
        """The estimated state (n,) of the latest update."""
        estimate: Array = self._estimate
        return estimate

    def update(self, index: int, measurement: Array) -> Array:
        """Input (p,) at instant number `index`."""
        design = self._designs[index]
        innovation = measurement - self._expected[index] - design.C_m.dot(self._prior)
        deviation = self._prior + design.M.dot(innovation)
        self._prior = design.closed_loop.dot(deviation) + self._drift[index]
        self._estimate = self._x_ref[index] + deviation
        result: Array = self._feedforward[index] - design.K.dot(deviation)
        return result


def measured_in(model: SwitchedSystem, instants: Instants, x: Array) -> Array:
    """The measurement y0 + C_m x (m, .) in states x (m, n) at the instants of a run."""
    interval = model.interval(instants.inside)
    expected = np.stack([system.measurement.y0 for system in model.systems])[interval]
    for k, system in enumerate(model.systems):
        expected[interval == k] += x[interval == k] @ system.measurement.C.T
    return expected


def drift_of(x_ref: Array, v: Array, designs: Sequence[EstimatorDesign]) -> Array:
    """A_d x_ref + B_d v less the next x_ref (m, n), for wanted states x_ref (m, n) and inputs v = u - u0 (m, p); last row zero.

    By this the deviation changes over a hold although nothing disturbs the plant: because the input is held, above all where the
    plant jumps meanwhile, or because the wanted states are no motion of the plant.
    """
    drift = np.zeros_like(x_ref)
    owner = np.array([id(design) for design in designs[:-1]])
    for key, design in {id(design): design for design in designs}.items():
        held = np.flatnonzero(owner == key)
        drift[held] = x_ref[held] @ design.A_d.T + v[held] @ design.B_d.T - x_ref[held + 1]
    return drift


class OutputFeedbackController(PlanFollower):
    """u = u_ff - K_k e_hat, e_hat the estimated deviation e = x - x_ref from the plan.

    At each update, with the plan's measurement y_ref = y0 + C_m x_ref:

        e_hat = e_prior + M (y_m - y_ref - C_m e_prior),    u = u_ff - K e_hat,    e_prior <- A_d e_hat - B_d K e_hat + d,

    d = A_d x_ref + B_d (u_ff - u0) less the next x_ref: what holding the input over the period costs, most where the plant jumps
    within it. It is known beforehand, so with ideal sensors and from the plan's state e_hat is e, and nothing is lost against a
    measured state. Through a parameter jump e_hat continues: plan and plant are continuous in the state.

    plan, gains, period: as for TrackingController. observer: designs M for each interval of the plan's model. measurement_delay
    [s]: how late the sensors are known to be; y_ref is then taken as much earlier. The plan's model says what is measured
    (`StateSpace.measurement`).

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
        for system in plan.model.systems:
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
        model = self.plan.model
        x_ref = self.plan.states(instants.time, inside=instants.inside)
        seen = self.plan.states(instants.time - self._delay, inside=instants.inside if self._delay <= 0 else None)
        designs = design_holds(model, self.gains, self._observer, instants)
        feedforward = self.mean_feedforward(instants)
        drift = drift_of(x_ref, feedforward - model.operating_point.u0, designs)
        return OutputFeedbackLaw(feedforward, x_ref, measured_in(model, instants, seen), designs, drift)
