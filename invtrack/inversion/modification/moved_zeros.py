"""Which zeros of the inverse are moved, and where to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import InversionError, NonHyperbolicError
from invtrack.lti.hidden_modes import zero_kinds
from invtrack.lti.state_space import StateSpace
from invtrack.lti.zero_dynamics import AXIS_TOLERANCE, REMEDIES, InternalDynamics, format_zeros, on_axis

Array = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]

NAME_TOLERANCE = 1e-3
"""A zero named by a user is the one within this share of its magnitude: four digits, as printed, are enough."""

REPEATED_TOLERANCE = 1e-6
"""Zeros closer than this share of the largest are one repeated zero, which is moved as a whole: rounding splits it."""


@dataclass(frozen=True, eq=False)
class Wish:
    """What is asked of the zeros: `move` says where named ones go; or those with |Re| <= within get the real part `to` [rad/s]."""

    move: Mapping[complex, complex] | None
    within: float | None
    to: float | None

    def __post_init__(self) -> None:
        if (self.move is None) == (self.within is None) or (self.within is None) != (self.to is None):
            raise InversionError(
                "expected either move={zero: where it goes} or both within=... and to=...; got "
                f"move={self.move}, within={self.within}, to={self.to}"
            )
        if self.within is not None and not self.within >= 0:
            raise InversionError(f"within must not be negative, got {self.within}")

    def targets(self, zeros: ComplexArray) -> tuple[NDArray[np.bool_], ComplexArray]:
        """Which of `zeros` are moved, and where to: (n_z,) mask and (n_z,) poles, those not moved as they are.

        Raises InversionError for a name that fits no zero, for a real zero that is to become a complex one or the reverse, and for
        a place on the imaginary axis.
        """
        moved, targets = np.zeros(len(zeros), dtype=bool), zeros.copy()
        near = REPEATED_TOLERANCE * float(np.max(np.abs(zeros), initial=0.0))
        imag = np.where(np.abs(zeros.imag) > near, zeros.imag, 0.0)  # rounding splits a repeated real zero into a pair
        if self.within is not None and self.to is not None:
            moved = np.abs(zeros.real) <= self.within
            targets[moved] = self.to + 1j * imag[moved]
        for name, target in (self.move or {}).items():
            for chosen, goal in _named(zeros, imag, near, complex(name), complex(target)):
                moved[chosen], targets[chosen] = True, goal
        for i in np.flatnonzero(~moved):  # one that differs by rounding alone has no subspace of its own: it moves along
            partners = np.flatnonzero(moved & (np.abs(zeros - zeros[i]) <= near))
            if partners.size:
                moved[i], targets[i] = True, targets[partners[0]].real + 1j * imag[i]
        places = targets[moved]
        if not np.all(np.isfinite(places)) or np.any(np.abs(places.real) <= AXIS_TOLERANCE * np.abs(places)):
            raise InversionError(
                "zeros must be moved off the imaginary axis (to the right: preactuation, to the left: postactuation), got "
                f"{format_zeros(places)}"
            )
        return moved, targets


def _named(zeros: ComplexArray, imag: Array, near: float, name: complex, target: complex) -> list[tuple[NDArray[np.intp], complex]]:
    """The zeros (repeated ones together) that a name means, and their conjugates, with their targets."""
    distance = np.abs(zeros - name)
    allowed = max(NAME_TOLERANCE * abs(name), near)
    if not np.min(distance, initial=np.inf) <= allowed:
        listed = format_zeros(complex(name.real, abs(name.imag)))
        raise InversionError(
            f"no zero at {listed} to move (to within {NAME_TOLERANCE:g} of its magnitude);"
            f" the zeros are {format_zeros(zeros) or 'none'}"
        )
    zero = zeros[np.argmin(distance)]
    chosen = np.flatnonzero(np.abs(zeros - zero) <= near)
    is_real = not np.any(imag[chosen])
    if is_real != (target.imag == 0):
        raise InversionError(
            f"a real zero goes to a real pole and a complex pair to a complex pair, got {name:.6g} to {target:.6g}; the zeros are "
            f"{format_zeros(zeros)}"
        )
    if is_real:
        return [(chosen, target)]
    return [(chosen, target), (np.flatnonzero(np.abs(zeros - np.conj(zero)) <= near), complex(np.conj(target)))]


def require_movable(system: StateSpace, internal: InternalDynamics, moved: NDArray[np.bool_], *, endless: bool) -> None:
    """Raises InversionError for zeros that no input moves, NonHyperbolicError for those left on the axis of an endless interval."""
    left = on_axis(internal) & ~moved & endless
    if not np.any(left) and not np.any(moved):
        return
    kinds = np.array(zero_kinds(system, internal.zeros))
    fixed = moved & np.char.startswith(kinds, "uncontrollable")
    if np.any(fixed):
        which = "; ".join(
            f"{format_zeros(internal.zeros[fixed & (kinds == kind)])}: {kind}, {REMEDIES[kind]}" for kind in np.unique(kinds[fixed])
        )
        raise InversionError(f"zeros that no input moves cannot be moved in the inverse either: {which}")
    if np.any(left):
        raise NonHyperbolicError(
            f"zeros at {format_zeros(internal.zeros[left], float(np.max(np.abs(internal.zeros))))} lie on the imaginary axis and "
            "are not moved, so the bounded inverse does not exist or is not unique before or after the manoeuvre; move them too"
        )
