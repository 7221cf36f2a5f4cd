"""Which zeros of the inverse are moved, and where to."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from numbers import Complex

import numpy as np
from numpy.typing import NDArray

from invtrack.arguments import items
from invtrack.arrays import Array, ComplexArray, Indices, complex_numbers, real_number, shown, whole_number
from invtrack.errors import InversionError, NonHyperbolicError
from invtrack.linear.hidden_modes import zero_kinds
from invtrack.linear.internal_dynamics import AXIS_TOLERANCE, REMEDIES, InternalDynamics, format_zeros, on_axis
from invtrack.linear.state_space import StateSpace

NAME_TOLERANCE = 1e-3
"""A zero named by a user is the one within this share of its magnitude: four digits, as printed, are enough."""

REPEATED_TOLERANCE = 1e-6
"""Zeros closer than this share of the largest are one repeated zero, which is moved as a whole: rounding splits it."""

UNMOVED_TOLERANCE = 1e-8
"""A zero that is to go no farther than this share of its magnitude stays: a gain for it would disturb other outputs for nothing."""


@dataclass(frozen=True, eq=False)
class Wish:
    """What is asked of the zeros: `move` says where named ones go; or those within `axis_distance` of the axis get `real_part`.

    All in rad/s.
    """

    move: Mapping[complex, complex] | None
    axis_distance: float | None
    real_part: float | None

    def __post_init__(self) -> None:
        if (self.move is None) == (self.axis_distance is None) or (self.axis_distance is None) != (self.real_part is None):
            raise InversionError(
                "expected either move={zero: where it goes} or both axis_distance=... and real_part=...; got "
                f"move={shown(self.move)}, axis_distance={shown(self.axis_distance)}, real_part={shown(self.real_part)}"
            )
        for name, value in (("axis_distance", self.axis_distance), ("real_part", self.real_part)):
            if value is not None:
                real_number(name, value, unit="rad/s", error=InversionError)
        if self.axis_distance is not None and not self.axis_distance >= 0:
            raise InversionError(f"axis_distance must not be negative, got {self.axis_distance}")
        if self.move is None:
            return
        if not isinstance(self.move, Mapping) or not all(isinstance(s, Complex) for pair in self.move.items() for s in pair):
            raise InversionError(f"move must be {{zero: where it goes}}, complex numbers [rad/s], got {shown(self.move)}")
        complex_numbers("move", [*self.move, *self.move.values()], error=InversionError)

    def require_known(self, zeros: ComplexArray) -> None:
        """Raises InversionError for a name that fits none of `zeros`, those of all intervals in which zeros are moved."""
        near = _near(zeros)
        for name in map(complex, self.move or {}):
            if not _fits(zeros, near, name):
                raise InversionError(
                    f"no zero at {_shown(name)} to move (to within {NAME_TOLERANCE:g} of its magnitude); the zeros are "
                    f"{format_zeros(zeros) or 'none'}"
                )

    def named(self, zeros: ComplexArray) -> tuple[NDArray[np.bool_], ComplexArray]:
        """Which of `zeros` are meant, and where to they are to go: (n_z,) mask and (n_z,) poles, the other ones as they are.

        Raises InversionError for a real zero that is to become a complex one or the reverse, for one that is sent to two places,
        and for a place on the imaginary axis.
        """
        moved, targets, near = np.zeros(len(zeros), dtype=bool), zeros.copy(), _near(zeros)
        imag = _imaginary_parts(zeros, near)
        if self.axis_distance is not None and self.real_part is not None:
            moved = np.abs(zeros.real) <= self.axis_distance
            targets[moved] = self.real_part + 1j * imag[moved]
        for name, target in (self.move or {}).items():
            for chosen, goal in _named(zeros, imag, near, complex(name), complex(target)):
                if np.any(moved[chosen] & (targets[chosen] != goal)):
                    raise InversionError(
                        f"the zero at {_shown(zeros[chosen[0]])} is to go to two places, {_shown(targets[chosen[0]])} and "
                        f"{_shown(goal)}; name it once, its conjugate and repetitions are implied"
                    )
                moved[chosen], targets[chosen] = True, goal
        _require_places(targets[moved])
        return moved, targets

    def targets(self, zeros: ComplexArray) -> tuple[NDArray[np.bool_], ComplexArray]:
        """Those of the zeros `named` that are to go elsewhere, and where to; all others, and those hardly moved, as they are."""
        (moved, targets), near = self.named(zeros), _near(zeros)
        imag = _imaginary_parts(zeros, near)
        moved &= np.abs(targets - zeros) > UNMOVED_TOLERANCE * np.abs(zeros)
        targets[~moved] = zeros[~moved]
        for i in np.flatnonzero(~moved):  # one that differs by rounding alone has no subspace of its own: it moves along
            partners = np.flatnonzero(moved & (np.abs(zeros - zeros[i]) <= near))
            if partners.size:
                moved[i], targets[i] = True, targets[partners[0]].real + 1j * imag[i]
        return moved, targets


def _require_places(places: ComplexArray) -> None:
    if not np.all(np.isfinite(places)) or np.any(np.abs(places.real) <= AXIS_TOLERANCE * np.abs(places)):
        raise InversionError(
            "zeros must be moved off the imaginary axis (to the right: preactuation, to the left: postactuation), got "
            f"{', '.join(f'{place:.4g}' for place in places)}"
        )


def intervals_named(interval: int | Sequence[int] | None, count: int) -> list[int]:
    """The intervals in which zeros are moved, all of them for None. Raises InversionError for those that the plant has not."""
    if interval is None:
        return list(range(count))
    expected = f"one interval from 0 to {count - 1} or a list of such"
    given = items("interval", interval, expected=expected, error=InversionError) if isinstance(interval, Iterable) else [interval]
    if not given:
        raise InversionError(f"interval must be {expected}, got an empty list")
    return sorted({whole_number("interval", k, highest=count - 1, error=InversionError) for k in given})


def _shown(zero: complex) -> str:
    return format_zeros(complex(zero.real, abs(zero.imag)))


def _near(zeros: ComplexArray) -> float:
    return REPEATED_TOLERANCE * float(np.max(np.abs(zeros), initial=0.0))


def _imaginary_parts(zeros: ComplexArray, near: float) -> Array:
    """Those of the zeros (n_z,) that repeated ones share: rounding splits a real one into a pair, and a pair into several."""
    shared = np.array([np.mean(zeros.imag[np.abs(zeros - zero) <= near]) for zero in zeros])
    return np.where(np.abs(shared) > near, shared, 0.0)


def _fits(zeros: ComplexArray, near: float, name: complex) -> bool:
    return bool(np.min(np.abs(zeros - name), initial=np.inf) <= max(NAME_TOLERANCE * abs(name), near))


def _named(zeros: ComplexArray, imag: Array, near: float, name: complex, target: complex) -> list[tuple[Indices, complex]]:
    """The zeros (repeated ones together) that a name means, and their conjugates, with their targets; none where it fits none."""
    if not _fits(zeros, near, name):
        return []
    zero = zeros[np.argmin(np.abs(zeros - name))]
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


def require_movable(
    system: StateSpace, internal: InternalDynamics, moved: NDArray[np.bool_], *, interval: int, endless: bool
) -> None:
    """Raises InversionError for zeros that no input moves, NonHyperbolicError for those left on the axis of an endless interval.

    Args:
        system: the plant in the interval.
        internal: its internal dynamics.
        moved: which of its zeros are moved (n_z,).
        interval: number of the interval, for the message.
        endless: whether it is the first or the last one.
    """
    left = on_axis(internal) & ~moved & endless
    if not np.any(left) and not np.any(moved):
        return
    kinds = np.array(zero_kinds(system, internal.zeros))
    fixed, size = moved & np.char.startswith(kinds, "uncontrollable"), float(np.max(np.abs(internal.zeros)))
    if np.any(fixed):
        which = "; ".join(
            f"{format_zeros(internal.zeros[fixed & (kinds == kind)], size)}: {kind}, {REMEDIES[kind]}"
            for kind in np.unique(kinds[fixed])
        )
        raise InversionError(f"interval {interval}: zeros that no input moves cannot be moved in the inverse either: {which}")
    if np.any(left):
        raise NonHyperbolicError(
            f"interval {interval}: zeros at {format_zeros(internal.zeros[left], size)} lie on the imaginary axis and are not "
            "moved, so the bounded inverse does not exist or is not unique before or after the manoeuvre; move them too"
        )
