"""The normal form: outputs with their derivatives, and internal coordinates."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, as_divisor
from invtrack.errors import RelativeDegreeError
from invtrack.linear.output_derivatives import OutputDerivatives
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace, as_state_space
from invtrack.linear.state_units import plant_pace
from invtrack.linear.structure import OutputStructure, output_structure


@dataclass(frozen=True, eq=False)
class NormalForm:
    """The plant in coordinates zeta = C_star x (outputs and derivatives) and eta = N x (internal).

    chi = A_x x + B_y u with m inputs and p outputs, x = P zeta + V eta, so that T = [C_star; N] and T^-1 = [P V]. For a plant with
    a vector relative degree r, zeta holds y_i, y_i', ..., y_i^(r_i - 1) and chi the derivatives y_i^(r_i) (Isidori 1989; Devasia
    1996, eq. 5); in general both are combinations of the outputs' derivatives (see `OutputStructure`).

    Args:
        orders: how often each output is differentiated, with the sum rho; the vector relative degree (r_1, ..., r_p), if any.
        C_star, N: (rho, n) and (n - rho, n).
        P, V: (n, rho) and (n, n - rho).
        A_x, B_y: (p, n) and (p, m).
        A_x_error: what the errors of the model's entries make of A_x (p, n).
        zeta, chi: rho and p combinations of the outputs' derivatives.
        combined: whether outputs are combined, so that there is no vector relative degree.
        decoupling_condition: condition number of B_y with rows and columns scaled to unit size.
        units: of the states, in which V is orthonormal (n,).
    """

    orders: tuple[int, ...]
    C_star: Array
    N: Array
    P: Array
    V: Array
    A_x: Array
    B_y: Array
    A_x_error: Array
    zeta: OutputDerivatives
    chi: OutputDerivatives
    combined: bool
    decoupling_condition: float
    units: Array

    @property
    def relative_degree(self) -> tuple[int, ...] | None:
        """The vector relative degree (r_1, ..., r_p), None where there is none."""
        return None if self.combined else self.orders

    @property
    def derivatives(self) -> tuple[int, ...]:
        """Highest derivative of each output that the input needs (p,); the vector relative degree, where there is one."""
        return tuple(max(pair) for pair in zip(self.zeta.highest, self.chi.highest, strict=True))

    def tracking_law(self, R: Array | None = None) -> tuple[Array, Array, Array]:
        """F (m, n), G (m, p) and Z (m, m - p) of u = F x + G chi + Z v, the law that keeps exact tracking once it holds.

        v is free. With R (m, m), positive definite, F x + G chi is the least u'R u for which chi is what it is to be, and Z'R Z is
        the identity; unless stated inputs count in the units in which B_y's columns are of unit size.
        """
        n = self.A_x.shape[1]
        solved, Z = _inputs_for(self.B_y, np.hstack([-self.A_x, np.eye(len(self.B_y))]), R)
        return solved[:, :n], solved[:, n:], Z


def relative_degree(system: Any) -> tuple[int, ...]:
    """Vector relative degree (r_1, ..., r_p): how often each output must be differentiated until an input appears.

    system: StateSpace, or anything with A, B, C, D.

    Raises ModelError for a malformed model, RelativeDegreeError where the outputs have no vector relative degree (their derivatives
    must be combined before the inputs can be found from them), or no inverse at all.
    """
    form = normal_form(system)
    if form.combined:
        outputs = as_state_space(system).outputs.names
        raise RelativeDegreeError(
            f"the outputs {list(outputs)} have no vector relative degree: where inputs first appear, their gains depend on each "
            f"other. An inverse exists all the same; it takes derivatives of the outputs up to the orders {form.derivatives} (see "
            "invtrack.linear.normal_form), and invtrack.invert finds it"
        )
    return form.orders


def normal_form(system: Any) -> NormalForm:
    """Normal form of `system`, internal coordinates orthonormal after balancing the states.

    system: StateSpace, or anything with A, B, C, D. Raises ModelError for a malformed model, RelativeDegreeError where its transfer
    matrix has no (right) inverse.
    """
    system = as_state_space(system)
    found = output_structure(system)
    units = balancing_scale(_couplings(system, found))
    P, V, N = _internal_coordinates(units, found.C_star)
    return NormalForm(
        orders=found.orders,
        C_star=found.C_star,
        N=N,
        P=P,
        V=V,
        A_x=found.A_x,
        B_y=found.B_y,
        A_x_error=found.A_x_error,
        zeta=found.zeta,
        chi=found.chi,
        combined=found.combined,
        decoupling_condition=found.decoupling_condition,
        units=units,
    )


def _couplings(system: StateSpace, structure: OutputStructure) -> Array:
    """How strongly each state acts on each other (n, n), through the plant and the tracking law; free of the channels' units.

    The plant alone may fall apart into parts that do not act on each other (chains of integrators), which could not be balanced:
    the law that holds an output makes chi of it, as fast as the plant is.
    """
    held = plant_pace(system) ** np.array(structure.orders, dtype=float)
    solved, _ = _inputs_for(structure.B_y, np.hstack([structure.A_x, np.eye(len(structure.B_y))]))
    law = np.abs(solved[:, : system.n_states]) + np.abs(solved[:, system.n_states :]) @ (held[:, None] * np.abs(system.C))
    return np.asarray(np.abs(system.A) + np.abs(system.B) @ law)


def _inputs_for(B_y: Array, wanted: Array, R: Array | None = None) -> tuple[Array, Array]:
    """U (m, k) of the least tr U'R U with B_y U = wanted, B_y (p, m) of full row rank, and Z (m, m - p) with B_y Z = 0, Z'R Z = I.

    Unless R (m, m) is stated, inputs count in the units in which B_y's columns are of unit size.
    """
    p, m = B_y.shape
    # In rows and columns of unit size: the channels' units, far apart, would pass for a singular matrix.
    row = np.max(np.abs(B_y), axis=1, keepdims=True)
    column = as_divisor(np.max(np.abs(B_y / row), axis=0))
    if m == p:
        return scipy.linalg.solve(B_y / row / column, wanted / row) / column[:, None], np.zeros((m, 0))
    weight = np.diag(column**2) if R is None else R
    scale = np.sqrt(np.diag(weight))
    # u = S w with S'R S = I, in which the least w is the one at right angles to the free ones.
    S = scipy.linalg.solve_triangular(scipy.linalg.cholesky(weight / np.outer(scale, scale)), np.eye(m)) / scale[:, None]
    Q, T = np.linalg.qr((B_y / row @ S).T, mode="complete")
    return S @ Q[:, :p] @ scipy.linalg.solve_triangular(T[:p].T, wanted / row, lower=True), S @ Q[:, p:]


def _internal_coordinates(units: Array, C_star: Array) -> tuple[Array, Array, Array]:
    """P, V, N with C_star P = I, C_star V = 0, N P = 0, N V = I; V orthonormal in these units of the states (n,)."""
    n, rho = len(units), len(C_star)
    scaled = C_star * units
    row_size = np.linalg.norm(scaled, axis=1, keepdims=True)
    Q, R = np.linalg.qr((scaled / row_size).T, mode="complete") if rho else (np.eye(n), np.zeros((n, 0)))
    V = Q[:, rho:]
    P = scipy.linalg.solve_triangular(R[:rho], Q[:, :rho].T).T  # (R^-1 Q')' = Q R^-T, the pseudoinverse of R' Q'
    return units[:, None] * (P / row_size.T), units[:, None] * V, (V / units[:, None]).T
