"""Regulation maps: from the exosystem's state to the plant's wanted state and input, over all of time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, Indices, finite_number, real_numbers, shown
from invtrack.errors import InversionError, TrajectoryError
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.plan import Plan
from invtrack.plans.problem import PlanningProblem
from invtrack.plans.trajectory import Trajectory
from invtrack.plans.two_sided import DrivenSystem
from invtrack.plans.two_sided_problem import Pieces, two_sided_trajectory
from invtrack.references.exosystem import Exosystem
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal
from invtrack.regulation.admissible import InadmissibleState
from invtrack.regulation.map_certificate import RegulationCertificate

ADMISSIBLE_TOLERANCE = 1e-7
"""An exosystem state counts as admissible where its part outside the admissible subspace is below this share of it."""


@dataclass(frozen=True, eq=False)
class PlanPieces:
    """What turns an exosystem's trajectory into a planned one: two-sided systems of [x; u; y] driven by the weighted x_e.

    Args:
        driven: the distinct systems.
        which: number of the one that each piece has (m + 2,).
        Z_f: what gives z_f = Z_f x_e at the start of each inner piece (m, n_f, q).
        Z_b: what gives z_b = Z_b x_e at its end (m, n_b, q).
        first_b: the same for z_b at the manoeuvre's start, where the tail before it ends (n_b, q).
        last_f: the same for z_f at the manoeuvre's end, where the tail after it starts (n_f, q).
    """

    driven: tuple[DrivenSystem, ...]
    which: Indices
    Z_f: Array
    Z_b: Array
    first_b: Array
    last_f: Array

    def trajectory(self, breakpoints: Array, x_e: Array) -> Trajectory:
        """The plan for weighted exosystem states x_e (m + 1, q) at the breakpoints."""
        starts, ends = np.concatenate([x_e[:1], x_e]), np.concatenate([x_e, x_e[-1:]])
        pieces = Pieces(breakpoints, self.driven, self.which, starts, ends)
        z_f = np.einsum("kij,kj->ki", self.Z_f, starts[1:-1])
        z_b = np.einsum("kij,kj->ki", self.Z_b, ends[1:-1])
        return two_sided_trajectory(pieces, z_f, z_b, self.first_b @ x_e[0], self.last_f @ x_e[-1])


@dataclass(frozen=True, eq=False)
class RegulationMap:
    """x_d(t) = G(t) x_e(t), u_d(t) = F(t) x_e(t), for all states of an exosystem at once, on all of time.

    G' = A_y G - G A_e + B G_k C_e*, F = F_k G + G_k C_e* (Devasia, Paden, Rossi 1996, eq. 17), for a map of the method "exosystem
    map"; constant between breakpoints and discontinuous at them for the Francis regulators. y_d = C_e x_e is the deviation from the
    plant's operating point before all jumps, x_d and u_d are those from `x_rest` and `u_rest`, what the map makes of x_e = 0: the
    operating point, unless a jump of the plant moves its equilibrium.

    Args:
        method: its name.
        model: the plant.
        exosystem: the one whose states are mapped.
        driver: what drives the map: the exosystem, with a state that stays at 1 where the plant's equilibria differ.
        trajectory: G and F row by row, one above the other, for the driver's states.
        pieces: what makes plans from the exosystem's states.
        manoeuvre: (T_i, T_f), first and last breakpoint [s].
        preactuation, postactuation: how long [s] before T_i and after T_f G and F differ by more than `tolerance` from their
            bounded particular solutions, which are zero where the exosystem is still; infinite where they never come that close.
        tolerance: share of the peak of each entry.
        weights: how strongly each state of the exosystem shows in y_d (q,), zero for one that never does: w x_e has no units of its
            own.
        admissible: basis (q, d) of the states x_e(T_i) whose output can be followed by a continuous state of the plant, columns of
            unit length, orthogonal as weighted states.
        inadmissible: which of the named states lie outside it, and why.
        directions_left: (time [s], d) where the conditions so far leave only d directions of x_e.
        certificate: how well the map meets its equations.
        remarks: what a user should know.
    """

    method: str
    model: SwitchedSystem
    exosystem: Exosystem
    driver: Exosystem
    trajectory: Trajectory
    pieces: PlanPieces
    manoeuvre: tuple[float, float]
    preactuation: float
    postactuation: float
    tolerance: float
    weights: Array
    admissible: Array
    inadmissible: tuple[InadmissibleState, ...]
    directions_left: tuple[tuple[float, int], ...]
    certificate: RegulationCertificate
    remarks: tuple[str, ...] = ()

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which the map is not smooth: switch times of plant and exosystem."""
        return self.trajectory.breakpoints

    @property
    def start(self) -> float:
        """Time [s] at which the map leaves its particular solution: T_i - preactuation."""
        return self.manoeuvre[0] - self.preactuation

    @property
    def end(self) -> float:
        """Time [s] at which the map has come to its particular solution: T_f + postactuation."""
        return self.manoeuvre[1] + self.postactuation

    def x_map(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """G (m, n, q) at times t (m,) [s]; `inside` names, by times within them, the pieces meant where a side matters."""
        n, q = self.model.n_states, self.exosystem.n_states
        return self._rows(t, inside, 0, n)[:, :, :q]

    def u_map(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """F (m, p, q) at times t (m,) [s]; see x_map."""
        n, m, q = self.model.n_states, self.model.n_inputs, self.exosystem.n_states
        return self._rows(t, inside, n, n + m)[:, :, :q]

    def x_rest(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """States (m, n) for x_e = 0, as deviations from the operating point before all jumps; see x_map."""
        return self._rest(t, inside, self.model.rest_states, 0)

    def u_rest(self, t: ArrayLike, *, inside: ArrayLike | None = None) -> Array:
        """Inputs (m, p) for x_e = 0, absolute; see x_map."""
        return self._rest(t, inside, self.model.rest_inputs, self.model.n_states)

    def _rest(self, t: ArrayLike, inside: ArrayLike | None, rest: Array, first: int) -> Array:
        """Rest (N + 1, k) of the interval in force, with what the driver's last state adds in the rows from the first one on."""
        times, within = self._times(t, inside)
        at = rest[self.model.interval(within)]
        if self.driver is self.exosystem:
            return at
        return np.asarray(at + self._rows(times, within, first, first + rest.shape[1])[:, :, -1])

    def _rows(self, t: ArrayLike, inside: ArrayLike | None, first: int, last: int) -> Array:
        """Rows of [G; F] for the driver's states (m, rows, q)."""
        times, within = self._times(t, inside)
        q = self.driver.n_states
        values = self.trajectory(times, self.trajectory.locate(within), slice(first * q, last * q))
        return values.reshape(len(times), last - first, q)

    def _times(self, t: ArrayLike, inside: ArrayLike | None) -> tuple[Array, Array]:
        """Times (m,) [s], and as many inside the pieces meant."""
        times = np.atleast_1d(real_numbers("times [s]", t))
        if times.ndim != 1 or not np.all(np.isfinite(times)):
            raise TrajectoryError(f"expected finite times (m,) [s], got {shown(t)}")
        within = times if inside is None else real_numbers("times inside pieces [s]", inside)
        if within.shape not in ((), times.shape) or not np.all(np.isfinite(within)):
            raise TrajectoryError(f"inside must name a finite time [s] for each of the {len(times)} times, got {shown(inside)}")
        return times, np.broadcast_to(within, times.shape)

    def inadmissible_share(self, x_e: ArrayLike, *, at: float | None = None) -> float:
        """Share of x_e (q,), given at time `at` [s] (default T_i), that lies outside the admissible states, both weighted."""
        x_0, basis = self._at_start(x_e, at), self._sizes[:, None] * self.admissible
        basis = basis / np.linalg.norm(basis, axis=0)
        size = float(np.linalg.norm(x_0))
        return float(np.linalg.norm(x_0 - basis @ (basis.T @ x_0))) / size if size > 0 else 0.0

    def plan(self, x_e: ArrayLike, *, at: float | None = None) -> Plan:
        """The plan x_d = G x_e, u_d = F x_e for the exosystem trajectory through x_e (q,) at time `at` [s].

        `at` is T_i of this map by default, the time for which `admissible` holds. The Francis regulators, which jump, take any
        state; their plan is no trajectory of the plant, as its certificate says.

        Raises InversionError, with the reason, for a state that is not admissible; TrajectoryError for one of another size.
        """
        share = self.inadmissible_share(x_e, at=at)
        if share > ADMISSIBLE_TOLERANCE and self.method == "exosystem map":
            raise InversionError(
                f"the exosystem state {np.asarray(x_e).tolist()} is not admissible ({share:.1e} of it): no continuous state of the "
                f"plant gives its output. {self.describe_inadmissible()}; use a combination of the {self.admissible.shape[1]} "
                "columns of `admissible`"
            )
        # At T_i, a breakpoint of the plan: its reference is to have no breakpoint that it does not know.
        x_0, T_i = self._at_start(x_e, at), self.manoeuvre[0]
        driving = np.append(x_0, self._all_sizes[len(x_0) :])
        comparable = self.driver.weighted(self.weights)
        deviation = comparable.reference(driving, at=T_i).refined(self.breakpoints)
        trajectory = self.pieces.trajectory(self.breakpoints, comparable.states(driving, T_i, self.breakpoints))
        reference = _absolute(self._comparable.reference(x_0, at=T_i).refined(self.breakpoints), self.model.operating_point.y0)
        problem = PlanningProblem(self.model, reference, deviation, deviation.end_anchors, self.tolerance, None, None)
        return problem.plan(self.method, trajectory, exact=None, remarks=self.remarks)

    def describe_inadmissible(self) -> str:
        """The inadmissible named states and the reason of each, and where combinations of them are lost, as one sentence."""
        if not self.inadmissible:
            return "every state is admissible"
        q = self.exosystem.n_states
        lost = ", those ".join(f"at t = {time:.6g} s leave {d or 'none'}" for time, d in self.directions_left)
        return f"{'; '.join(map(str, self.inadmissible))}; of {q} directions of the exosystem's state the conditions {lost}"

    @cached_property
    def _all_sizes(self) -> Array:
        """What the driver's states are multiplied with to be comparable: their weights, 1 for one that never shows."""
        return np.where(self.weights > 0, self.weights, 1.0)

    @property
    def _sizes(self) -> Array:
        """Those of the exosystem's states (q,)."""
        return self._all_sizes[: self.exosystem.n_states]

    @cached_property
    def _comparable(self) -> Exosystem:
        """The exosystem of the weighted states."""
        return self.exosystem.weighted(self.weights[: self.exosystem.n_states])

    def _at_start(self, x_e: ArrayLike, at: float | None) -> Array:
        """The weighted state (q,) at T_i."""
        x = real_numbers("the exosystem's state", x_e)
        if x.shape != (self.exosystem.n_states,) or not np.all(np.isfinite(x)):
            names = list(self.exosystem.names)
            raise TrajectoryError(f"expected an exosystem state of {len(names)} finite entries {names}, got {x.tolist()}")
        x = self._sizes * x
        if at is None:
            return x
        return self._comparable.transition(finite_number("at", at, unit="s"), self.manoeuvre[0]) @ x


def _absolute(deviation: PiecewiseSignal, y_0: Array) -> PiecewiseSignal:
    return deviation + constant(y_0, at=deviation.manoeuvre[0]) if np.any(y_0) else deviation
