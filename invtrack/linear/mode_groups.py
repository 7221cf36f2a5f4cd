"""Modes that no input moves or no signal shows, equal ones together, with the states that take part in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.linear.hidden_modes import hidden_subspaces, in_units
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.state_space import StateSpace

EQUAL = 1e-6
"""Eigenvalues within this share of the norm of A, in balanced states, are one repeated eigenvalue."""

ROUNDING = 1e-12
"""Of k equal eigenvalues the mean is on the axis where it is within the k-th root of this share of the norm of A."""

TAKES_PART = 0.1
"""A state takes part in a mode where its share, in balanced states, is at least this one of the largest."""

LISTED = 6
"""States that a text names at most."""


@dataclass(frozen=True)
class ModeGroup:
    """Equal modes, and their conjugates. values: their eigenvalues [rad/s]; states: names of those that take part, most first.

    side: -1 left of the imaginary axis, 1 right of it, 0 where they cannot be told from modes on it.
    """

    values: tuple[complex, ...]
    states: tuple[str, ...]
    side: int

    @property
    def eigenvalues(self) -> str:
        """The eigenvalues as text: "0, 0", "-0.5+-3j"."""
        return format_zeros(self.values)

    @property
    def state_list(self) -> str:
        """The states as text."""
        more = len(self.states) - LISTED
        return ", ".join(self.states[:LISTED]) + (f" and {more} more" if more > 0 else "")

    def __str__(self) -> str:
        return f"{'mode' if len(self.values) == 1 or self._is_pair else 'modes'} {self.eigenvalues} (of {self.state_list})"

    @property
    def _is_pair(self) -> bool:
        return len(self.values) == 2 and self.values[0].imag != 0


def listed(groups: Sequence[ModeGroup]) -> str:
    """Groups of modes as text: "the mode 0 (of cart), the mode -0.5+-3j (of arm, arm velocity)"."""
    return ", ".join(f"the {group}" for group in groups)


def unmoved_modes(system: StateSpace) -> tuple[ModeGroup, ...]:
    """The modes that no input moves; of the combination of states that is left to itself those with a large share take part."""
    hidden = hidden_subspaces([system])
    A = in_units(system, hidden.units)[0]
    return _groups(hidden.unreached, (hidden.unreached.T @ A @ hidden.unreached).T, A, system)


def unseen_modes(system: StateSpace) -> tuple[ModeGroup, ...]:
    """The modes that no output shows; the states that move most in them take part."""
    hidden = hidden_subspaces([system])
    A = in_units(system, hidden.units)[0]
    return _groups(hidden.unseen, hidden.unseen.T @ A @ hidden.unseen, A, system)


def _groups(basis: Array, block: Array, A: Array, system: StateSpace) -> tuple[ModeGroup, ...]:
    """The eigenvalues of a block (h, h), equal ones together, by their invariant subspace: states `basis` (n, h) times it."""
    size, left, found = float(np.linalg.norm(A)), list(np.linalg.eigvals(block)), []
    while left:
        centre = left[0]

        def equal(value: complex, centre: complex = centre) -> bool:
            return bool(np.hypot(value.real - centre.real, abs(value.imag) - abs(centre.imag)) <= EQUAL * size)

        values = [value for value in left if equal(value)]
        left = [value for value in left if not equal(value)]
        subspace = scipy.linalg.schur(block, output="real", sort=lambda re, im, equal=equal: equal(complex(re, im)))[1]
        share = np.linalg.norm(basis @ subspace[:, : len(values)], axis=1)
        order = [i for i in np.argsort(-share, kind="stable") if share[i] >= TAKES_PART * np.max(share)]
        real, imag = float(np.mean(np.real(values))), float(np.mean(np.abs(np.imag(values))))
        pairs = len(values) // 2 if imag > EQUAL * size else 0
        axis = size * ROUNDING ** (1 / (pairs or len(values)))
        mean = complex(real if abs(real) > axis else 0.0, imag if pairs else 0.0)
        equal_values = (mean, mean.conjugate()) * pairs if pairs else (mean,) * len(values)
        found.append(ModeGroup(equal_values, tuple(system.states.names[i] for i in order), int(np.sign(mean.real))))
    return tuple(sorted(found, key=lambda group: -group.values[0].real))
