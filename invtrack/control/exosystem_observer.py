"""Estimates of an exosystem's state from samples of the output that it asks for."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.channels import Channels
from invtrack.control.observer import Observer
from invtrack.control.protocol import Instants, Segments, numbered
from invtrack.errors import ControlError
from invtrack.linear.hidden_modes import hidden_modes
from invtrack.linear.propagation import Propagator
from invtrack.linear.state_space import Measurement, StateSpace
from invtrack.linear.zero_order_hold import held_through
from invtrack.references.exosystem import Exosystem

Array = NDArray[np.float64]


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
        self.exosystem, self.observer = exosystem, observer
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
