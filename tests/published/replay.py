"""Integration of a plant under a plan's input, independent of how the plan was found."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from invtrack.plans.plan import Plan

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

STAGES = 12
"""Gauss points of a step: the method has order 24."""

STEP = 1.0
"""Longest step, in units of 1 / |z| of the zeros z whose motion is still felt at its place."""

FADED = 32.0
"""At this many time constants 1 / |Re z| from the nearest breakpoint a mode is no longer felt."""

GROWTH = 6.0
"""A plant is started anew from the planned state before errors, as shares of the states' peaks, have grown to exp of this."""

IDLE = 1e-10
"""A state that stays below this share of the largest one is idle, and measured against that."""


@dataclass(frozen=True)
class Replay:
    """How far the integrated motion is from what the plan promises, as a share of the terms that it is the sum of.

    The terms of a state are the motions under each input alone and from the state in which its stretch began; those of an output
    are |C| of them and |D| |u|. Where they cancel, even an input that is right to rounding gives no better.

    output_error, state_error: largest distance of an output from the wanted one and of a state from the planned one.
    stretches: a plant in which errors do not grow is integrated in one, from rest at the plan's start to its end.
    """

    output_error: float
    state_error: float
    stretches: int


def replay(plan: Plan, zeros: Complex) -> Replay:
    """Integrate x' = A x + B u under the plan's input by Gauss collocation, in steps that suit the plant's zeros [rad/s].

    Of a step in which an unstable plant would outgrow its start, only the end is taken.
    """
    (system,) = plan.model.distinct
    A, B, C, D = system.A, system.B, system.C, system.D
    n, p = B.shape
    nodes, inner_weights, weights = _gauss()
    unstable = max(float(np.max(np.linalg.eigvals(A).real)), 0.0)
    starts, ends = _steps(plan, zeros)
    starts = np.maximum(starts, ends - 1 / unstable) if unstable > 0 else starts
    lengths, middle = ends - starts, np.repeat((starts + ends) / 2, STAGES)
    times = (starts[:, None] + lengths[:, None] * nodes).ravel()
    u = plan.inputs(times, inside=middle).reshape(-1, STAGES, p)
    wanted = plan.reference(times, inside=middle).reshape(-1, STAGES, p)
    planned, planned_end = plan.states(starts), plan.states(ends)
    driven = np.concatenate([u[:, :, None] * B, np.zeros((*u.shape[:2], n, 1))], axis=3)  # by each input alone, and by none
    x, reached, stretches = np.zeros((n, p + 1)), starts[0], 1
    begun, rates, ended = np.empty((len(starts), n, p + 1)), np.empty(driven.shape), np.empty((len(starts), n, p + 1))
    solvers: dict[str, Array] = {}
    size = np.max(np.abs(planned), axis=0)
    size = np.where(size > IDLE * np.max(size), size, np.max(size))
    carried = np.eye(n)
    for k, h in enumerate(lengths):
        if starts[k] > reached or np.max(np.abs(carried) @ size / size) > np.exp(GROWTH):
            x, carried, stretches = np.column_stack([np.zeros((n, p)), planned[k]]), np.eye(n), stretches + 1
        length = f"{h:.11e}"  # steps that differ by rounding share their factors
        if length not in solvers:
            solvers[length] = np.linalg.inv(np.eye(STAGES * n) - h * np.kron(inner_weights, A))
        begun[k], free = x, (driven[k] + A @ x).reshape(STAGES * n, p + 1)
        rates[k] = (solvers[length] @ free).reshape(STAGES, n, p + 1)
        ended[k] = x = x + h * np.tensordot(weights, rates[k], axes=1)
        within = (solvers[length] @ np.tile(A @ carried, (STAGES, 1))).reshape(STAGES, n, n)
        carried = carried + h * np.tensordot(weights, within, axes=1)
        reached = ends[k]
    inner = begun[:, None] + lengths[:, None, None, None] * np.einsum("ij,kjnp->kinp", inner_weights, rates)
    off = np.max(np.abs(inner.sum(axis=3) @ C.T + u @ D.T - wanted), axis=(0, 1))
    x_terms = np.sum(np.abs(inner), axis=3)
    y_terms = np.max(x_terms @ np.abs(C).T + np.abs(u) @ np.abs(D).T, axis=(0, 1))
    peak = np.max(x_terms, axis=(0, 1))
    size = np.where(peak > IDLE * np.max(peak), peak, np.max(peak))
    return Replay(float(np.max(off / y_terms)), float(np.max(np.abs(ended.sum(axis=2) - planned_end) / size)), stretches)


def _gauss() -> tuple[Array, Array, Array]:
    """Nodes c_i in (0, 1), the integrals from 0 to c_i of the Lagrange polynomials (i, j), and those from 0 to 1."""
    nodes, weights = np.polynomial.legendre.leggauss(STAGES)
    series = np.linalg.inv(np.polynomial.legendre.legvander(nodes, STAGES - 1))  # column j: the Lagrange polynomial of node j
    integrals = np.polynomial.legendre.legval(nodes, np.polynomial.legendre.legint(series, lbnd=-1)).T
    return (nodes + 1) / 2, integrals / 2, weights / 2


def _steps(plan: Plan, zeros: Complex) -> tuple[Array, Array]:
    """Starts and ends of steps from the plan's start to its end, none across a breakpoint."""
    corners = np.unique(np.concatenate([[plan.start], plan.breakpoints, [plan.end]]))
    edges = [corners[:1]]
    for left, right in pairwise(corners):
        distances = _distances(right - left, zeros)
        ways = []
        if left in plan.breakpoints:
            ways.append(left + distances)
        if right in plan.breakpoints:
            ways.append(right - distances)
        if len(ways) == 2:
            middle = (left + right) / 2
            ways = [ways[0][ways[0] < middle], ways[1][ways[1] > middle], np.array([middle])]
        inner = np.sort(np.concatenate(ways))
        edges += [inner[(inner > left) & (inner < right)], np.array([right])]
    all_edges = np.concatenate(edges)
    return all_edges[:-1], all_edges[1:]


def _distances(length: float, zeros: Complex) -> Array:
    """Distances from a breakpoint at which steps end, up to the whole length."""
    reach, distances = 0.0, []
    while reach < length:
        felt = np.abs(zeros.real) * reach < FADED
        reach += min(length / 8, STEP / float(np.max(np.abs(zeros[felt]), initial=STEP / length)))
        distances.append(reach)
    return np.array(distances)
