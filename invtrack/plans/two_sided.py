"""Two-sided systems: one part that decays forward in time, one that decays backward, both driven by a reference.

The stable and antistable internal dynamics of an inverse, the state and costate of an optimum, and the coordinates of a regulation
map are all of this form; they differ in who fills it in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.linalg

from invtrack.arrays import Array
from invtrack.errors import InversionError
from invtrack.linear.propagation import Propagator
from invtrack.linear.scaling import pace_of
from invtrack.plans.tail import Tail, generator_pace

QUICKER = 10.0
"""Quick states follow a reference almost at once if they are this often as fast."""

RESONANCE = 1e-12
"""A mode of the reference within this share of the norms of both matrices of an eigenvalue coincides with it."""


@dataclass(frozen=True, eq=False)
class Part:
    """z' = A z + (drive): X z is its share of the values [x; u; y], J z of what is continuous through a jump.

    A (n_z, n_z), X (r, n_z), J (m, n_z). Parts that differ in X and J only share their propagators, `made`.
    """

    A: Array
    X: Array
    J: Array
    made: dict[int, Propagator] = field(default_factory=dict, repr=False)

    @classmethod
    def empty(cls, rows: int, joined: int) -> Part:
        """A part without states."""
        return cls(np.zeros((0, 0)), np.zeros((rows, 0)), np.zeros((joined, 0)))

    @property
    def size(self) -> int:
        """Number of states n_z."""
        return len(self.A)

    def in_unit(self, unit: float) -> Part:
        """The same with z measured in another unit."""
        return replace(self, X=self.X * unit, J=self.J * unit)

    def propagator(self, direction: int) -> Propagator:
        """exp(direction A tau), direction 1 or -1."""
        if direction not in self.made:
            self.made[direction] = Propagator(direction * self.A)
        return self.made[direction]


@dataclass(frozen=True, eq=False)
class TwoSidedSystem:
    """values = X_f z_f + X_b z_b + (reference), z_f given at the start of a stretch of time and z_b at its end.

    Each part is integrated in the direction in which it does not grow, so no exponential overflows. At a jump from one system to
    another J_f z_f + J_b z_b + (reference) is continuous, (m,). T (rho + n_f + n_b, m) takes it apart: T J_f = [0; I; 0] and
    T J_b = [0; 0; I]. Its first `prescribed` = rho rows pick what the reference alone decides (an inverse's outputs and their
    derivatives): before a jump they are the compatibility conditions on z_f, z_b.

    Along the columns of `slack` (m, k) what is continuous may jump when this system gives way to another: costates that belong to
    what it prescribes, which are whatever that takes.

    The last n_c states of the forward part may be neutral: decoupled from the others, neither decaying nor growing. They start from
    rest and have to end at rest. `neutral` (n_c, n_c) is the pseudoinverse of their A_c, which may be singular.
    """

    forward: Part
    backward: Part
    T: Array
    prescribed: int = 0
    neutral: Array = field(default_factory=lambda: np.zeros((0, 0)))
    slack: Array | None = None

    @property
    def size(self) -> int:
        """Number of states n_f + n_b."""
        return self.forward.size + self.backward.size

    @property
    def decaying(self) -> int:
        """Number of states of the forward part that decay, n_f - n_c."""
        return self.forward.size - len(self.neutral)

    @property
    def moves_neutral(self) -> Array:
        """What of a departure of the neutral states from rest is not rest itself (n_c, n_c): all but the kernel of A_c."""
        return np.asarray(self.neutral @ self.forward.A[self.decaying :, self.decaying :])

    @cached_property
    def propagators(self) -> tuple[Propagator, Propagator]:
        """exp(A_f tau) and exp(-A_b tau); of an optimum, where -A_b = A_f', the one is the other's transpose."""
        forward, backward = self.forward, self.backward
        if np.array_equal(backward.A, -forward.A.T):
            return forward.propagator(1), forward.propagator(1).transposed
        return forward.propagator(1), backward.propagator(-1)

    def in_units(self, forward: float, backward: float) -> TwoSidedSystem:
        """The same with z_f and z_b measured in other units."""
        rho, n_f = self.prescribed, self.forward.size
        T = self.T.copy()
        T[rho : rho + n_f] /= forward
        T[rho + n_f :] /= backward
        return replace(self, forward=self.forward.in_unit(forward), backward=self.backward.in_unit(backward), T=T)


@dataclass(frozen=True, eq=False)
class DrivenSystem:
    """A two-sided system with what a reference's state w' = S w adds to it.

    z_f' = A_f z_f + D_f w, z_b' = A_b z_b + D_b w.

    Args:
        system: the two-sided system.
        S: generator of the reference (q, q).
        D_f, D_b: what drives each part, (n_f, q) and (n_b, q).
        X_w, J_w: X_w w is the reference's share of the values and J_w w of what is continuous through a jump, (r, q) and (m, q).
        settled: the same with quick states measured from where the reference holds them, if there are such.
        made: its propagators, shared by systems that differ in their values only.
    """

    system: TwoSidedSystem
    S: Array
    D_f: Array
    D_b: Array
    X_w: Array
    J_w: Array
    settled: Settled | None = None
    made: list[Propagator] = field(default_factory=list, repr=False)

    @property
    def propagators(self) -> tuple[Propagator, Propagator]:
        """Those of [z_f; w] forward and of [z_b; w] backward in time."""
        if not self.made:
            forward, backward = self.system.propagators
            self.made[:] = forward.driven(self.D_f, self.S), backward.driven(-self.D_b, -self.S)
        return self.made[0], self.made[1]

    @cached_property
    def pace(self) -> float:
        """How fast the values change [rad/s]."""
        return max(pace_of(self.S), *(propagator.pace for propagator in self.system.propagators))

    @cached_property
    def lasting_pace(self) -> float:
        """How fast the values change beyond the first moments next to both ends [rad/s]; see `Propagator.lasting_pace`."""
        return max(generator_pace(self.S), *(propagator.lasting_pace for propagator in self.system.propagators))

    def in_units(self, forward: float, backward: float, system: TwoSidedSystem) -> DrivenSystem:
        """The same, `system` being this one's in these units."""
        settled = None if self.settled is None else self.settled.in_units(forward, backward, system)
        return replace(self, system=system, D_f=self.D_f / forward, D_b=self.D_b / backward, settled=settled, made=[])

    def steady(self) -> tuple[Array, Array]:
        """z_f = steady_f w and z_b = steady_b w (., q), bounded where the reference runs on for ever: equilibria where it holds.

        Neutral states that no held reference lets rest get what comes nearest. Raises InversionError where a mode of the reference
        is an eigenvalue of A_f or A_b.
        """
        n, A_f = self.system.decaying, self.system.forward.A
        steady_f = _steady(A_f[:n, :n], self.D_f[:n], self.S)
        if n < len(A_f):
            D_c = self.D_f[n:]
            neutral = _steady(A_f[n:, n:], D_c, self.S) if np.any(self.S) else -self.system.neutral @ D_c
            steady_f = np.vstack([steady_f, neutral])
        return steady_f, _steady(self.system.backward.A, self.D_b, self.S)

    def tail_before(self, w: Array, z_b: Array) -> Tail:
        """The tail before a manoeuvre at whose start the backward part is z_b: z_f steady, z_b on its way from its steady value."""
        steady_f, steady_b = self.steady()
        forward, backward = self.system.forward, self.system.backward
        X_w = self.X_w + forward.X @ steady_f + backward.X @ steady_b
        return Tail(-1, self.system.propagators[1], backward.X, z_b - steady_b @ w, self.S, X_w, w)

    def tail_after(self, w: Array, z_f: Array) -> Tail:
        """The tail after a manoeuvre at whose end the forward part is z_f: z_b steady, z_f on its way to its steady value.

        Neutral states are taken to rest: with an A_c that is singular they may rest elsewhere than at their steady value.
        """
        steady_f, steady_b = self.steady()
        forward, backward, n = self.system.forward, self.system.backward, self.system.decaying
        X_w = self.X_w + forward.X @ steady_f + backward.X @ steady_b
        departure, S = z_f - steady_f @ w, self.S
        if n < len(departure):
            resting = departure[n:] - self.system.moves_neutral @ departure[n:]
            X_w = np.column_stack([X_w, forward.X[:, n:] @ resting])
            S, w = scipy.linalg.block_diag(S, 0.0), np.append(w, 1.0)
        moving = Propagator(forward.A[:n, :n]) if n < forward.size else self.system.propagators[0]
        return Tail(1, moving, forward.X[:, :n], departure[:n], S, X_w, w)

    def derivative(self) -> DrivenSystem:
        """The system whose values are the time derivatives of this one's."""
        forward, backward = self.system.forward, self.system.backward
        system = replace(
            self.system,
            forward=replace(forward, X=forward.X @ forward.A),
            backward=replace(backward, X=backward.X @ backward.A),
        )
        return replace(self, system=system, X_w=self.X_w @ self.S + forward.X @ self.D_f + backward.X @ self.D_b)

    def mapped(self, M: Array) -> DrivenSystem:
        """The system whose values are M (., r) times this one's."""
        forward, backward = self.system.forward, self.system.backward
        system = replace(self.system, forward=replace(forward, X=M @ forward.X), backward=replace(backward, X=M @ backward.X))
        return replace(self, system=system, X_w=M @ self.X_w)


@dataclass(frozen=True, eq=False)
class Settled:
    """A driven system in the coordinates z_f - P_f w and z_b - P_b w, where z = P w is what the reference makes of quick states.

    Those follow the reference almost at once. What they make of it in the values, say an input that grows with the square of their
    pace, is the difference of terms that are larger by as much; measured from P w they die out right next to a breakpoint, and
    nothing is left that cancels.

    P_f, P_b: (n_f, q) and (n_b, q), zero but for the rows of quick states.
    """

    driven: DrivenSystem
    P_f: Array
    P_b: Array

    def in_units(self, forward: float, backward: float, system: TwoSidedSystem) -> Settled:
        """The same, with z_f and z_b in other units; `system`: in these."""
        return Settled(self.driven.in_units(forward, backward, system), self.P_f / forward, self.P_b / backward)


def settled_states(A: Array, D: Array, S: Array, quick: slice) -> Array:
    """P (n, q) with z = P w in the quick states of z' = A z + D w, w' = S w; zero for the others, and where S is about as fast."""
    P = np.zeros_like(D)
    if np.any(D[quick]) and QUICKER * pace_of(S) < float(np.min(np.abs(np.linalg.eigvals(A[quick, quick])))):
        P[quick] = _steady(A[quick, quick], D[quick], S)
    return P


def drive_units(driven: Sequence[DrivenSystem]) -> tuple[float, float]:
    """Powers of two in which z_f and z_b are to be measured, so that the reference's drive is of the size of the dynamics.

    A spline through close samples has large derivatives, and weights can be large: as entries of an augmented matrix they would set
    the pace of all of it.
    """
    units = []
    for part, drive in (("forward", "D_f"), ("backward", "D_b")):
        pace = max((np.linalg.norm(A, 1) for each in driven if (A := getattr(each.system, part).A).size), default=0.0)
        push = max((np.linalg.norm(D, 1) for each in driven if (D := getattr(each, drive)).size), default=0.0)
        units.append(float(2.0 ** np.ceil(np.log2(push / pace))) if push > 0 and pace > 0 else 1.0)
    return units[0], units[1]


def _steady(A: Array, D: Array, S: Array) -> Array:
    """The solution X of A X - X S = -D: z = X w solves z' = A z + D w."""
    if not np.any(D):
        return np.zeros_like(D)
    if not np.any(S):
        equilibrium: Array = -scipy.linalg.solve(A, D)
        return equilibrium
    shared = np.min(np.abs(np.linalg.eigvals(A)[:, None] - np.linalg.eigvals(S)[None, :]))
    if shared <= RESONANCE * (np.linalg.norm(A) + np.linalg.norm(S)):
        raise InversionError(
            "a mode of the reference coincides with a zero of the plant, so it has no bounded response on an interval without end; "
            "change the reference's mode or hold the output before and after the manoeuvre"
        )
    steady: Array = scipy.linalg.solve_sylvester(A, -S, -D)
    return steady
