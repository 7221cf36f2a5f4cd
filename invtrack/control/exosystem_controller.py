"""Output regulation through jumps in feedback form: u = F(t) x_e - K (x - G(t) x_e)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, finite_number, real_vector, require_not_negative, whole_number
from invtrack.control.gains import GainSchedule
from invtrack.control.observer import ExosystemObserver, Observer, require_observer, states_within_holds
from invtrack.control.output_feedback import OutputFeedbackLaw
from invtrack.control.protocol import AffineLaw, Instants
from invtrack.control.tracking_controller import PlanFollower
from invtrack.errors import ControlError
from invtrack.plans.plan import Plan
from invtrack.regulation.regulation_map import RegulationMap

CHUNK = 32768
"""Instants at which a map is evaluated at once: G(t) has n q entries at each."""

AGREEMENT = 1e-6
"""The output that a stated plan wants must be the exosystem's to this share of its size."""


class ExosystemController(PlanFollower):
    """u = F(t) x_hat_e - K_k (x_hat - G(t) x_hat_e) from the map's rest: exosystem's state and plant's, each known or estimated.

    F(t) x_hat_e is averaged over each hold, through which the exosystem runs on from x_hat_e. The error of x_hat_e acts on the
    plant but not the plant on it, a cascade, so the poles of closed loop and estimators are those that they were designed for.

    Args:
        regulation: the maps G(t), F(t), exact ones or those of Francis regulators.
        gains: a GainSchedule, a constant gain K (p, n), or None; see PlanFollower.
        exosystem_state: the true x_e (q,) at time `at`; it makes the wanted output.
        at: when the exosystem is in that state [s]; T_i of the map unless stated.
        plan: the plan for this output that sets the span of a run and what states are measured against;
            `regulation.plan(exosystem_state)` unless stated. That of a Francis regulator is no motion of the plant: state the exact
            map's to compare both on equal terms.
        exosystem_observer: estimates x_e from y_d, sampled at each update; None: x_e is known.
        initial_estimate: the first prior (q,) of x_e; zero unless stated.
        reference_noise: standard deviation of the noise on each sample of y_d, in the output's unit.
        seed: that noise is drawn with it.
        state_observer: estimates x from the plant's sensors, from G x_hat_e on; None: x is measured.
        period: time between two updates [s]; None: one in every physics step.

    Raises ControlError for what does not fit together or cannot be estimated. Source: Devasia, Paden, Rossi 1996, section 4.
    """

    def __init__(
        self,
        regulation: RegulationMap,
        gains: GainSchedule | ArrayLike | None,
        *,
        exosystem_state: ArrayLike,
        at: float | None = None,
        plan: Plan | None = None,
        exosystem_observer: Observer | None = None,
        initial_estimate: ArrayLike | None = None,
        reference_noise: float = 0.0,
        seed: int = 0,
        state_observer: Observer | None = None,
        period: float | None = None,
    ) -> None:
        if not isinstance(regulation, RegulationMap):
            raise ControlError(f"expected a RegulationMap, such as exosystem_map(...), got {type(regulation).__name__}")
        exosystem, T_i = regulation.exosystem, regulation.manoeuvre[0]
        # At T_i, a breakpoint of the map and so of the run: signals are to have no breakpoints that a run does not know.
        at = T_i if at is None else finite_number("at", at, unit="s", error=ControlError)
        true = exosystem.states(exosystem_state, at, T_i)
        self._wanted = exosystem.reference(true, at=T_i)
        super().__init__(regulation.plan(true) if plan is None else plan, gains, period)
        self._regulation, self._true, self._at = regulation, true, T_i
        require_not_negative("reference_noise", reference_noise, error=ControlError)
        if exosystem_observer is None and (initial_estimate is not None or reference_noise > 0):
            raise ControlError(
                "initial_estimate and reference_noise are for an estimated exosystem; give an exosystem_observer too"
            )
        self._observer = None if exosystem_observer is None else ExosystemObserver(exosystem, exosystem_observer)
        given = np.zeros(exosystem.n_states) if initial_estimate is None else initial_estimate
        self._initial = real_vector("initial_estimate", given, exosystem.names, error=ControlError)
        self._noise, self._seed = reference_noise, whole_number("seed", seed, error=ControlError)
        self._state_observer = None if state_observer is None else require_observer(state_observer)
        self._require_fit()

    def _require_fit(self) -> None:
        mine, plans = self._regulation.model, self.plan.model
        for kind in ("states", "inputs", "outputs"):
            if not getattr(mine, kind).fits(getattr(plans, kind)):
                raise ControlError(f"the map has the {kind} {getattr(mine, kind)}, the plan has {getattr(plans, kind)}")
        edges = np.unique(np.concatenate([self._regulation.breakpoints, self.plan.breakpoints]))
        times = np.concatenate([edges[:1] - 1.0, (edges[:-1] + edges[1:]) / 2, edges[-1:] + 1.0])
        wanted = self.plan.reference(times) - plans.operating_point.y0
        apart = np.max(np.abs(self._wanted(times) - wanted))
        if apart > AGREEMENT * np.max(np.abs(wanted)):
            raise ControlError(
                f"the plan's wanted output is {apart:.3g} away from that of the exosystem in the state stated; make `plan` for "
                "the same exosystem and state, such as exosystem_map(model, exosystem).plan(exosystem_state)"
            )

    @property
    def regulation(self) -> RegulationMap:
        """The maps G(t) and F(t)."""
        return self._regulation

    @property
    def breakpoints(self) -> Array:
        """Breakpoints of the plan and of the maps, switch times of the gains [s]."""
        return np.union1d(super().breakpoints, self._regulation.breakpoints)

    @property
    def measures(self) -> Literal["state", "sensors"]:
        """The sensors where the state is estimated."""
        return "state" if self._state_observer is None else "sensors"

    @property
    def stateless(self) -> bool:
        """Whether both states are known: an estimate is a state of the controller."""
        return self._state_observer is None and self._observer is None

    def exosystem_states(self, instants: Instants) -> Array:
        """x_hat_e (m, q) at the instants of a run: the true states, or the estimates from the samples of y_d up to each instant."""
        if self._observer is None:
            return self._regulation.exosystem.states(self._true, self._at, instants.time, inside=instants.inside)
        samples = self._wanted(instants.time, inside=instants.inside)
        samples += self._noise * np.random.default_rng(self._seed).standard_normal(samples.shape)
        return self._observer.estimates(instants, samples, self._initial)

    def begin(self, instants: Instants) -> AffineLaw | OutputFeedbackLaw:
        """The law for one run: y_d is known, so the exosystem's estimates and all that follows from them are worked out here."""
        regulation = self._regulation
        states = self.exosystem_states(instants)
        x_ref = _applied(regulation.x_map, regulation.x_rest, instants.time, instants.inside, states)
        within = states_within_holds(regulation.exosystem, instants, states)
        feedforward = instants.mean_over_hold(
            lambda times, inside: _applied(regulation.u_map, regulation.u_rest, times, inside, within)
        )
        observer = self._state_observer
        if observer is None:
            return AffineLaw.around(feedforward, x_ref, self.gains, instants.inside)
        # G x_hat_e is no motion of the plant while x_hat_e is being corrected, nor where the map is not exact: the law knows.
        return OutputFeedbackLaw.around(self, observer, instants, feedforward=feedforward, x_ref=x_ref, measured_at=x_ref)


def _applied(map_at: Callable[..., Array], rest_at: Callable[..., Array], times: Array, inside: Array, states: Array) -> Array:
    """rest(t_i) + map(t_i) states_i (m, .) for a map of time, G or F, its rest, and exosystem states (m, q)."""
    parts = [
        rest_at(times[part], inside=inside[part]) + np.einsum("mkq,mq->mk", map_at(times[part], inside=inside[part]), states[part])
        for part in (slice(first, first + CHUNK) for first in range(0, len(times), CHUNK))
    ]
    return np.concatenate(parts)
