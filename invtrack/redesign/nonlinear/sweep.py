"""The best step of Gauss-Newton's method: a Riccati recursion backward over the elements, in time linear in their number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.redesign.nonlinear.costed import CostedMotions, Course, Quadratics


@dataclass(frozen=True, eq=False)
class Step:
    """Changes of inputs' coefficients dc = -k - K dx, dx the change of the state at an element's start, and of v where it starts.

    Args:
        K, k: (N, s m, n) and (N, s m).
        dv: (n,).
        P, p: what is still to come from each node on costs dx'P dx + 2 p'dx more (N + 1, n, n), (N + 1, n); p is the costate there.
        decrease: what the whole step takes off the cost, by the quadratic model.
    """

    K: Array
    k: Array
    dv: Array
    P: Array
    p: Array
    decrease: float


def best_step(motions: CostedMotions, course: Course) -> Step:
    """The step to the least cost of the quadratic model; gaps between elements are closed by it.

    The recursion is that of the discrete linear-quadratic regulator in Joseph's form, in which P stays positive semidefinite.

    Raises LinAlgError for what is no number.
    """
    model, after = motions.quadratics(course.motion, motions.linearized(course.motion)), motions.ends[1]
    N, n = model.gaps.shape
    P, p = np.empty((N + 1, n, n)), np.empty((N + 1, n))
    K, k = np.empty((N, model.H.shape[1] - n, n)), np.empty((N, model.H.shape[1] - n))
    P[N], p[N] = after.state_weight, after.state_weight @ after.away(course.motion.points[-1])
    decrease = 0.0
    for at in range(N - 1, -1, -1):
        K[at], k[at], P[at], p[at], taken = _carried(model, at, P[at + 1], p[at + 1])
        decrease += taken
    before = motions.ends[0]
    gap = motions.difference(before.point(course.v)[None], course.motion.points[:1])[0]
    dv = before.step(course.v, P[0], p[0], gap)
    slope = before.tail_weight @ course.v + before.X.T @ (p[0] + P[0] @ gap)
    return Step(K, k, dv, P, p, decrease - float(slope @ dv))


def _carried(model: Quadratics, at: int, P: Array, p: Array) -> tuple[Array, Array, Array, Array, float]:
    """K, k, and P, p before an element from those behind it, and what the element's step takes off the cost."""
    F, G, H, g, gap = model.F[at], model.G[at], model.H[at], model.g[at], model.gaps[at]
    n = len(F)
    behind = p + P @ gap
    Q_cc, Q_cx, q_c = H[n:, n:] + G.T @ P @ G, H[n:, :n] + G.T @ P @ F, g[n:] + G.T @ behind
    unit = 1 / np.sqrt(np.diag(Q_cc))
    factor = scipy.linalg.cho_factor(Q_cc * np.outer(unit, unit), check_finite=True)
    solved = unit[:, None] * scipy.linalg.cho_solve(factor, unit[:, None] * np.column_stack([Q_cx, q_c]), check_finite=False)
    K, k = solved[:, :n], solved[:, n]
    closed, to_end = np.vstack([np.eye(n), -K]), F - G @ K
    before = closed.T @ H @ closed + to_end.T @ P @ to_end
    return K, k, (before + before.T) / 2, closed.T @ g + to_end.T @ behind, float(q_c @ k)
