"""How dear inputs are to an inverse that has a choice among them: (u - u_rest)'R (u - u_rest), and what the rest takes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, as_divisor, real_weight
from invtrack.errors import InversionError
from invtrack.linear.state_space import StateSpace
from invtrack.linear.state_units import plant_units
from invtrack.linear.switched import SwitchedSystem

HELD_RANK = 1e-10
"""Singular values of [A, B; C, D] below this share of the largest are none, rows and columns scaled to unit size."""


ROUNDING = 10.0
"""Rounding of a solution, in units of eps times the condition number and its size."""


@dataclass(frozen=True, eq=False)
class InputMeasure:
    """R (m, m), positive definite, in 1 / (units of the inputs) squared, and how a remark calls inputs so weighed."""

    R: Array
    wording: str

    def size(self, u: Array) -> Array:
        """Rows w (k, m) with w'w = u'R u of inputs u (k, m)."""
        scale = np.sqrt(np.diag(self.R))
        return np.asarray((u * scale) @ scipy.linalg.cholesky(self.R / np.outer(scale, scale)).T)


def input_measure(plant: SwitchedSystem, R: ArrayLike | None) -> InputMeasure:
    """The measure that R (m, m) states, a number standing for that multiple of the identity.

    Where nothing is stated, inputs count by the ranges that the model allows them, each range alike (Bryson's rule); without limits
    in their units, if these are the same.

    Raises InversionError for what is no positive definite weight, and where it must be stated.
    """
    m, names = plant.n_inputs, list(plant.inputs.names)
    if R is not None:
        return InputMeasure(real_weight("R", R, m, meaning=f"inputs {names}", definite=True, error=InversionError), "weighed by R")
    ranges = np.diff(plant.input_limits, axis=1)[:, 0]
    if np.all(np.isfinite(ranges) & (ranges > 0)):
        return InputMeasure(np.diag((2 / ranges) ** 2), "each weighed by its range")
    if len(set(plant.inputs.units)) > 1 and plant.n_inputs > plant.n_outputs:
        raise InversionError(
            f"{m} inputs {names} for {plant.n_outputs} output(s) leave a choice, and inputs in the units "
            f"{list(plant.inputs.units)} cannot be compared: state what they cost, in 1 / (unit squared), for instance R="
            f"np.diag([{', '.join(['1.0'] * m)}]), or the limits of all of them (input_limits of the model, ctrlrange in MJCF)"
        )
    return InputMeasure(np.eye(m), "all weighed alike")


def held_inputs(system: StateSpace, R: Array) -> Array:
    """N_u (m, p) of u = N_u y, of the inputs that hold each output at one the ones with the least u'R u.

    A x + B u = 0 and C x + D u = y for some x; zero where some output cannot be held.
    """
    n, m, p = system.n_states, system.n_inputs, system.n_outputs
    units, scale = plant_units(system), 1 / np.sqrt(np.diag(R))
    into = scipy.linalg.solve_triangular(scipy.linalg.cholesky(R * np.outer(scale, scale)), np.eye(m)) * scale[:, None]
    columns = scipy.linalg.block_diag(np.diag(units), into)  # states in their units, inputs in those in which R is the identity
    pencil = np.block([[system.A, system.B], [system.C, system.D]]) @ columns
    rows = as_divisor(np.max(np.abs(pencil), axis=1))
    U, sizes, Vh = np.linalg.svd(pencil / rows[:, None])
    rank = int(np.sum(sizes > HELD_RANK * sizes[0]))
    wanted = np.vstack([np.zeros((n, p)), np.eye(p)]) / rows[:, None]
    if np.any(np.abs(U[:, rank:].T @ wanted) > np.sqrt(HELD_RANK) * np.linalg.norm(wanted, axis=0)):
        return np.zeros((m, p))
    found = Vh[:rank].T @ ((U[:, :rank].T @ wanted) / sizes[:rank, None])
    free = Vh[rank:, n:].T
    least = found[n:] - free @ np.linalg.lstsq(free, found[n:], rcond=None)[0] if free.shape[1] else found[n:]
    rounding = ROUNDING * np.finfo(float).eps * sizes[0] / sizes[rank - 1] * np.linalg.norm(found, axis=0)
    return np.asarray(into @ np.where(np.abs(least) <= rounding, 0.0, least))
