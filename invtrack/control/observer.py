"""Observers: of the plant's state and of an exosystem's."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, cast

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arguments import instance
from invtrack.arrays import Array, complex_numbers, real_numbers, real_vector, require_duration, shown, stable_poles
from invtrack.channels import Channels
from invtrack.control.placement import placed_gain
from invtrack.control.protocol import Instants, Segments, numbered
from invtrack.errors import ControlError
from invtrack.linear.hidden_modes import hidden_modes, hidden_subspaces
from invtrack.linear.mode_groups import listed, unmoved_modes, unseen_modes
from invtrack.linear.propagation import Propagator, held_through, sampled_noise, zero_order_hold
from invtrack.linear.state_space import Measurement, StateSpace, as_state_space
from invtrack.references.exosystem import Exosystem

STEADY = 1e-12
"""An estimation error that shrinks by less than this share per sample does not decay: rounding of the transition is as large."""


class Observer(Protocol):
    """Designs the correction of a current estimator: x_hat = x_prior + M (y_m - C_m x_prior - D_m v), v the input, known."""

    def gain(self, system: StateSpace, period: float) -> Array:
        """M (n, m) for one interval's plant, measured every `period` seconds."""
        ...


@dataclass(frozen=True, eq=False)
class LuenbergerObserver:
    """Estimation error with the continuous-time poles stated, the same in every interval: exp(s period) once sampled.

    poles: n of them left of the imaginary axis, complex ones in conjugate pairs, as for `place`: a mode that the measurements do
    not show may stay, if its own eigenvalue is among them.

    Raises ControlError for anything else.
    """

    poles: Sequence[complex]

    def __post_init__(self) -> None:
        poles = complex_numbers("observer poles", self.poles, error=ControlError)
        stable_poles("observer poles", poles, poles.size, error=ControlError)

    def gain(self, system: StateSpace, period: float) -> Array:
        """M (n, m) with eig(A_d - M C_m A_d) = exp(poles period). Raises ControlError where the poles cannot be placed."""
        system = as_state_space(system)
        require_duration("period", period, error=ControlError)
        wanted = stable_poles("observer poles", self.poles, system.n_states, error=ControlError)
        seen = _through_measurement(system)
        hidden = hidden_subspaces([seen])
        A_d, _ = zero_order_hold(system.A * hidden.units / hidden.units[:, None], np.zeros((system.n_states, 0)), period)
        if not np.all(np.isfinite(A_d)):
            raise ControlError(f"within a period of {period:g} s the plant outgrows what numbers hold; choose a shorter one")
        # By the change per second, so that at short periods, where all poles are near 1, they are still told apart.
        rate = (A_d - np.eye(system.n_states)) / period
        M = placed_gain(
            rate.T,
            ((seen.C * hidden.units) @ A_d).T,
            wanted,
            fixed=hidden.unseen,
            modes=unseen_modes(seen),
            name="observer poles",
            obstacle=f"the measurements {list(system.measurement.channels.names)} do not show",
            remedy="measure one of these states",
            mapped=lambda poles: np.asarray(np.expm1(poles * period) / period, dtype=complex),
        ).T
        return period * hidden.units[:, None] * M


@dataclass(frozen=True, eq=False)
class KalmanFilter:
    """Steady-state Kalman filter of each interval.

    input_noise: standard deviation per square root of Hz of white noise that acts like the inputs (p,), or a number for all: the
    disturbance that the filter is to expect, on the state alone. measurement_noise: standard deviation (m,) of one sample of each
    measurement, and of what of the disturbance reaches it at once, as a force reaches an accelerometer.

    Raises ControlError for levels that are not positive.
    """

    input_noise: ArrayLike
    measurement_noise: ArrayLike

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            levels = real_numbers(name, value, error=ControlError)
            _levels(name, levels, [f"{name} {i}" for i in range(1, max(levels.size, 1) + 1)])

    def gain(self, system: StateSpace, period: float) -> Array:
        """M (n, m) from the discrete Riccati equation. Raises ControlError where it has no stabilizing solution."""
        system = as_state_space(system)
        require_duration("period", period, error=ControlError)
        C_m = system.measurement.C
        intensity = _levels("input_noise", self.input_noise, system.inputs.names)
        deviation = _levels("measurement_noise", self.measurement_noise, system.measurement.channels.names)
        A_d, Q_d = sampled_noise(system.A, system.B * intensity, period)
        try:
            P = scipy.linalg.solve_discrete_are(A_d.T, C_m.T, Q_d, np.diag(deviation**2))
        except (np.linalg.LinAlgError, ValueError) as error:
            raise ControlError(f"no steady Kalman gain: {_obstacle(system) or error}") from error
        innovation = C_m @ P @ C_m.T + np.diag(deviation**2)
        M = np.asarray(scipy.linalg.solve(innovation, C_m @ P, assume_a="pos").T)
        largest = float(np.max(np.abs(np.linalg.eigvals(A_d - M @ C_m @ A_d))))
        if not largest < 1 - STEADY:
            reason = _obstacle(system) or f"the estimation error grows {largest:.12g} times from sample to sample"
            raise ControlError(f"no steady Kalman gain: {reason}")
        return M


def _through_measurement(system: StateSpace) -> StateSpace:
    """The system with what is measured as its outputs."""
    return StateSpace(
        system.A,
        system.B,
        system.measurement.C,
        states=system.states,
        inputs=system.inputs,
        outputs=system.measurement.channels,
        error_estimates={name: error for name, error in system.error_estimates.items() if name in "AB"},
    )


def _obstacle(system: StateSpace) -> str:
    """Why no steady filter exists, "" where nothing is found."""
    unseen = [group for group in unseen_modes(_through_measurement(system)) if group.side >= 0]
    if unseen:
        return (
            f"the measurements {list(system.measurement.channels.names)} do not show {listed(unseen)}, on or right of the "
            "imaginary axis; measure one of these states"
        )
    quiet = [group for group in unmoved_modes(system) if group.side == 0]
    if quiet:
        return (
            f"noise at the inputs {list(system.inputs.names)} does not disturb {listed(quiet)}, on the imaginary axis, so "
            "the filter would end up correcting it no more; place the poles of a LuenbergerObserver instead"
        )
    return ""


def require_observer(value: object) -> Observer:
    """The value, if it designs corrections as an observer does; raises ControlError for anything else."""
    if isinstance(value, type) or not callable(getattr(value, "gain", None)):
        raise ControlError(f"expected an observer, such as KalmanFilter(0.1, 0.01), got {shown(value)}")
    return cast(Observer, value)


def _levels(name: str, value: ArrayLike, channels: Sequence[str]) -> Array:
    """Standard deviations, one for each channel; a number stands for all of them."""
    levels = real_numbers(name, value, error=ControlError)
    levels = real_vector(name, np.full(len(channels), levels) if levels.ndim == 0 else levels, channels, error=ControlError)
    if np.any(levels <= 0):
        raise ControlError(f"{name} must be positive, got {levels.tolist()}: a filter without noise has no optimal gain")
    return levels


class ExosystemObserver:
    """x_hat_e = x_prior + M (y_d - C_e x_prior), x_prior <- exp(A_e h) x_hat_e: a current estimator on samples of y_d.

    observer designs M for each interval of the exosystem and each hold h: LuenbergerObserver(poles) from the q poles of the
    estimation error, the same in every interval; KalmanFilter(input_noise, measurement_noise) from white noise that acts on each of
    the q states, and from that of a sample. Where the exosystem stands still (A_e = 0) and its output does not tell its state, such
    as before it starts and after it has ended, the estimate stays as it is.

    Raises ControlError where the exosystem moves and has a mode that y_d does not show. Source: Devasia, Paden, Rossi 1996,
    section 4 and Figure 3.
    """

    def __init__(self, exosystem: Exosystem, observer: Observer) -> None:
        expected = "an Exosystem, such as sinusoidal_exosystem(...)"
        self.exosystem = instance("exosystem", exosystem, Exosystem, expected=expected, error=ControlError)
        self.observer = require_observer(observer)
        self._silent = np.array([self._is_silent(k) for k in range(len(exosystem.A))])

    def _is_silent(self, k: int) -> bool:
        A, C = self.exosystem.A[k], self.exosystem.C[k]
        unseen = [value for value, kind in hidden_modes(StateSpace(A, C.T, C)) if "unobservable" in kind]
        if unseen and np.any(A):
            modes = ", ".join(f"{value.real:.6g}{value.imag:+.6g}j" if value.imag else f"{value.real:.6g}" for value in unseen)
            raise ControlError(
                f"in interval {k} of the exosystem y_d does not show its mode(s) with eigenvalue(s) {modes}, so the state "
                f"{list(self.exosystem.names)} cannot be estimated there; leave what no output needs out of the exosystem, or give "
                "its state to the controller without an observer"
            )
        return bool(unseen)

    def estimates(self, instants: Instants, samples: Array, initial: Array) -> Array:
        """Estimates (m, q) at a run's instants, each from the samples of y_d (m, p) up to its own; initial (q,): the first prior.

        y_d does not depend on the plant, so the estimates for a whole run are known before the plant moves.
        """
        holds, which = numbered(instants.segments(self.exosystem.interval))
        designs = [self._design(hold) for hold in holds]
        prior = np.empty((len(samples), len(initial)))
        added = np.empty_like(prior)
        for number, design in enumerate(designs):
            added[which == number] = samples[which == number] @ design.correction_step.T
        prior[:1] = initial
        for i, number in enumerate(which[:-1].tolist()):
            prior[i + 1] = designs[number].error_step.dot(prior[i]) + added[i]
        result = prior.copy()
        for number, design in enumerate(designs):
            chosen = which == number
            result[chosen] += (samples[chosen] - prior[chosen] @ design.C.T) @ design.M.T
        return result

    def _design(self, hold: Segments) -> _Design:
        k, length = hold[0][0], sum(length for _, length in hold)
        A, C = self.exosystem.A[k], self.exosystem.C[k]
        p, q = C.shape
        M = np.zeros((q, p))
        if not self._silent[k]:
            # As inputs, so that a Kalman filter's noise may act on every state.
            seen = Measurement(C, np.zeros((p, q)), Channels.numbered("y_d", p), np.zeros(p))
            M = self.observer.gain(StateSpace(A, np.eye(q), np.eye(q), measurement=seen), length)
        transition, _ = held_through((self.exosystem.A[i], np.zeros((q, 0)), duration) for i, duration in hold)
        return _Design(C, M, transition @ (np.eye(q) - M @ C), transition @ M)


@dataclass(frozen=True, eq=False)
class _Design:
    """C_e (p, q), M (q, p), and from prior to next prior: error_step exp(A_e h) (I - M C_e), correction_step exp(A_e h) M."""

    C: Array
    M: Array
    error_step: Array
    correction_step: Array


def states_within_holds(exosystem: Exosystem, instants: Instants, states: Array) -> Array:
    """Where the exosystem goes from states (m, q) at the instants: its states at the middles of the holds' parts (k, q).

    A feedforward that is the mean of F(t) x_e(t) over the hold stays exact to second order also where x_e is an estimate, which the
    next sample will correct.
    """
    interval = exosystem.interval(instants.part_inside)
    owner = instants.part_owner
    half = instants.part_share * instants.hold[owner] / 2
    ordinal = np.arange(len(owner)) - instants.first[owner]
    result = np.empty((len(owner), states.shape[1]))
    propagators = {k: Propagator(exosystem.A[k]) for k in np.unique(interval).tolist()}
    state = states.copy()  # at the start of the part of each hold that comes next
    for parts in np.split(np.argsort(ordinal, kind="stable"), np.cumsum(np.bincount(ordinal))[:-1]):
        for k in np.unique(interval[parts]).tolist():
            ours = parts[interval[parts] == k]
            result[ours] = propagators[k].states(state[owner[ours]], half[ours])
            state[owner[ours]] = propagators[k].states(result[ours], half[ours])
    return result
