"""The optimal trajectory as two decoupled systems, one stable forward in time and one stable backward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import RedesignError
from invtrack.linear.scaling import balancing_scale
from invtrack.linear.state_space import StateSpace
from invtrack.plans.two_sided import DrivenSystem, Part, TwoSidedSystem
from invtrack.redesign.cost import Weights, square_root
from invtrack.redesign.double_double import DoubleDouble
from invtrack.redesign.paces import by_pace
from invtrack.redesign.riccati import QuadraticCost, optimal_feedback
from invtrack.references.generator import Generator

AXIS_TOLERANCE = 1e-6
"""A mode counts as lying on the imaginary axis within this share of |A|, balanced: rounding splits double modes by sqrt(eps)."""

HIDDEN_TOLERANCE = 1e-9
"""A mode counts as unweighted, or as beyond the inputs' reach, where its test's smallest singular value is below this share."""


@dataclass(frozen=True, eq=False)
class TrackedSystem:
    """x' = A x + B u, y = C x + D u, with any number of outputs: A (n, n), B (n, p), C (m, n), D (m, p)."""

    A: Array
    B: Array
    C: Array
    D: Array

    @classmethod
    def of(cls, models: Sequence[StateSpace]) -> TrackedSystem:
        """Models side by side, one input for all of them: states and outputs of the first, then of the second, and so on."""
        return cls(
            A=scipy.linalg.block_diag(*(model.A for model in models)),
            B=np.vstack([model.B for model in models]),
            C=scipy.linalg.block_diag(*(model.C for model in models)),
            D=np.vstack([model.D for model in models]),
        )


@dataclass(frozen=True, eq=False)
class Optimum:
    """[x; u; y; costate] = X_f z + X_b q + X_y y_d with z' = A_c z + E_f y_d and q' = -A_c'q + E_b y_d, A_c stable.

    z is integrated forward, q backward in time: the parts of `system`; what is continuous through a jump of the plant is
    [x; costate]. E_f, E_b (n, m), X_y (2 n + p + m, m); y_d (m,) may be the reference several times over.
    """

    system: TwoSidedSystem
    E_f: Array
    E_b: Array
    X_y: Array

    def driven(self, generator: Generator) -> DrivenSystem:
        """The optimum for a reference y_d = R w, w' = S w."""
        R = np.tile(generator.R, (self.E_f.shape[1] // len(generator.R), 1))
        return DrivenSystem(
            system=self.system,
            S=generator.S,
            D_f=self.E_f @ R,
            D_b=self.E_b @ R,
            X_w=self.X_y @ R,
            J_w=np.zeros((len(self.system.forward.J), R.shape[1])),
        )


def optimum(system: TrackedSystem, weights: Weights) -> Optimum:
    """Minimiser of the integral of u'R u + x'Q_x x + (y - y_d)'Q_y (y - y_d) over all of time, y = C x + D u.

    u = -K x - R_u^-1 (B's - D'Q_y y_d) with R_u = R + D'Q_y D and K = R_u^-1 (B'P + D'Q_y C), P the stabilizing solution of the
    Riccati equation; s' = -A_c's + (C - D K)'Q_y y_d, A_c = A - B K. s drives x; with A_c L + L A_c' = B R_u^-1 B' it no longer
    drives xi = x - L s, and each of the two runs in its own stable direction. The costate is P x + s. Both xi and s are stated in
    coordinates in which fast and slow modes are apart (`by_pace`).

    Raises RedesignError where no stabilizing solution exists. Sources: Devasia 1996 (AIAA note on output-trajectory redesign) for
    the problem; the solution is the linear-quadratic tracker.
    """
    state_unit, input_unit = _units(system, weights)
    A, C = DoubleDouble.of(system.A * state_unit / state_unit[:, None]), DoubleDouble.of(system.C * state_unit)
    into = DoubleDouble.of(input_unit)  # in these units R_u is the identity, to rounding
    B, D = DoubleDouble.of(system.B / state_unit[:, None]) @ into, DoubleDouble.of(system.D) @ into
    Q_y = DoubleDouble.of(weights.Q_y)
    problem = QuadraticCost(
        A=A,
        B=B,
        Q=DoubleDouble.of(state_unit[:, None] * weights.Q_x * state_unit) + C.transposed @ Q_y @ C,
        N=C.transposed @ Q_y @ D,
        R=into.transposed @ DoubleDouble.of(weights.R) @ into + D.transposed @ Q_y @ D,
    )
    _require_solvable(A.rounded, B.rounded, problem.Q.rounded, problem.N.rounded)
    feedback = optimal_feedback(problem)
    P, K, L, W = feedback.P, feedback.K, feedback.L, problem.inverse_weight()
    at = by_pace(feedback.A_c, feedback.schur)
    E_b = (C - D @ K).transposed @ Q_y
    E_f = B @ W @ D.transposed @ Q_y - L @ E_b
    direct = W @ D.transposed @ Q_y

    def values(x: DoubleDouble, u: DoubleDouble, costate: Array) -> Array:
        """Rows of [x; u; y; costate] in the units of the plant."""
        y = (C @ x + D @ u).rounded
        return np.vstack([state_unit[:, None] * x.rounded, (into @ u).rounded, y, costate / state_unit[:, None]])

    n = len(state_unit)

    def part(M: Array, x: DoubleDouble, u: DoubleDouble, costate: DoubleDouble) -> Part:
        rows = values(x, u, costate.rounded)
        return Part(M, rows, np.vstack([rows[:n], rows[-n:]]))

    driven = at.of_drives(L)
    forward = part(at.A, at.V, -at.of_states(K), at.of_states(P))
    backward = part(-at.A.T, driven, -(K @ driven) - W @ at.of_drives(B.transposed), P @ driven + at.U)
    # [x; costate] of z and q is symplectic, as all coordinates of a Hamiltonian system are: its inverse is its own blocks.
    apart = np.block([[backward.J[n:].T, -backward.J[:n].T], [-forward.J[n:].T, forward.J[:n].T]])
    nothing = np.zeros((n, len(system.D)))
    return Optimum(
        system=TwoSidedSystem(forward, backward, apart),
        E_f=at.of_drives(E_f.transposed).rounded.T,
        E_b=at.of_states(E_b.transposed).rounded.T,
        X_y=values(DoubleDouble.of(nothing), direct, nothing),
    )


def _units(system: TrackedSystem, weights: Weights) -> tuple[Array, Array]:
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
    modes = np.linalg.eigvals(A).astype(complex)
    unmoved = _hidden_mode(A.T, B.T, modes, unstable_too=True)
    if unmoved is not None:
        raise RedesignError(
            f"no optimal trajectory: no input moves the mode at {unmoved:.6g} rad/s, which lies on or right of the imaginary axis; "
            "choose inputs that reach it, or leave it out of the model (one input cannot bring to rest a mode that is the same in "
            "several models)"
        )
    # The input u = -N'x + v makes the cross term vanish; what is left of the cost must see the modes that are left on the axis.
    if np.any(N):
        A = A - B @ N.T
        modes = np.linalg.eigvals(A).astype(complex)
    unseen = _hidden_mode(A, square_root(Q - N @ N.T), modes, unstable_too=False)
    if unseen is not None:
        raise RedesignError(
            f"no optimal trajectory: neither Q_x nor Q_y weighs the mode at {unseen:.6g} rad/s on the imaginary axis, so nothing "
            "brings it back to rest; give it a weight, or leave it out of the model"
        )


def _hidden_mode(M: Array, rows: Array, modes: ComplexArray, *, unstable_too: bool) -> complex | None:
    """One of M's modes on the imaginary axis (or right of it) whose eigenvector the rows do not see (Hautus), or None."""
    # In units of the states that its own entries ask for: what weights and inputs make of the units must not move the axis.
    own_size = np.linalg.norm(scipy.linalg.matrix_balance(M, permute=False)[0], 2)
    on_axis = np.abs(modes.real) <= AXIS_TOLERANCE * own_size
    looked_at = on_axis | (unstable_too & (modes.real > 0))
    if not np.any(looked_at):
        return None
    size, row_size = np.linalg.norm(M, 2), np.linalg.norm(rows, 2)
    rows = rows * (size / row_size) if row_size > 0 else rows
    for mode, neutral in zip(modes[looked_at], on_axis[looked_at], strict=True):
        at = complex(0.0, mode.imag) if neutral else complex(mode)
        test = np.vstack([M - at * np.eye(len(M)), rows])
        if np.linalg.svd(test, compute_uv=False)[-1] <= HIDDEN_TOLERANCE * size:
            return at
    return None
