"""Riccati and Lyapunov equations of an optimum, solved in doubles and refined with residuals in twice the precision."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import RedesignError
from invtrack.redesign.double_double import DoubleDouble
from invtrack.redesign.schur_form import SchurForm

MOST_CORRECTIONS = 60
"""Corrections after which the refinement ends."""

REFINED = 1e-20
"""A correction below this share of the solution ends the refinement; each gains at least as many digits as the first has right."""

FADING = 0.5
"""A correction that is not below this share of the last one gains nothing any more."""

RENEWED = 1e-4
"""A feedback that changes by more than this share of it asks for a Schur form of its own."""

DEARER = 1e4
"""Factor by which inputs are made dearer, as often as it takes to find a feedback that stabilizes."""

MOST_TIMES_DEARER = 6


class PrecisionError(RedesignError):
    """The equations of an optimum are too far out of working precision; with dearer inputs they may not be."""


ADVICE = "bring the weights and the units of the states closer to each other"


@dataclass(frozen=True, eq=False)
class QuadraticCost:
    """x' = A x + B u and the integral of x'Q x + 2 x'N u + u'R u, in twice the precision, in units in which R is about 1.

    A (n, n), B (n, p), Q (n, n), N (n, p), R (p, p).
    """

    A: DoubleDouble
    B: DoubleDouble
    Q: DoubleDouble
    N: DoubleDouble
    R: DoubleDouble

    def inverse_weight(self) -> DoubleDouble:
        """R^-1: R differs from 1 by rounding only, so that the third term of Neumann's series is below twice the precision."""
        one = DoubleDouble.of(np.eye(len(self.R.high)))
        departure = self.R - one
        return one - departure + departure @ departure

    def hamiltonian(self, dearer: float) -> Array:
        """[A_0, -B R^-1 B' / s; -Q_0 / s, -A_0'] (2n, 2n), whose stable subspace is spanned by [1; P / s]: inputs dearer by s^2.

        A_0, Q_0: without the cross term, which the input -R^-1 N'x takes away whatever inputs cost.
        """
        W = self.inverse_weight()
        gain = W @ self.N.transposed
        A_0, Q_0 = (self.A - self.B @ gain).rounded, (self.Q - self.N @ gain).rounded
        size = np.sqrt(dearer)
        return np.block([[A_0, -(self.B @ W @ self.B.transposed).rounded / size], [-Q_0 / size, -A_0.T]])

    def residual(self, P: DoubleDouble, K: DoubleDouble) -> Array:
        """A_K'P + P A_K + Q - N K - K'N' + K'R K with A_K = A - B K: what the cost x'P x with the input -K x is off by."""
        half = self.A.transposed @ P - K.transposed @ (self.B.transposed @ P) - self.N @ K
        return (half + half.transposed + self.Q + K.transposed @ self.R @ K).rounded


@dataclass(frozen=True, eq=False)
class OptimalFeedback:
    """u = -K x, what it makes of the plant, the cost x'P x from a state on, and how far the costate drives the state, L.

    P (n, n) is the stabilizing solution of A'P + P A - (P B + N) R^-1 (P B + N)' + Q = 0, K = R^-1 (P B + N)' (p, n),
    A_c = A - B K (n, n), A_c L + L A_c' = B R^-1 B'; schur: the form of A_c.
    """

    P: DoubleDouble
    K: DoubleDouble
    A_c: DoubleDouble
    L: DoubleDouble
    schur: SchurForm


def optimal_feedback(problem: QuadraticCost) -> OptimalFeedback:
    """The stabilizing solution, by the Hamiltonian's Schur form and Newton's corrections to it.

    For cheap inputs K = R^-1 (P B + N)' consists of what is left of P where large parts cancel, and so do the outputs' rows of L:
    in working precision nothing would be left. Corrections come from one Schur form of A_c, residuals are worked out in twice the
    precision, so that the solution gains digits until it is right to those.

    Raises RedesignError where there is no stabilizing solution, or it is too far out of the working precision to begin with.
    Sources: A. Laub, "A Schur method for solving algebraic Riccati equations", IEEE Trans. Automatic Control 24(6), 1979;
    D. Kleinman, "On an iterative technique for Riccati equation computations", IEEE Trans. Automatic Control 13(1), 1968.
    """
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            return _refined(problem)
    except (FloatingPointError, np.linalg.LinAlgError) as reason:
        raise PrecisionError(f"the equations of the redesign leave the range of numbers: {reason}; {ADVICE}") from reason


def _refined(problem: QuadraticCost) -> OptimalFeedback:
    A, B, N, W = problem.A, problem.B, problem.N, problem.inverse_weight()
    P, K, schur = _first_feedback(problem)
    previous, renew = np.inf, False
    for _ in range(MOST_CORRECTIONS):
        if renew:
            schur = _stable_form(A - B @ K)
        P = P + DoubleDouble.of(schur.observability(problem.residual(P, K)))
        better = W @ (P @ B + N).transposed
        change = _share((better - K).rounded, better)
        K = better
        if change <= REFINED or (change > FADING * previous and change <= np.finfo(float).eps):
            break
        previous, renew = change, change > RENEWED
    A_c = A - B @ K
    schur = _stable_form(A_c)
    return OptimalFeedback(P, K, A_c, _reach(schur, A_c, B @ W @ B.transposed), schur)


def _first_feedback(problem: QuadraticCost) -> tuple[DoubleDouble, DoubleDouble, SchurForm]:
    """P and K in working precision and the Schur form of A - B K.

    They are those of inputs so much dearer, if need be, that K stabilizes; from there Newton's steps converge.
    """
    n, W = len(problem.A.high), problem.inverse_weight()
    for times in range(MOST_TIMES_DEARER + 1):
        dearer = DEARER**times
        _, Z, count = scipy.linalg.schur(problem.hamiltonian(dearer), sort="lhp")
        if count != n:
            continue
        one_sided = np.sqrt(dearer) * np.linalg.solve(Z[:n, :n].T, Z[n:, :n].T)
        P = DoubleDouble.of((one_sided + one_sided.T) / 2)
        drive = W @ (problem.B.transposed @ P)
        K = DoubleDouble(drive.high / dearer, drive.low / dearer) + W @ problem.N.transposed
        schur = SchurForm((problem.A - problem.B @ K).rounded)
        if schur.is_stable:
            return P, K, schur
    raise PrecisionError(
        "the Riccati equation of the redesign has no stabilizing solution in working precision: modes of its Hamiltonian cannot "
        f"be told from the imaginary axis; {ADVICE}"
    )


def _stable_form(A_c: DoubleDouble) -> SchurForm:
    form = SchurForm(A_c.rounded)
    if not form.is_stable:
        raise PrecisionError(f"the optimal feedback cannot be told from one that does not stabilize in working precision; {ADVICE}")
    return form


def _share(change: Array, whole: DoubleDouble) -> float:
    """Size of a change as a share of the whole, zero where there is nothing."""
    size = float(np.linalg.norm(whole.high))
    return float(np.linalg.norm(change)) / size if size > 0 else 0.0


def _reach(schur: SchurForm, A_c: DoubleDouble, G: DoubleDouble) -> DoubleDouble:
    """L with A_c L + L A_c' = G."""
    L = DoubleDouble.of(schur.reachability(G.rounded))
    previous = np.inf
    for _ in range(MOST_CORRECTIONS):
        one_sided = A_c @ L
        correction = schur.reachability((G - one_sided - one_sided.transposed).rounded)
        L = L + DoubleDouble.of(correction)
        change = _share(correction, L)
        if change <= REFINED or change > FADING * previous:
            break
        previous = change
    return L
