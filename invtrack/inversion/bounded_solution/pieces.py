"""The inverse on one piece: exact tracking law and split internal dynamics, driven by the reference's generator."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from invtrack.errors import InversionError
from invtrack.linear.internal_dynamics import SplitDynamics
from invtrack.linear.state_space import StateSpace
from invtrack.plans.plan import TwoSidedGenerator
from invtrack.references.signal import Generator

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class InversePiece:
    """Matrices of the inverse of one plant for references from one generator w' = S w.

    z_s' = A_s z_s + D_s w, z_u' = A_u z_u + D_u w, zeta = Z w. steady_s, steady_u: the bounded particular solutions z = steady w
    that hold where the generator runs on for ever (the equilibrium, where it holds a constant); zero for a piece that ends, which
    may well excite a zero of the plant. inside, before, after: the two-sided generators of [x; u; y] within the manoeuvre, before
    and after it.
    """

    D_s: Array
    D_u: Array
    Z: Array
    steady_s: Array
    steady_u: Array
    inside: TwoSidedGenerator
    before: TwoSidedGenerator
    after: TwoSidedGenerator


@dataclass(frozen=True, eq=False)
class Correction:
    """The term v = feedback V eta + feedforward [zeta_d; y_d^(r)] of u = B_y^-1 (y_d^(r) - A_x x + v), which gives up exactness.

    feedback (p, n) acts on the state's distance V eta from P zeta_d, feedforward (p, rho + p) on the wanted output's derivatives.
    """

    feedback: Array
    feedforward: Array


def inverse_piece(
    system: StateSpace, split: SplitDynamics, generator: Generator, *, endless: bool, correction: Correction | None = None
) -> InversePiece:
    """Inverse of `system` for outputs y_d = R w, w' = S w.

    With x = P zeta + V eta and u = B_y^-1 (y_d^(r) - A_x x + v), v = 0 without a correction (Devasia 1996, eqs. 7-9 and 12;
    Devasia, Paden, Rossi 1996, eqs. 3-5).
    """
    form = split.internal.form
    derivatives = [generator.derivative(k) for k in range(max(form.relative_degree) + 1)]
    zeta_rows = [derivatives[k][i] for i, r in enumerate(form.relative_degree) for k in range(r)]
    Z = np.array(zeta_rows).reshape(-1, len(generator.S))
    highest = np.array([derivatives[r][i] for i, r in enumerate(form.relative_degree)])
    drive = np.vstack([Z, highest])
    D_s, D_u = split.G_s @ drive, split.G_u @ drive
    steady_s, steady_u = np.zeros_like(D_s), np.zeros_like(D_u)
    if endless:
        steady_s, steady_u = _steady(split.A_s, D_s, generator), _steady(split.A_u, D_u, generator)

    F, G = form.tracking_law()

    def values(x_rows: Array, y_r_rows: Array) -> Array:
        """Rows of [x; u; y] from those of x and of y_d^(r) + v."""
        u_rows = F @ x_rows + G @ y_r_rows
        return np.vstack([x_rows, u_rows, system.C @ x_rows + system.D @ u_rows])

    if correction is None:
        correction = Correction(np.zeros_like(F), np.zeros((len(G), len(drive))))
    x_s, x_u = form.V @ split.W_s, form.V @ split.W_u
    from_s, from_u = values(x_s, correction.feedback @ x_s), values(x_u, correction.feedback @ x_u)
    from_w = values(form.P @ Z, highest + correction.feedforward @ drive)
    forward, backward = _augmented(split.A_s, D_s, generator.S), _augmented(split.A_u, D_u, generator.S)
    none, no_columns = np.zeros((0, 0)), np.zeros((len(from_w), 0))
    return InversePiece(
        D_s=D_s,
        D_u=D_u,
        Z=Z,
        steady_s=steady_s,
        steady_u=steady_u,
        inside=TwoSidedGenerator(forward, np.hstack([from_s, from_w]), backward, np.hstack([from_u, np.zeros_like(from_w)])),
        before=TwoSidedGenerator(none, no_columns, backward, np.hstack([from_u, from_w + from_s @ steady_s])),
        after=TwoSidedGenerator(forward, np.hstack([from_s, from_w + from_u @ steady_u]), none, no_columns),
    )


def _augmented(A: Array, D: Array, S: Array) -> Array:
    return np.block([[A, D], [np.zeros((len(S), len(A))), S]])


def _steady(A: Array, D: Array, generator: Generator) -> Array:
    """The solution X of A X - X S = -D: z = X w solves z' = A z + D w. Zeros off the axis and S on it make it unique."""
    if not D.size:
        return np.zeros_like(D)
    if not np.any(generator.S):
        equilibrium: Array = -scipy.linalg.solve(A, D)
        return equilibrium
    shared = np.min(np.abs(np.linalg.eigvals(A)[:, None] - np.linalg.eigvals(generator.S)[None, :]))
    if shared <= 1e-12 * (np.linalg.norm(A) + np.linalg.norm(generator.S)):
        raise InversionError(
            "a mode of the reference coincides with a zero of the plant, so it has no bounded response on an interval without end; "
            "change the reference's mode or hold the output before and after the manoeuvre"
        )
    steady: Array = scipy.linalg.solve_sylvester(A, -generator.S, -D)
    return steady
