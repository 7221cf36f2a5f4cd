"""How far a trajectory can be from the least cost: the gap to a bound from below that its costate gives, from values alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array, Indices
from invtrack.plans.quadrature import quadrature_nodes
from invtrack.plans.trajectory import Trajectory
from invtrack.redesign.cost import Weights, square_root
from invtrack.redesign.optimum import TrackedSystem
from invtrack.references.signal import PiecewiseSignal


@dataclass(frozen=True)
class DualityGap:
    """By how much any other input could cost less, each as a share of the cost.

    For any costate lambda whose adjoint equation holds with some multipliers the dual value is a bound from below on the cost of
    all inputs. What lies between the cost and that bound is the sum of:

    stationarity: integral of r'(R + D'Q_y D)^-1 r, r = R u + D'Q_y (y - y_d) + B'lambda.
    adjoint: what the residual of lambda' = -A'lambda - Q_x x - C'Q_y (y - y_d) costs: as a change of the multipliers Q_x x and
    Q_y (y - y_d) where they can take it up, as work on the state where they cannot.
    dynamics: work of the residual of x' = A x + B u on the costate.
    joints: work of jumps of the costate at breakpoints and of what is left of it at the ends.

    All are worked out from values and derivatives of the trajectory, and know nothing of how it was found.
    """

    stationarity: float
    adjoint: float
    dynamics: float
    joints: float

    @property
    def total(self) -> float:
        """Largest share of the cost by which any other input could cost less."""
        return self.stationarity + self.adjoint + self.dynamics + self.joints


@dataclass(frozen=True, eq=False)
class Conditions:
    """What an optimal trajectory [x; u; y; costate] over all of time is held against.

    Args:
        systems: of each interval of the plant.
        interval: the interval in which each piece of the trajectory lies (m + 2,).
        weights: of the cost.
        wanted: the wanted outputs as deviations, with the trajectory's breakpoints; held by every model of a system side by side.
        shifts: by how much the states jump at each breakpoint with the rest that they are measured from (m + 1, n).
    """

    systems: Sequence[TrackedSystem]
    interval: Indices
    weights: Weights
    wanted: PiecewiseSignal
    shifts: Array

    def gap(self, trajectory: Trajectory) -> DualityGap:
        """The gap between the trajectory's cost and the bound that its costate gives."""
        times, piece, share = quadrature_nodes(trajectory)
        values, slopes = trajectory(times, piece), trajectory.derivative()(times, piece)
        n, p = self.systems[0].B.shape
        at = self.wanted(times, inside=self._inside(piece))
        wanted = np.tile(at, (1, len(self.systems[0].C) // at.shape[1]))
        cost = stationarity = dynamics = 0.0
        adjoint = np.zeros(0)
        unit = np.max(np.abs(values[:, :n]), axis=0)
        unit = np.where(unit > 0, unit, 1.0)
        distinct = {id(system): system for system in self.systems}  # as one integral over all intervals of a system
        number = {key: k for k, key in enumerate(distinct)}
        which = np.array([number[id(system)] for system in self.systems])[self.interval[piece]]
        for k, system in enumerate(distinct.values()):
            here = which == k
            weight = share[here]
            x, u, y, costate = np.split(values[here], [n, n + p, len(values[0]) - n], axis=1)
            error = y - wanted[here]
            cost += float(weight @ self.weights.rate(x, u, error))
            Q_y_e = error @ self.weights.Q_y
            r = u @ self.weights.R + Q_y_e @ system.D + costate @ system.B
            stationarity += float(weight @ np.sum(r * _solve(self.weights.input_weight(system.D), r), axis=1))
            lag = slopes[here][:, :n] - x @ system.A.T - u @ system.B.T
            dynamics += float(2 * np.abs(weight @ np.sum(lag * costate, axis=1)))
            rest = slopes[here][:, -n:] + costate @ system.A + x @ self.weights.Q_x + Q_y_e @ system.C
            adjoint = _added(adjoint, self._adjoint_terms(system, rest * unit, x / unit, unit, weight))
        joints = self._joints(trajectory, n)
        scale = 1 / cost if cost > 0 else 0.0
        return DualityGap(stationarity * scale, float(np.sum(adjoint)) * scale, dynamics * scale, joints * scale)

    def _adjoint_terms(self, system: TrackedSystem, rest: Array, x: Array, unit: Array, weight: Array) -> Array:
        """What each direction of the adjoint residual costs (k + 1,), states in `unit`; the last: what no multiplier takes up."""
        seen = np.vstack([square_root(self.weights.Q_x), square_root(self.weights.Q_y) @ system.C]) * unit
        seen = seen[np.any(seen, axis=1)]
        _, size, directions = np.linalg.svd(seen, full_matrices=False)
        residual, state = rest @ directions.T, x @ directions.T
        work = 2 * np.abs(weight @ (residual * state))
        taken_up = weight @ (residual / np.where(size > 0, size, 1.0)) ** 2
        unmoved = np.sum((rest - residual @ directions) * (x - state @ directions), axis=1)
        return np.append(np.where(size > 0, np.minimum(work, taken_up), work), 2 * abs(weight @ unmoved))

    def _joints(self, trajectory: Trajectory, n: int) -> float:
        """Twice the work of the costate's jumps on the state and of the state's jumps on the costate, at all breakpoints."""
        edges = trajectory.breakpoints
        at = np.arange(len(edges))
        left, right = trajectory(edges, at), trajectory(edges, at + 1)
        jump, mean = right - left, (left + right) / 2
        work = np.sum(jump[:, -n:] * mean[:, :n], axis=1), np.sum((jump[:, :n] - self.shifts) * mean[:, -n:], axis=1)
        return float(2 * np.sum(np.abs(work)))

    def _inside(self, piece: Indices) -> Array:
        """A time within each piece."""
        return self.wanted.inner_times()[piece]


def _added(total: Array, more: Array) -> Array:
    return more if len(total) == 0 else np.append(total, more)


def _solve(weight: Array, r: Array) -> Array:
    """Rows weight^-1 r."""
    scale = 1 / np.sqrt(np.diag(weight))
    solution: Array = scipy.linalg.solve(weight * np.outer(scale, scale), (r * scale).T, assume_a="pos").T
    return solution * scale
