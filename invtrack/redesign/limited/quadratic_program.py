"""A sparse convex quadratic programme, solved by an interior-point method (Clarabel)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import clarabel
import numpy as np
import scipy  # loads scipy.sparse at its first use
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.errors import RedesignError
from invtrack.redesign.limits import Bound

GAP, SMALLEST_GAP, RESIDUAL = 1e-12, 1e-14, 1e-11
"""To which the duality gap is brought, as a share of the cost or of its largest weight, and the residuals of the constraints."""

ACCEPTED = 1e-9
"""Gap and residuals from which on a solution is taken that rounding keeps from these; the equations are made exact afterwards."""

CONFLICT = 1e-6
"""Constraints that have to give way by more than this conflict; h is about one."""

MOST_ITERATIONS = 100

STATIC_REGULARIZATIONS = (1e-8, 1e-6)
"""Of the solver's own equations, tried in this order; its refinement takes their effect out again."""

REGULARIZATION = 1e-12
"""Keeps the equations of `nearest` solvable where rows repeat each other; refinement takes its effect out again."""

REFINEMENTS = 4


class SolverGaveUpError(RedesignError):
    """The solver found neither a solution that can be trusted nor a proof that there is none."""


@dataclass(frozen=True, eq=False)
class Minimum:
    """The minimiser z (m,) with P z + q + E'y + G'l = 0, and its multipliers y = of_equations and l = of_limits, which is >= 0."""

    z: Array
    of_equations: Array
    of_limits: Array


@dataclass(frozen=True, eq=False)
class QuadraticProgram:
    """Minimise z'P z / 2 + q'z subject to E z = e and G z <= h, in units in which z (m,) and h are about one.

    Args:
        P: (m, m), positive semidefinite.
        q: (m,).
        E: (equations, m).
        e: (equations,).
        G: (limits, m).
        h: (limits,).
    """

    P: scipy.sparse.csr_array
    q: Array
    E: scipy.sparse.csr_array
    e: Array
    G: scipy.sparse.csr_array
    h: Array

    def solve(self) -> Minimum | None:
        """The minimum; None where no z meets all constraints.

        Raises SolverGaveUpError where the solver reaches neither.
        """
        answer = self._attempt()
        if answer.minimum is not None:
            return answer.minimum
        # An unbounded cost may hide from the solver that nothing meets the constraints; how far they are apart it mostly finds.
        loosened = self._elastic(np.zeros(len(self.h), dtype=np.intp))._attempt()
        if loosened.infeasible or (answer.infeasible if loosened.minimum is None else loosened.minimum.z[-1] > CONFLICT):
            return None
        raise SolverGaveUpError(
            f"the solver gave up on the limited redesign: {answer.says}; this does not mean that the limits cannot be kept: take a "
            "larger step, or bring weights and limits closer to each other"
        )

    def least_loosening(self, group: Indices) -> Array | None:
        """Least t (groups,) >= 0, in sum, with G z <= h + t[group] for some z that meets E z = e; None where none is found.

        group (rows,): number of the group of each row of G, -1 where it must not be loosened.
        """
        minimum = self._elastic(group)._attempt().minimum
        return None if minimum is None else np.maximum(minimum.z[len(self.q) :], 0.0)

    def _elastic(self, group: Indices) -> QuadraticProgram:
        """Minimise the sum of t over [z; t], as in `least_loosening`."""
        m, k, rows = len(self.q), int(np.max(group)) + 1, np.flatnonzero(group >= 0)
        give = scipy.sparse.csr_array(scipy.sparse.coo_array((-np.ones(len(rows)), (rows, group[rows])), shape=(len(group), k)))
        return QuadraticProgram(
            P=scipy.sparse.csr_array((m + k, m + k)),
            q=np.concatenate([np.zeros(m), np.ones(k)]),
            E=scipy.sparse.csr_array(scipy.sparse.hstack([self.E, scipy.sparse.csr_array((len(self.e), k))])),
            e=self.e,
            G=scipy.sparse.csr_array(
                scipy.sparse.block_array([[self.G, give], [scipy.sparse.csr_array((k, m)), -scipy.sparse.eye_array(k)]])
            ),
            h=np.concatenate([self.h, np.zeros(k)]),
        )

    def nearest(self, z: Array, active: NDArray[np.bool_]) -> Array:
        """The point next to z at which E z = e, and G z = h for the active rows, to rounding."""
        rows = scipy.sparse.csc_array(scipy.sparse.vstack([self.E, self.G[active]]))
        wanted = np.concatenate([self.e, self.h[active]])
        m, k = len(z), len(wanted)
        equations = scipy.sparse.block_array(
            [[scipy.sparse.eye_array(m), rows.T], [rows, -REGULARIZATION * scipy.sparse.eye_array(k)]], format="csc"
        )
        factors = scipy.sparse.linalg.splu(equations)
        for _ in range(REFINEMENTS):
            z = z + factors.solve(np.concatenate([np.zeros(m), wanted - rows @ z]))[:m]
        return z

    def _attempt(self) -> _Answer:
        """What the solver finds, with as little regularization as will do."""
        A = scipy.sparse.csc_matrix(scipy.sparse.vstack([self.E, self.G]))
        b = np.concatenate([self.e, self.h])
        cones = [clarabel.ZeroConeT(len(self.e)), clarabel.NonnegativeConeT(len(self.h))]
        # Costs of about one, whatever their unit: the gap is measured against it.
        size = max(float(abs(self.P).max()), float(np.max(np.abs(self.q))), np.finfo(float).tiny)
        P = scipy.sparse.csc_matrix(scipy.sparse.triu(self.P / size))
        for regularization in STATIC_REGULARIZATIONS:
            solution = clarabel.DefaultSolver(P, self.q / size, A, b, cones, _settings(regularization)).solve()
            if solution.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
                of_equations, of_limits = np.split(size * np.array(solution.z), [len(self.e)])
                return _Answer(Minimum(np.array(solution.x), of_equations, np.maximum(of_limits, 0.0)), False, "solved")
            if solution.status == clarabel.SolverStatus.PrimalInfeasible:
                return _Answer(None, True, "infeasible")
        return _Answer(
            None,
            False,
            f"{solution.status} after {solution.iterations} iterations, residuals {solution.r_prim:.1e} and {solution.r_dual:.1e}",
        )


@dataclass(frozen=True, eq=False)
class _Answer:
    """The minimum, whether the solver proved that there is none, and what it says."""

    minimum: Minimum | None
    infeasible: bool
    says: str


def _settings(regularization: float) -> clarabel.DefaultSettings:
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.max_threads = 1
    settings.max_iter = MOST_ITERATIONS
    settings.static_regularization_constant = regularization
    settings.tol_gap_rel, settings.tol_gap_abs, settings.tol_feas = GAP, SMALLEST_GAP, RESIDUAL
    settings.reduced_tol_gap_abs = settings.reduced_tol_gap_rel = settings.reduced_tol_feas = ACCEPTED
    return settings


def explain(program: QuadraticProgram, owner: Indices, bounds: Sequence[Bound]) -> str:
    """The limits whose least common loosening makes the programme solvable, and what each alone would have to become.

    owner: number of the bound behind each row of G, in units of the bound's size.
    """
    loosened = program.least_loosening(owner)
    if loosened is None:
        return "no loosening of them helps: the plant cannot get from one end to the other at all"
    needed = [(bound, by) for bound, by in zip(bounds, loosened, strict=True) if by > CONFLICT]
    together = [f"{bound} by {by * bound.size:.3g}" for bound, by in needed]
    alone = []
    for number, bound in enumerate(bounds):
        share = program.least_loosening(np.where(owner == number, 0, -1))
        if share is not None:
            by = float(share[0] * bound.size)
            alone.append(f"{bound.name} between {bound.low + bound.offset - by:.6g} and {bound.high + bound.offset + by:.6g}")
    one = f"one of these alone would be enough: {'; '.join(alone)}" if alone else "no single limit, loosened alone, is enough"
    return f"the least that has to give way, in all, is {', '.join(together)}; {one}"
