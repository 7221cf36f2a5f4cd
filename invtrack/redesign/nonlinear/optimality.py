"""Whether a motion is stationary for its cost: the costate along it, worked out anew, and what it says of every input."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import RedesignError
from invtrack.plans.runge_kutta import Steps
from invtrack.redesign.nonlinear.costed import CostedMotions, Course, quadrature_shares
from invtrack.redesign.nonlinear.ends import solve_semidefinite
from invtrack.redesign.nonlinear.sweep import Step

LARGEST_GAP = 1e-6
"""Share of its cost that inputs near by may take off a plan that is handed out."""


@dataclass(frozen=True)
class Stationarity:
    """What other inputs near by could take off the cost of a motion, to second order, as shares of it.

    With the costate of the motion, lambda' = -A'lambda - Q_x (x - x_rest) - C'Q_y (y - y_d), the cost changes by 2 r'v per second
    for any small change v of the input, r = R (u - u_rest) + D'Q_y (y - y_d) + B'lambda. No v takes more off the cost, but for the
    curvature of the dynamics, than the integral of r'(R + D'Q_y D)^-1 r.

    Args:
        inputs: that integral over the window; for inputs that are held, of the mean of r over each hold.
        start: what another departure from rest, before the window, could take off.
        elements: the share of each element of the mesh in `inputs` (N,).
    """

    inputs: float
    start: float
    elements: Array

    def require(self) -> None:
        """Raises RedesignError for a motion of which it is not certain that no other one near by costs less."""
        if not self.total <= LARGEST_GAP:
            raise RedesignError(
                f"the motion found may not be the one of least cost: by its costate inputs near by could take {self.total:.1e} off "
                f"the cost (at most {LARGEST_GAP:.0e} is accepted); bring the weights closer to each other, or take a shorter hold"
            )

    @property
    def total(self) -> float:
        """What all of them could take off."""
        return self.inputs + self.start


def stationarity(motions: CostedMotions, course: Course, step: Step, cost: float) -> Stationarity:
    """That of a motion, by the adjoint equation in continuous time.

    A, B, C and D come from central differences along an integration with steps of half the length. Small changes of the input are
    counted around the feedback u = -K x of the quadratic model: the costate then obeys lambda' = -(A - B K)'lambda - ... + K'(...),
    which does not grow backward in time however unstable the plant is, and the same r comes out where r is zero.

    Args:
        motions, course: the conditions, and the motion.
        step: that would still be taken, with its feedback; between nodes P is interpolated.
        cost: of the motion.
    """
    P = step.P
    fine = replace(motions.scheme, refinement=2 * motions.scheme.refinement)
    S, weights, held = motions.scheme.steps, motions.weights, motions.scheme.count == 1
    nodes = _nodes(motions, course, fine.integration)
    u = np.einsum("kim,ji->kjm", course.motion.coefficients, fine.basis[::2])
    A, B, C, D = motions.derivatives(nodes, u, rough=False)
    x, v, e = motions.departures(nodes, u, motions.outputs(nodes, u), middles=True)
    share = np.linspace(0.0, 1.0, 2 * S + 1)[:, None, None]
    along = P[:-1, None] * (1 - share) + P[1:, None] * share
    D_Q = np.swapaxes(D, -1, -2) @ weights.Q_y
    R_u = weights.R + D_Q @ D
    K = np.linalg.solve(R_u, np.swapaxes(B, -1, -2) @ along + D_Q @ C)
    K = np.zeros_like(K) if held else K  # held inputs answer the state at the start of their hold
    direct = v @ weights.R + (D_Q @ e[..., None])[..., 0]  # r without the costate
    drive = x @ weights.Q_x + (np.swapaxes(C, -1, -2) @ (e @ weights.Q_y)[..., None])[..., 0]
    drive = drive - (np.swapaxes(K, -1, -2) @ direct[..., None])[..., 0]
    back, offset = _backward(np.swapaxes(A - B @ K, -1, -2), drive, motions.mesh.lengths)
    end, shares = motions.ends[1], quadrature_shares(S)
    costate = np.empty((len(A), S + 1, len(P[0])))
    behind = end.state_weight @ end.away(course.motion.points[-1])
    for k in range(len(A) - 1, -1, -1):
        costate[k] = back[k] @ behind + offset[k]
        behind = costate[k, 0]
        if held:
            mean = shares @ (direct[k, ::2] + np.einsum("jab,ja->jb", B[k, ::2], costate[k]))
            behind = behind - motions.mesh.lengths[k] * mean @ step.K[k]
    r = direct[:, ::2] + (np.swapaxes(B[:, ::2], -1, -2) @ costate[..., None])[..., 0]
    if held:
        r = np.repeat(np.einsum("j,kjm->km", shares, r)[:, None], S + 1, axis=1)
    gain = np.sum(r * np.linalg.solve(R_u[:, ::2], r[..., None])[..., 0], axis=2) @ shares * motions.mesh.lengths
    start = motions.ends[0]
    slope = start.tail_weight @ course.v + start.X.T @ behind
    saved = slope @ solve_semidefinite(start.tail_weight + start.X.T @ P[0] @ start.X, slope)
    scale = 1 / cost if cost > 0 else 0.0
    return Stationarity(float(np.sum(gain)) * scale, float(saved) * scale, gain * scale)


def _nodes(motions: CostedMotions, course: Course, steps: Steps) -> Array:
    motion, lengths = course.motion, motions.mesh.lengths
    return motions.joined(
        motions.by_interval(
            lambda dynamics, chosen: dynamics.motion(
                motion.points[:-1][chosen], motion.coefficients[chosen], steps, lengths[chosen]
            )
        )
    )


def _backward(M: Array, drive: Array, lengths: Array) -> tuple[Array, Array]:
    """Costates at the ends of S steps from that at an element's end, of lambda' = -M lambda - drive: (N, S + 1, n, n), (.., n).

    M, drive: at the ends and middles of the steps (N, 2 S + 1, n, n) and (N, 2 S + 1, n).
    """
    N, instants, n = drive.shape
    S = (instants - 1) // 2
    Z = np.zeros((N, n, n + 1))
    Z[:, :, :n] = np.eye(n)
    back, offset = np.empty((N, S + 1, n, n)), np.zeros((N, S + 1, n))
    back[:, S] = np.eye(n)
    h = (lengths / S)[:, None, None]

    def slope(at: int, Z: Array) -> Array:
        k = M[:, at] @ Z
        k[:, :, n] += drive[:, at]
        return np.asarray(k)

    for step in range(S - 1, -1, -1):
        first = slope(2 * step + 2, Z)
        second = slope(2 * step + 1, Z + h / 2 * first)
        third = slope(2 * step + 1, Z + h / 2 * second)
        fourth = slope(2 * step, Z + h * third)
        Z = Z + h / 6 * (first + 2 * second + 2 * third + fourth)
        back[:, step], offset[:, step] = Z[:, :, :n], Z[:, :, n]
    return back, offset
