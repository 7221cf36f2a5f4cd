"""Vector relative degree and the normal form: outputs with their derivatives, and internal coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import RelativeDegreeError
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace, as_state_space

ROW_TOLERANCE = 1e-11
"""A row C_i A^k B counts as zero where it is below this share of |C_i| |A|^k |B|, the largest value its terms could add up to."""

ROUNDING = 10.0
"""Rounding that the matrices may have come with, in units of n eps times their norms in balanced units."""

DECOUPLING_CONDITION_LIMIT = 1e10
"""Largest condition number of B_y, rows and columns scaled to unit size, with which it still counts as invertible."""


@dataclass(frozen=True, eq=False)
class NormalForm:
    """The plant in coordinates zeta = C_star x (outputs and derivatives) and eta = N x (internal).

    y^(r) = A_x x + B_y u, x = P zeta + V eta, so that T = [C_star; N] and T^-1 = [P V] (Isidori 1989; Devasia 1996, eq. 5).

    Args:
        relative_degree: (r_1, ..., r_p), with the sum rho.
        C_star, N: (rho, n) and (n - rho, n).
        P, V: (n, rho) and (n, n - rho).
        A_x, B_y: (p, n) and (p, p).
        decoupling_condition: condition number of B_y with rows and columns scaled to unit size.
    """

    relative_degree: tuple[int, ...]
    C_star: Array
    N: Array
    P: Array
    V: Array
    A_x: Array
    B_y: Array
    decoupling_condition: float

    def tracking_law(self) -> tuple[Array, Array]:
        """F (p, n) and G (p, p) of u = F x + G y_d^(r), the law that keeps exact tracking once it holds."""
        F: Array = -scipy.linalg.solve(self.B_y, self.A_x)
        G: Array = scipy.linalg.solve(self.B_y, np.eye(len(self.B_y)))
        return F, G


def relative_degree(system: Any) -> tuple[int, ...]:
    """Vector relative degree (r_1, ..., r_p): how often each output must be differentiated until an input appears.

    system: StateSpace, or anything with A, B, C, D.

    Raises ModelError for a malformed model, RelativeDegreeError where an output is reached by no input, or where B_y (p, p) is
    singular or too ill-conditioned.
    """
    return normal_form(system).relative_degree


def normal_form(system: Any) -> NormalForm:
    """Normal form of `system`, internal coordinates orthonormal after balancing the states.

    system: StateSpace, or anything with A, B, C, D. Raises ModelError for a malformed model, RelativeDegreeError as
    `relative_degree` does.
    """
    system = as_state_space(system)
    degrees, star_rows, A_rows, B_rows = [], [], [], []
    scale = _state_units(system)
    for i in range(system.n_channels):
        rows, last, gain = _differentiate_output(system, i, scale)
        degrees.append(len(rows))
        star_rows.extend(rows)
        A_rows.append(last)
        B_rows.append(gain)
    B_y = np.array(B_rows)
    condition = _decoupling_condition(system, B_y, degrees)
    C_star = np.array(star_rows).reshape(-1, system.n_states)
    P, V, N = _internal_coordinates(couplings(system, np.array(A_rows), B_y), C_star)
    return NormalForm(tuple(degrees), C_star, N, P, V, np.array(A_rows), B_y, condition)


def _state_units(system: StateSpace) -> Array:
    """Units (n,) of the states in which they, inputs and outputs act on each other with similar strength."""
    n, p = system.B.shape
    loop = np.block(
        [[system.A, system.B, np.zeros((n, p))], [np.zeros((p, n + p)), np.ones((p, p))], [system.C, np.zeros((p, 2 * p))]]
    )
    return balancing_scale(loop)[:n]


def _differentiate_output(system: StateSpace, i: int, scale: Array) -> tuple[list[Array], Array, Array]:
    """Rows C_i, C_i A, ... below the relative degree; then the row C_i A^r and the gain of the inputs in y_i^(r).

    Besides what rounding does here, there is what it did before: in turned coordinates B has entries that would be zero, and where
    C_i picks just these, nothing is left to measure them against. C_i B is therefore also measured against norms, in the units
    `scale` of the states. Not so C_i A^k B: a long chain passes on less than the rounding of the norms, and yet exactly.
    """
    A, B = system.A, system.B
    eps = ROUNDING * system.n_states * np.finfo(float).eps
    rounding = eps * np.linalg.norm(system.C[i] * scale) * np.linalg.norm(B / scale[:, None], axis=0)
    errors = system.error_estimates
    A_error, B_error, C_error = (errors.get(name, 0.0) for name in "ABC")
    row, size = system.C[i], np.abs(system.C[i])
    error = np.full(system.n_states, C_error)
    gain, gain_size, gain_error = system.D[i], np.abs(system.D[i]), np.full(system.n_channels, errors.get("D", 0.0))
    rows: list[Array] = []
    while np.all(np.abs(gain) <= ROW_TOLERANCE * gain_size + gain_error):
        if len(rows) == system.n_states:
            raise RelativeDegreeError(
                f"output {system.outputs.names[i]!r} is not reached by any input (C_i A^k B vanishes for all "
                f"k < {system.n_states}); choose another output, or another actuator"
            )
        rows.append(row)
        gain, gain_size = row @ B, size @ np.abs(B)
        gain_error = error @ np.abs(B) + np.abs(row).sum() * B_error + (rounding if len(rows) == 1 else 0.0)
        row, size, error = row @ A, size @ np.abs(A), error @ np.abs(A) + np.abs(row).sum() * A_error
    # y_i^(r) = C_i A^r x + (C_i A^(r-1) B) u: `row` has just been advanced to C_i A^r. Inputs that only rounding lets in are left
    # out: scaled up to unit size, a column of rounding errors would pass for an independent input.
    return rows, row, np.where(np.abs(gain) <= ROW_TOLERANCE * gain_size + gain_error, 0.0, gain)


def _decoupling_condition(system: StateSpace, B_y: Array, degrees: list[int]) -> float:
    scaled = B_y.copy()
    for axis in (1, 0, 1):  # alternate: rows and columns to unit size, so that units do not matter
        size = np.max(np.abs(scaled), axis=axis, keepdims=True)
        scaled = scaled / np.where(size > 0, size, 1.0)
    condition = float(np.linalg.cond(scaled))
    if not condition < DECOUPLING_CONDITION_LIMIT:
        raise RelativeDegreeError(
            f"no vector relative degree: the outputs {list(system.outputs.names)} differentiated {degrees} times give a B_y with "
            f"condition number {condition:.1e} (limit {DECOUPLING_CONDITION_LIMIT:.0e}), so the inputs {list(system.inputs.names)} "
            "cannot set the outputs independently; choose other outputs, or delay an input by integrators in front of it"
        )
    return condition


def couplings(system: StateSpace, A_x: Array, B_y: Array) -> Array:
    """How strongly each state acts on each other (n, n), through the plant and the tracking law; free of the channels' units.

    The plant alone may fall apart into parts that do not act on each other (chains of integrators), which could not be balanced.
    """
    law = np.abs(np.linalg.solve(B_y, A_x)) + np.abs(np.linalg.solve(B_y, np.eye(len(B_y)))) @ np.abs(system.C)
    return np.asarray(np.abs(system.A) + np.abs(system.B) @ law)


def _internal_coordinates(couplings: Array, C_star: Array) -> tuple[Array, Array, Array]:
    """P, V, N with C_star P = I, C_star V = 0, N P = 0, N V = I; V orthonormal in states balanced to `couplings`."""
    n, rho = len(couplings), len(C_star)
    scale = balancing_scale(couplings)
    scaled = C_star * scale
    row_size = np.linalg.norm(scaled, axis=1, keepdims=True)
    Q, R = np.linalg.qr((scaled / row_size).T, mode="complete") if rho else (np.eye(n), np.zeros((n, 0)))
    V = Q[:, rho:]
    P = scipy.linalg.solve_triangular(R[:rho], Q[:, :rho].T).T  # (R^-1 Q')' = Q R^-T, the pseudoinverse of R' Q'
    return scale[:, None] * (P / row_size.T), scale[:, None] * V, (V / scale[:, None]).T
