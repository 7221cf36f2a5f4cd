"""The Francis regulator: the constant map from an exosystem's state to the plant's state and input."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from invtrack.arrays import Array, ComplexArray, real_numbers
from invtrack.errors import InversionError, TrajectoryError
from invtrack.inversion.inverse_system import require_square
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace, as_state_space
from invtrack.linear.switched import as_switched

CONDITION_LIMIT = 1e13
"""Largest condition number, in the best of units, of [A - s I, B; C, D] at an exosystem mode s that is not called a plant zero."""


@dataclass(frozen=True, eq=False)
class Regulator:
    """x = Pi x_e, u = Gamma x_e, with the residuals of the two equations that they solve.

    Args:
        Pi, Gamma: (n, q) and (p, q).
        dynamics_residual: largest entry of Pi A_e - A Pi - B Gamma, relative to the size of the terms that it is the sum of.
        output_residual: that of C Pi + D Gamma - C_e, relative likewise.
        conditioning: largest condition number among the equations solved, in the best of units.
    """

    Pi: Array
    Gamma: Array
    dynamics_residual: float
    output_residual: float
    conditioning: float


def francis(system: Any, A_e: ArrayLike, C_e: ArrayLike) -> Regulator:
    """The regulator Pi A_e = A Pi + B Gamma, C Pi + D Gamma = C_e of a plant for the exosystem x_e' = A_e x_e, y_d = C_e x_e.

    system: StateSpace or anything with A, B, C, D. A_e (q, q), C_e (p, q). The solution is unique when no mode of the exosystem is
    a zero of the plant. Found column by column in the exosystem's Schur coordinates: (A - s_j I) pi_j + B gamma_j = known,
    C pi_j + D gamma_j = known, one system of n + p equations per mode s_j.

    Raises InversionError where a mode meets a zero, with both; TrajectoryError where shapes do not fit. Source: Francis 1977;
    Devasia, Paden, Rossi 1996, section 3.
    """
    plant = as_state_space(system)
    require_square(as_switched(plant), "francis")
    A_x, C_x = (np.atleast_2d(real_numbers(name, value)) for name, value in (("A_e", A_e), ("C_e", C_e)))
    q = len(A_x)
    if not (np.all(np.isfinite(A_x)) and np.all(np.isfinite(C_x))):
        raise TrajectoryError("A_e or C_e has entries that are not finite")
    if A_x.shape != (q, q) or C_x.shape != (plant.n_outputs, q) or not q:
        raise TrajectoryError(
            f"expected A_e (q, q) and C_e ({plant.n_outputs}, q) for the outputs {list(plant.outputs.names)}, got {A_x.shape} and "
            f"{C_x.shape}"
        )
    scale = balancing_scale(A_x, within_parts=True)  # x_e in units of its own: exact, and undone in the end
    triangle, Q = scipy.linalg.schur(A_x * scale / scale[:, None], output="complex")
    columns, conditioning = _columns(plant, triangle, (C_x * scale) @ Q)
    solution = np.real(columns @ Q.conj().T) / scale
    Pi, Gamma = solution[: plant.n_states], solution[plant.n_states :]
    sides = (Pi @ A_x, plant.A @ Pi, plant.B @ Gamma), (plant.C @ Pi, plant.D @ Gamma, C_x)
    terms = (
        np.abs(Pi) @ np.abs(A_x) + np.abs(plant.A) @ np.abs(Pi) + np.abs(plant.B) @ np.abs(Gamma),
        np.abs(plant.C) @ np.abs(Pi) + np.abs(plant.D) @ np.abs(Gamma) + np.abs(C_x),
    )
    return Regulator(
        Pi=Pi,
        Gamma=Gamma,
        dynamics_residual=_relative(sides[0][0] - sides[0][1] - sides[0][2], terms[0]),
        output_residual=_relative(sides[1][0] + sides[1][1] - sides[1][2], terms[1]),
        conditioning=conditioning,
    )


def _columns(plant: StateSpace, triangle: ComplexArray, C_q: ComplexArray) -> tuple[ComplexArray, float]:
    """[Pi; Gamma] (n + p, q) in the exosystem's Schur coordinates, and the largest condition number met."""
    n, q = plant.n_states, len(triangle)
    pencil = np.block([[plant.A, plant.B], [plant.C, plant.D]])
    mass = np.zeros_like(pencil)
    mass[:n, :n] = np.eye(n)
    columns = np.zeros((len(pencil), q), dtype=complex)
    worst = 1.0
    for j in range(q):
        matrix = pencil - triangle[j, j] * mass
        known = np.concatenate([columns[:n, :j] @ triangle[:j, j], C_q[:, j]])
        condition, inverse = np.inf, np.zeros_like(matrix)
        try:
            inverse = np.linalg.solve(matrix, np.eye(len(matrix)))
            # The spectral radius of |M^-1| |M| is the condition number that the best scaling of rows and columns reaches.
            condition = float(np.max(np.abs(np.linalg.eigvals(np.abs(inverse) @ np.abs(matrix)))))
        except np.linalg.LinAlgError:
            pass
        if not condition < CONDITION_LIMIT:
            raise InversionError(_resonance(pencil, mass, complex(triangle[j, j]), condition))
        worst = max(worst, condition)
        columns[:, j] = np.linalg.solve(matrix, known)
    return columns, worst


def _resonance(pencil: Array, mass: Array, mode: complex, condition: float) -> str:
    values = scipy.linalg.eigvals(pencil, mass)
    zeros = values[np.isfinite(values)]
    size = float(max(np.max(np.abs(pencil)), abs(mode)))
    shown = format_zeros([complex(mode.real, abs(mode.imag))], size)
    nearest = "" if not zeros.size else format_zeros([_upper(zeros[int(np.argmin(np.abs(zeros - mode)))])], size)
    return (
        f"no (unique) regulator: the exosystem's mode at {shown} meets the plant's zero at {nearest or 'every frequency'} "
        f"(condition number {condition:.1e}, limit {CONDITION_LIMIT:.0e}), so its output would need an unbounded or an "
        "undetermined state; change the exosystem's mode, or the outputs"
    )


def _upper(value: complex) -> complex:
    return complex(value.real, abs(value.imag))


def _relative(residual: Array, terms: Array) -> float:
    size = np.max(terms, initial=0.0)
    return float(np.max(np.abs(residual) / np.where(terms > 1e-3 * size, terms, size if size > 0 else 1.0), initial=0.0))
