"""A plant without its hidden modes: what is left is what inputs move and outputs show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, overload

import numpy as np

from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.errors import ModelError
from invtrack.linear.hidden_modes import SHARED_TOLERANCE, HiddenSubspaces, couplings, hidden_modes, hidden_subspaces
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.state_space import StateSpace
from invtrack.linear.switched import SwitchedSystem, as_switched

SMALL_PARTS = (1e-2, 1e-4, 1e-6, 1e-8, 1e-10, 1e-12, 1e-14)
"""Parts of states in hidden subspaces that are tried as rounding, or noise of the model, from the largest on."""


@overload
def without_hidden_modes(model: SwitchedSystem) -> SwitchedSystem: ...
@overload
def without_hidden_modes(model: Any) -> StateSpace: ...
def without_hidden_modes(model: Any) -> StateSpace | SwitchedSystem:
    """The plant without the modes that no input moves or no output shows; `model` itself where it has none.

    The outputs' response to the inputs from rest is the same, its zeros are the transmission zeros. Inputs, outputs, operating
    point, parameters and measurement stay. States that take no part in what is left out stay too, with their names and their
    entries; where hidden modes are single states, such as idle ones, the others stay as they are. Combinations of states that are
    left of the rest are called z1, z2, ..., without units. Estimates of the entries' errors are carried along. What is left is
    known to rounding over the weakest coupling by which inputs move it, or outputs show it, in the staircase.

    What is left out is still there in the plant. A mode that no input moves stays at rest only where nothing disturbs it; where it
    is unstable, no feedback holds it. A mode that no output shows goes on moving with the inputs: undamped it keeps ringing after
    a manoeuvre, unstable it runs away, and a plan on what is left tells neither.

    Of a SwitchedSystem only that part goes which is hidden in all intervals together: what the inputs of any interval, passed on
    by the states through any others, never reach, and what in the same way never gets to an output.

    Raises ModelError where nothing is left; where the measurement shows a mode that the outputs do not; where an equilibrium that
    jumps moves what no input moves; and where an interval has hidden modes besides those of all intervals, which cannot go as they
    act in another. Source: R. E. Kalman, "Mathematical
    description of linear dynamical systems", SIAM J. Control 1, 1963; by staircase forms, see `zero_kinds`.
    """
    switched = as_switched(model)
    hidden = hidden_subspaces(switched.distinct)
    unmoved, unseen = hidden.unreached, hidden.parts[2]
    count = unmoved.shape[1] + unseen.shape[1]
    if count == switched.n_states:
        raise ModelError(
            f"none of the states {list(switched.states.names)} is both moved by an input and shown by an output, so nothing is "
            "left of the plant but its feedthrough, y = y0 + D (u - u0)"
        )
    if count:
        unmoved, unseen = _along_states(unmoved, unseen, hidden.units, switched.distinct)
        for system in switched.distinct:
            _require_unmeasured(system, unseen, hidden)
        _require_unshifted(switched, unmoved, hidden)
        kept = _kept_states(np.hstack([unmoved, unseen]), hidden.units, switched.states)
        switched = SwitchedSystem(switched.map(kept.of), switched.switch_times)
    if not isinstance(model, SwitchedSystem):
        return switched.systems[0]
    if len(switched.distinct) > 1:
        _require_none_left(switched)
    return switched if count else model


@dataclass(frozen=True, eq=False)
class KeptStates:
    """New states z = L x (m, n), from which x = R z (n, m) but for what is left out."""

    L: Array
    R: Array
    channels: Channels

    def of(self, system: StateSpace) -> StateSpace:
        """The system in these states."""
        L, R, measurement = self.L, self.R, system.measurement
        into, back = np.abs(L), np.abs(R)
        errors = {
            "A": into @ system.errors("A") @ back,
            "B": into @ system.errors("B"),
            "C": system.errors("C") @ back,
            "D": system.errors("D"),
        }
        return replace(
            system,
            A=L @ system.A @ R,
            B=L @ system.B,
            C=system.C @ R,
            states=self.channels,
            rest=L @ system.rest,
            measurement=replace(measurement, C=measurement.C @ R),
            error_estimates={name: errors[name] for name in system.error_estimates},
        )


def _kept_states(left_out: Array, units: Array, states: Channels) -> KeptStates:
    """States that take no part in `left_out` (n, h), as they are, then combinations of the others at right angles to it."""
    n, h = left_out.shape
    involved = np.any(left_out, axis=1)
    alone = np.flatnonzero(~involved)
    combinations = np.zeros((n, n - h - len(alone)))
    combinations[involved] = np.linalg.qr(left_out[involved], mode="complete")[0][:, h:]
    for column in combinations.T:  # the first state that takes much part does so with a positive sign
        column *= np.sign(column[np.argmax(np.abs(column) > 0.5 * np.max(np.abs(column)))])
    unit = np.eye(n)[:, alone]
    letters = (f"z{i}" for i in range(1, 2 * n + 1))
    names = [name for name in letters if name not in states][: combinations.shape[1]]
    return KeptStates(
        L=np.hstack([unit, combinations / units[:, None]]).T,
        R=np.hstack([unit, combinations * units[:, None]]),
        channels=Channels([*(states.names[i] for i in alone), *names], [*(states.units[i] for i in alone), *[""] * len(names)]),
    )


def _along_states(unmoved: Array, unseen: Array, units: Array, systems: Sequence[StateSpace]) -> tuple[Array, Array]:
    """Both bases without the states whose part in them is rounding, or so small that what it couples counts as none."""
    judged = [couplings(system, units) for system in systems]
    for smallest in SMALL_PARTS:
        given = np.hstack([np.where(np.linalg.norm(M, axis=1, keepdims=True) > smallest, M, 0.0) for M in (unmoved, unseen)])
        along, involved = np.zeros_like(given), np.any(given, axis=1)
        along[involved] = np.linalg.qr(given[involved])[0]
        left, right = along[:, : unmoved.shape[1]], along[:, unmoved.shape[1] :]
        if all(_is_hidden(left, right, *matrices) for matrices in judged):
            break
    return left, right


def _is_hidden(unmoved: Array, unseen: Array, A: Array, B: Array, C: Array) -> bool:
    """Whether nothing but its own states acts on the one part, and the other acts on nothing but its own states."""
    act_on = [unmoved.T @ B, _across(unmoved, unmoved.T @ A)]
    acted_on = [(C @ unseen).T, _across(unseen, (A @ unseen).T)]
    return all(np.linalg.norm(M, 2) <= 1.0 for M in (*act_on, *acted_on) if M.size)


def _across(basis: Array, rows: Array) -> Array:
    """Rows (h, n) without their parts along the basis (n, h)."""
    return np.asarray(rows - (rows @ basis) @ basis.T)


def _require_unmeasured(system: StateSpace, unseen: Array, hidden: HiddenSubspaces) -> None:
    measurement, C = system.measurement, system.measurement.C * hidden.units
    size = np.linalg.norm(C, axis=1)
    noise = np.linalg.norm(system.errors("C") * hidden.units, axis=1).max(initial=0.0)
    shows = np.linalg.norm(C @ unseen, axis=1) > SHARED_TOLERANCE * size + noise
    if np.any(shows):
        names = [name for name, shown in zip(measurement.channels.names, shows, strict=True) if shown]
        raise ModelError(
            f"the measured signals {names} show modes that the outputs {list(system.outputs.names)} do not, so without them the "
            "measurement would be another; leave these signals out of the measurement (dataclasses.replace(model, "
            "measurement=None) measures the outputs alone), or make one of them an output"
        )


def _require_unshifted(switched: SwitchedSystem, unmoved: Array, hidden: HiddenSubspaces) -> None:
    shifts = switched.shifts / hidden.units
    parts, sizes = np.linalg.norm(shifts @ unmoved, axis=1), np.linalg.norm(shifts, axis=1)
    moved = np.flatnonzero(parts > SHARED_TOLERANCE * sizes)
    if moved.size:
        raise ModelError(
            f"at t = {switched.switch_times[moved[0]]:.6g} s the equilibrium jumps along modes that no input moves, so that these"
            " do not stay at rest there; plan on the switched plant as it is"
        )


def _require_none_left(switched: SwitchedSystem) -> None:
    for k, modes in enumerate(switched.map(hidden_modes)):
        if modes:
            listed = format_zeros([value for value, _ in modes])
            kinds = " and ".join(sorted({f"{kind}s" for _, kind in modes}))
            raise ModelError(
                f"interval {k} has hidden modes, {listed} ({kinds}), that cannot go: other intervals move and show the states that "
                "take part in them; plan on the switched plant as it is"
            )
