"""Which zeros of a plant are hidden modes: modes that no input moves, or that no output shows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray
from invtrack.linear.staircase import unreached
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units

ZeroKind = Literal["transmission zero", "uncontrollable mode", "unobservable mode", "uncontrollable and unobservable mode"]
"""Transmission zeros act on the transfer function; the others are decoupling zeros: input, output, input-output (Rosenbrock)."""

COUPLING_TOLERANCE = 1e-10
"""A coupling counts as none below this share of the norm of A in balanced states, or of an input's column or an output's row."""

ERROR_GROWTH = 10.0
"""How much larger than the errors of the model's entries the couplings may be that they cause: each step passes errors on."""

SHARED_TOLERANCE = 1e-7
"""An uncontrollable and an unobservable subspace share modes where the cosine between them is above this."""


def zero_kinds(system: StateSpace, zeros: ComplexArray) -> tuple[ZeroKind, ...]:
    """The kind of each of `zeros`, the invariant zeros of a `system` with at least as many inputs as outputs.

    A zero s is an uncontrollable mode where rank [A - s I, B] < n and an unobservable one where rank [A - s I; C] < n; each such
    mode is a zero, but for unobservable ones of a plant with more inputs than outputs, which inputs left over move. Of several
    equal zeros as many are called hidden as there are hidden modes, a number that the rank alone does not tell: the modes come from
    staircase forms (P. Van Dooren, IEEE Trans. Automatic Control 26, 1981), and they are paired with zeros such that the distances
    add up to the least.
    """
    modes = hidden_modes(system)
    if system.n_inputs > system.n_outputs:
        modes = [(value, kind) for value, kind in modes if kind != "unobservable mode"]
    kinds: list[ZeroKind] = ["transmission zero"] * len(zeros)
    values = np.array([value for value, _ in modes], dtype=complex)
    for zero, mode in zip(*scipy.optimize.linear_sum_assignment(np.abs(zeros[:, None] - values[None, :])), strict=True):
        kinds[zero] = modes[mode][1]
    return tuple(kinds)


def hidden_modes(system: StateSpace) -> list[tuple[complex, ZeroKind]]:
    """The eigenvalues of A that belong to modes which no input moves or no output shows, each as often as it is hidden."""
    hidden = hidden_subspaces([system])
    A = in_units(system, hidden.units)[0]
    left, both, right = hidden.parts
    blocks: list[tuple[Array, ZeroKind]] = [
        (left, "uncontrollable mode"),
        (both, "uncontrollable and unobservable mode"),
        (right, "unobservable mode"),
    ]
    return [(complex(value), kind) for basis, kind in blocks for value in np.linalg.eigvals(basis.T @ A @ basis)]


@dataclass(frozen=True, eq=False)
class HiddenSubspaces:
    """Where hidden modes are, by orthonormal bases in states x / units.

    Args:
        units: of the states, powers of two (n,).
        unreached: complement of what the inputs reach (n, h): w' x with w in it obeys a system of its own, which no input enters.
        unseen: states that no output shows (n, k), which stay among themselves.
    """

    units: Array
    unreached: Array
    unseen: Array

    @property
    def parts(self) -> tuple[Array, Array, Array]:
        """Bases of what is only unreached, of what is unseen and cannot be reached, and of what is reached but unseen."""
        U, cosines, Vh = np.linalg.svd(self.unreached.T @ self.unseen)
        shared = int(np.sum(cosines > SHARED_TOLERANCE))
        return self.unreached @ U[:, shared:], self.unseen @ Vh[:shared].T, self.unseen @ Vh[shared:].T


def hidden_subspaces(systems: Sequence[StateSpace]) -> HiddenSubspaces:
    """What no input of any of the systems reaches, and what none of their outputs shows, whichever of them holds when."""
    units = np.exp2(np.rint(np.mean([np.log2(plant_units(system)) for system in systems], axis=0)))
    judged = [couplings(system, units) for system in systems]
    return HiddenSubspaces(
        units=units,
        unreached=unreached([A for A, _, _ in judged], np.hstack([B for _, B, _ in judged])),
        unseen=unreached([A.T for A, _, _ in judged], np.hstack([C.T for _, _, C in judged])),
    )


def couplings(system: StateSpace, units: Array) -> tuple[Array, Array, Array]:
    """A (n, n), B (n, p) and C (p, n) in states x / units, each divided by the largest singular value that counts as no coupling.

    That is a share of the norm of A, of an input's column, of an output's row, or what the errors of the model's entries amount to.
    """
    A, B, C = in_units(system, units)
    B_size, C_size = _nonzero(np.linalg.norm(B, axis=0)), _nonzero(np.linalg.norm(C, axis=1, keepdims=True))
    A_size = _nonzero(np.linalg.norm(A))
    A_error = ERROR_GROWTH * float(np.linalg.norm(system.errors("A") * units / units[:, None] / A_size))
    B_error = ERROR_GROWTH * float(np.linalg.norm(system.errors("B") / units[:, None] / B_size))
    C_error = ERROR_GROWTH * float(np.linalg.norm(system.errors("C") * units / C_size))
    sizes = ((A, A_size, A_error), (B, B_size, B_error), (C, C_size, C_error))
    A, B, C = (M / size / max(COUPLING_TOLERANCE, error) for M, size, error in sizes)
    return A, B, C


def in_units(system: StateSpace, units: Array) -> tuple[Array, Array, Array]:
    """A, B and C in states x / units."""
    return system.A * units / units[:, None], system.B / units[:, None], system.C * units


def _nonzero(size: ArrayLike) -> Array:
    return np.where(np.asarray(size) > 0, size, 1.0)
