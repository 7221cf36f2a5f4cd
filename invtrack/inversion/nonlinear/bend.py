"""Outputs bent away from those wanted, by as little as puts chosen internal motions to rest: B-splines, and the border they add."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # loads scipy.interpolate and scipy.sparse at their first use
import scipy.linalg

from invtrack.arrays import Array, ComplexArray, Indices
from invtrack.inversion.nonlinear.elements import Scheme
from invtrack.inversion.nonlinear.ends import End
from invtrack.inversion.nonlinear.mesh import Mesh
from invtrack.references.profiles import piecewise_polynomial
from invtrack.references.signal import PiecewiseSignal

SETTLED = 1e-2
"""A bend that would still change by this share of itself is as small as it gets, to within the square of that."""


@dataclass(frozen=True, eq=False)
class Bumps:
    """The cardinal B-splines phi_j of one degree on even knots, j = 1 ... J: zero before the first knot and after the last one.

    With weights a (J, p) output i is bent by sum_j a_ji phi_j, whose first degree - 1 derivatives are continuous everywhere.

    Args:
        knots: K + 1 even times [s], K > degree.
        degree: of the polynomials between knots.
        scale: sizes of the outputs at which their bends count alike (p,).
    """

    knots: Array
    degree: int
    scale: Array

    @property
    def count(self) -> int:
        """J, of each output's B-splines."""
        return len(self.knots) - 1 - self.degree

    @property
    def spacing(self) -> float:
        """Of the knots [s]."""
        return float(self.knots[-1] - self.knots[0]) / (len(self.knots) - 1)

    @cached_property
    def gram(self) -> Array:
        """Integrals over time of phi_j phi_(j + k), k = 0 ... degree, in the rows of a lower band (degree + 1, J) [s].

        B-splines of degree d convolved with each other are those of degree 2 d + 1.
        """
        d = self.degree
        product = scipy.interpolate.BSpline.basis_element(np.arange(2 * d + 3), extrapolate=False)
        return np.repeat(self.spacing * product(d + 1.0 + np.arange(d + 1))[:, None], self.count, axis=1)

    def at(self, times: Array) -> scipy.sparse.csr_array:
        """phi_j (k, J) at times (k,) [s], at most degree + 1 of them in a row."""
        d, K = self.degree, len(self.knots) - 1
        shares = np.clip((times - self.knots[0]) / self.spacing, 0.0, K)  # beyond the knots all are zero, as they are there
        found = scipy.interpolate.BSpline.design_matrix(shares, np.arange(-d, K + 1.0 + d), d)
        return found[:, d : d + self.count]

    def matched(self, mesh: Mesh, scheme: Scheme) -> list[scipy.sparse.csr_array]:
        """phi_j (N s, J) at the matched points of each output."""
        times = mesh.edges[:-1, None, None] + mesh.lengths[:, None, None] * scheme.points / scheme.steps  # (N, p, s)
        return [self.at(times[:, i].ravel()) for i in range(times.shape[1])]

    def bent(self, mesh: Mesh, scheme: Scheme, weights: Array) -> Array:
        """The bend with weights (J, p) at the matched points (N, p, s)."""
        phi = self.matched(mesh, scheme)
        return np.stack([(phi[i] @ weights[:, i]).reshape(len(mesh), -1) for i in range(len(phi))], axis=1)

    def least(self, slopes: Array) -> Array:
        """The weights (J, p, k) that change linear functions with these slopes (J, p, k) most for the integral of their squares."""
        J, p, k = slopes.shape
        solved = scipy.linalg.solveh_banded(self.gram, slopes.reshape(J, p * k), lower=True).reshape(J, p, k)
        return np.asarray(solved * self.scale[:, None] ** 2)

    def size(self, weights: Array) -> float:
        """Root of the integral over time of the bend's squares, each output in its own scale [sqrt(s)]."""
        sums = sum(
            (1 if k == 0 else 2) * float(np.sum((weights[: self.count - k] * weights[k:]) @ (1 / self.scale**2)) * row[0])
            for k, row in enumerate(self.gram)
        )
        return float(np.sqrt(max(sums, 0.0)))

    def signal(self, weights: Array) -> PiecewiseSignal:
        """The bend with weights (J, p) as a signal."""
        d, K = self.degree, len(self.knots) - 1
        spline = scipy.interpolate.BSpline(np.arange(-d, K + 1.0 + d), np.pad(weights, ((d, d), (0, 0))), d)
        pieces = np.stack([spline(np.arange(K), nu=k) / math.factorial(k) for k in range(d + 1)], axis=2)  # (K, p, d + 1)
        still = np.zeros(weights.shape[1])
        return piecewise_polynomial(self.knots, list(pieces), time_scale=self.spacing, held=(still, still))


@dataclass(frozen=True, eq=False)
class Border:
    """Bumps, and the rows that their weights are for: start (a, n) of what leaves rest, end (c, n) of what comes to it.

    The rows of the motions that are put to rest outside the bumps, beside the conditions that any motion meets at its ends.
    """

    bumps: Bumps
    start: Array
    end: Array

    def step(self, mesh: Mesh, scheme: Scheme, pull: Array, weights: Array, left: Array) -> tuple[Array, float]:
        """The change of the weights (J, p) to those of the least bend that, to first order, brings the rows to zero.

        And the share of the squares' integral by which that bend is less than the one that only brings the rows to zero.

        That is Newton's method for the rows, but for the least bend an iteration without the rows' second derivatives, which gains
        a constant factor at a time. Where a bend is SETTLED the change is therefore the least one that brings the rows to zero.

        Args:
            mesh, scheme: of the motion.
            pull: how the outputs at the matched points act on each row (k, N, p, s).
            weights: now (J, p).
            left: what the rows amount to with them (k,).

        Raises LinAlgError where no bend acts on the rows.
        """
        slopes = np.stack(
            [phi.T @ pull[:, :, i].reshape(len(pull), -1).T for i, phi in enumerate(self.bumps.matched(mesh, scheme))], axis=1
        )
        most = self.bumps.least(slopes)
        W = np.einsum("jik,jil->kl", slopes, most)
        units = np.sqrt(np.diag(W))
        if not np.all(units > 0):
            raise np.linalg.LinAlgError("no bend of the outputs acts on what is to rest")
        kept = np.einsum("jik,ji->k", slopes, weights)  # of the rows, by the bend as it is
        found = np.linalg.solve(W / np.outer(units, units), np.column_stack([-left, kept]) / units[:, None]) / units[:, None]
        to_rest, along = most @ found[:, 0], most @ found[:, 1] - weights
        size, extra = self.bumps.size(weights + to_rest), self.bumps.size(along)
        gap = (extra / size) ** 2 if size > 0 else 0.0  # least and extra bend are orthogonal
        return np.asarray(to_rest if extra <= SETTLED * size else to_rest + along), gap


@dataclass(frozen=True, eq=False)
class Bending:
    """By what outputs may be bent, and what is to rest outside of that for it.

    Args:
        bumps: of the outputs.
        zeros: of the linear models at the start and at the end [rad/s], those that are to rest.
        states: coordinates of the dynamics that are states of these models.
    """

    bumps: Bumps
    zeros: tuple[ComplexArray, ComplexArray]
    states: Indices

    def border(self, ends: tuple[End, End]) -> Border:
        """What that asks of a motion between these ends: at each of them what it does not meet anyway."""
        start = ends[0].rows_at_rest(self.zeros[0], self.states, expanding=True)
        return Border(self.bumps, start, ends[1].rows_at_rest(self.zeros[1], self.states, expanding=False))
