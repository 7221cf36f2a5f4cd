"""The optimal trajectory as two decoupled systems, one stable forward in time and one stable backward."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import RedesignError
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.redesign.cost import Weights, square_root
from invtrack.references.signal import Generator

AXIS_TOLERANCE = 1e-6
"""A mode counts as lying on the imaginary axis within this share of |A|: rounding splits double modes by sqrt(eps)."""

HIDDEN_TOLERANCE = 1e-9
"""A mode counts as unweighted, or as beyond the inputs' reach, where its test's smallest singular value is below this share."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """[x; u; y] = X_f xi + X_b s + X_y y_d with xi' = A_c xi + E_f y_d and s' = -A_c's + E_b y_d, A_c stable.

    xi is integrated forward, s backward in time: the parts of `system`; what is continuous through a jump of the plant is
    [x; costate]. E_f, E_b (n, p), X_y (n + 2 p, p).
    """

    system: TwoSidedSystem
    E_f: Array
    E_b: Array
    X_y: Array

    def driven(self, generator: Generator) -> DrivenSystem:
        """The optimum for a reference y_d = R w, w' = S w."""
        R = generator.R
        return DrivenSystem(
            system=self.system,
            S=generator.S,
            D_f=self.E_f @ R,
            D_b=self.E_b @ R,
            X_w=self.X_y @ R,
            J_w=np.zeros((len(self.system.forward.J), R.shape[1])),
        )


def optimum(system: StateSpace, weights: Weights) -> Optimum:
    """Minimiser of the integral of u'R u + x'Q_x x + (y - y_d)'Q_y (y - y_d) over all of time, y = C x + D u.

    u = -K x - R_u^-1 (B's - D'Q_y y_d) with R_u = R + D'Q_y D and K = R_u^-1 (B'P + D'Q_y C), P the stabilizing solution of the
    Riccati equation; s' = -A_c's + (C - D K)'Q_y y_d, A_c = A - B K. s drives x; with A_c L + L A_c' = B R_u^-1 B' it no longer
    drives xi = x - L s, and each of the two runs in its own stable direction.

    Raises RedesignError where no stabilizing solution exists. Sources: Devasia 1996 (AIAA note on output-trajectory redesign) for
    the problem; the solution is the linear-quadratic tracker.
    """
    state_unit, input_unit = _units(system, weights)
    A, C = system.A * state_unit / state_unit[:, None], system.C * state_unit
    B, D = system.B @ input_unit / state_unit[:, None], system.D @ input_unit  # in these units R_u is the identity
    Q_y = weights.Q_y
    Q, N = state_unit[:, None] * weights.Q_x * state_unit + C.T @ Q_y @ C, C.T @ Q_y @ D
    _require_solvable(A, B, Q, N)
    P = _riccati(A, B, Q, N)
    K = B.T @ P + N.T
    A_c = A - B @ K
    L = scipy.linalg.solve_continuous_lyapunov(A_c, B @ B.T)
    E_b = (C - D @ K).T @ Q_y
    E_f = B @ D.T @ Q_y - L @ E_b

    def values(x_rows: Array, u_rows: Array) -> Array:
        """Rows of [x; u; y] in the units of the plant."""
        return np.vstack([state_unit[:, None] * x_rows, input_unit @ u_rows, C @ x_rows + D @ u_rows])

    def continuous(x_rows: Array, costate_rows: Array) -> Array:
        return np.vstack([state_unit[:, None] * x_rows, costate_rows / state_unit[:, None]])

    identity = np.eye(len(A))
    apart = np.block([[identity + L @ P, -L], [-P, identity]])  # of [x; costate] = [I, L; P, P L + I] [xi; s]
    two_sided = TwoSidedSystem(
        forward=Part(A_c, values(identity, -K), continuous(identity, P)),
        backward=Part(-A_c.T, values(L, -K @ L - B.T), continuous(L, P @ L + identity)),
        T=apart * np.concatenate([1 / state_unit, state_unit]),
    )
    return Optimum(two_sided, E_f, E_b, values(np.zeros((len(A), len(D))), D.T @ Q_y))


def _units(system: StateSpace, weights: Weights) -> tuple[Array, Array]:
    """Units (n,) of the states in which no entry dwarfs the others, and (p, p) of the inputs in which R_u = 1."""
    R_u = weights.input_weight(system.D)
    scale = np.sqrt(np.diag(R_u))
    triangle = scipy.linalg.cholesky(R_u / np.outer(scale, scale), lower=True)
    input_unit = scipy.linalg.solve_triangular(triangle, np.eye(len(scale)), lower=True).T / scale[:, None]
    B = system.B @ input_unit
    seen = np.vstack([square_root(weights.Q_x), square_root(weights.Q_y) @ system.C])
    n, p, m = len(B), B.shape[1], len(seen)
    # States, inputs and what the cost sees form a loop: a state's unit follows from what drives it and from what it costs.
    loop = np.zeros((n + p + m, n + p + m))
    loop[:n, :n], loop[:n, n : n + p], loop[n : n + p, n + p :], loop[n + p :, :n] = system.A, B, 1.0, seen
    return balancing_scale(loop)[:n], input_unit


def _require_solvable(A: Array, B: Array, Q: Array, N: Array) -> None:
    """The two conditions for a stabilizing solution, with R_u = 1: stabilizable, and the cost sees every mode on the axis."""
    unmoved = _hidden_mode(A.T, B.T, unstable_too=True)
    if unmoved is not None:
        raise RedesignError(
            f"no optimal trajectory: no input moves the mode at {unmoved:.6g} rad/s, which lies on or right of the imaginary axis; "
            "choose inputs that reach it, or leave it out of the model"
        )
    # The input u = -N'x + v makes the cross term vanish; what is left of the cost must see the modes that are left on the axis.
    unseen = _hidden_mode(A - B @ N.T, square_root(Q - N @ N.T), unstable_too=False)
    if unseen is not None:
        raise RedesignError(
            f"no optimal trajectory: neither Q_x nor Q_y weighs the mode at {unseen:.6g} rad/s on the imaginary axis, so nothing "
            "brings it back to rest; give it a weight, or leave it out of the model"
        )


def _hidden_mode(M: Array, rows: Array, *, unstable_too: bool) -> complex | None:
    """A mode of M on the imaginary axis (or right of it) whose eigenvector the rows do not see (Hautus), or None."""
    size, row_size = np.linalg.norm(M, 2), np.linalg.norm(rows, 2)
    rows = rows * (size / row_size) if row_size > 0 else rows
    for mode in np.linalg.eigvals(M):
        on_axis = abs(mode.real) <= AXIS_TOLERANCE * size
        if not on_axis and not (unstable_too and mode.real > 0):
            continue
        at = complex(0.0, mode.imag) if on_axis else complex(mode)
        test = np.vstack([M - at * np.eye(len(M)), rows])
        if np.linalg.svd(test, compute_uv=False)[-1] <= HIDDEN_TOLERANCE * size:
            return at
    return None


def _riccati(A: Array, B: Array, Q: Array, N: Array) -> Array:
    """The stabilizing solution P of A'P + P A - (P B + N)(P B + N)' + Q = 0."""
    advice = "bring the weights and the units of the states closer to each other"
    try:
        P: Array = scipy.linalg.solve_continuous_are(A, B, Q, np.eye(B.shape[1]), s=N)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise RedesignError(f"the Riccati equation of the redesign has no stabilizing solution: {error}; {advice}") from error
    poles = np.linalg.eigvals(A - B @ (B.T @ P + N.T))
    if not np.max(poles.real) < 0:
        raise RedesignError(f"the optimal feedback does not stabilize: poles {np.round(poles, 6).tolist()}; {advice}")
    return P
