"""The planner for references that are known only some time ahead: at each update it looks at what is new and plans a period."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import Array, finite_number, real_number
from invtrack.errors import PlanError, TrajectoryError
from invtrack.plans.plan import Samples
from invtrack.plans.problem import require_reference
from invtrack.preview.horizon import Horizon
from invtrack.preview.known import Deviations, Stretch, state_at, stretches
from invtrack.preview.law import PreviewLaw
from invtrack.preview.output_chain import held_outputs
from invtrack.preview.plan_piece import PlanPiece
from invtrack.references.profiles import constant
from invtrack.references.signal import JUMP_TOLERANCE, PiecewiseSignal

WHOLE = 1e-9
"""Share of a period by which the preview may be off a whole number of periods."""

MOST_PERIODS = 10**5
"""Periods that a planner looks ahead, at most."""


@dataclass(frozen=True, eq=False)
class Foreseen:
    """What a planner foresees for the instant of its next update: z_f, z_b = Phi z_f + phi, in an interval of the plant."""

    interval: int
    z_f: Array
    phi: Array


class PreviewPlanner:
    """Plans period by period for a reference that is known only `preview` seconds ahead.

    At update j, at t_j = start + j period, the reference is known up to t_j + preview. Beyond that it is taken to go on with the
    derivatives that it has there, as a polynomial with y^(r) = 0: of all y^(r) that may follow, none larger than 1, it is the
    middle, and no other guess has a smaller largest error. What is new at an update changes the plan by no more than it decays over
    the preview, at the rate of the slowest antistable zero, of a redesign of the slowest closed-loop pole.

    Made by `inversion_planner` and `redesign_planner`; `law` is the method on its plant, `preview` and `period` [s] are what it was
    made for.
    """

    def __init__(self, law: PreviewLaw, *, preview: float, period: float, start: float, held: ArrayLike | None) -> None:
        """From the law of a method.

        Args:
            law: the method on its plant.
            preview, period, start, held: see `inversion_planner`.
        """
        self.law = law
        self.period = positive_time("period", period)
        self.preview = positive_time("preview", preview)
        count = round(min(self.preview / self.period, 2.0 * MOST_PERIODS))
        if count < 1 or count > MOST_PERIODS or abs(self.preview - count * self.period) > WHOLE * self.period:
            nearest = max(1, min(count, MOST_PERIODS)) * self.period
            raise PlanError(
                f"preview must be a whole number of periods, from 1 to {MOST_PERIODS}, got {preview} s for a period of "
                f"{period} s; take for instance {nearest:.9g} s"
            )
        start = finite_number("start", start, unit="s", error=PlanError)
        plant = law.plant
        first = int(np.searchsorted(plant.switch_times, start, side="right"))
        y_0 = plant.rest_outputs[first] if held is None else held_outputs("held", held, plant)
        self._count, self._number = count, 0
        self._deviations = Deviations(law)
        zeta = np.append(law.chain.at_rest(y_0), 1.0)
        self._horizon = Horizon(law, start, self.period, count, zeta)
        self._cells: deque[list[Stretch]] = deque()
        self._told: PiecewiseSignal | None = None
        still = constant(y_0, at=start)
        for number in range(count - 1):
            self._know(self._stretches(still, number))
        self._phi = self._horizon.phi(0)
        # At rest before: z_f is what the outputs make of it, nothing more.
        self._z_f = np.zeros(len(law.intervals[first].G_f))
        self._x: Array | None = None
        if law.keeps_state:
            each, z_b = law.intervals[first], self._phi
            J_f, J_b = (part.J[: plant.n_states] for part in (each.system.forward, each.system.backward))
            self._x = J_f @ self._z_f + J_b @ z_b + each.J_zeta[: plant.n_states] @ (zeta[:-1] - each.rest) + each.plant.rest

    @property
    def method(self) -> str:
        """Its name."""
        return self.law.method

    @property
    def time(self) -> float:
        """When the next update is due [s]."""
        return self._horizon.time(self._number)

    @property
    def known_until(self) -> float:
        """Up to where the reference has been looked at [s]; what an update is told before this time is not looked at again."""
        return self._horizon.end

    @property
    def foreseen(self) -> Foreseen:
        """What is foreseen for the next update."""
        return Foreseen(int(self.law.plant.interval(self.time)), self._z_f, self._phi)

    def present(self) -> Samples:
        """State, input and outputs that are foreseen for `time`, each one row."""
        law, ahead = self.law, self.foreseen
        each, (n, m) = law.intervals[ahead.interval], (law.plant.n_states, law.plant.n_inputs)
        zeta, chi = self._horizon.zeta[:-1], np.zeros(law.plant.n_outputs)
        if self._cells:
            first = self._cells[0][0]
            zeta, chi = first.carrier.zeta @ first.w_start + each.rest, first.carrier.chi @ first.w_start
        Phi = law.slope(ahead.interval, self.time)
        z_f = ahead.z_f if self._x is None else law.forward_state(ahead.interval, Phi, self._x, ahead.phi, zeta)
        z_b = ahead.phi if Phi is None else Phi @ z_f + ahead.phi
        values = each.columns[0] @ z_f + each.columns[1] @ z_b + each.X_zeta @ (zeta - each.rest) + each.X_chi @ chi
        point = each.plant.operating_point
        x, u, y = np.split(values + np.concatenate([each.plant.rest, point.u0, point.y0]), [n, n + m])
        y_d = zeta[law.chain.values]
        return Samples(np.array([self.time]), x[np.newaxis], u[np.newaxis], y[np.newaxis], y_d[np.newaxis])

    def update(self, reference: PiecewiseSignal | None = None) -> PlanPiece:
        """The plan for the next period, from `time` to `time` + period.

        reference: the wanted output, absolute, as far as it is known; looked at from `known_until` to `time` + preview only, where
        it must go on from what was known there. None: nothing new, the outputs go on as they are taken to.

        Raises TrajectoryError for a reference with a wrong number of channels, one that is not smooth enough, and one that does not
        go on from where the last one was left.
        """
        number, law = self._number, self.law
        known = self._stretches(self._checked(reference), number + self._count - 1)
        self._know(known)
        cell = self._cells.popleft()
        end = self._horizon.phi(number + 1)
        before = self._horizon.before(cell, end)
        phi, change = before[-1], before[-1] - self._phi
        first = cell[0]
        each, Phi = law.intervals[first.interval], first.Phi[0] if first.Phi else None
        zeta = first.carrier.zeta @ first.w_start
        z_f = self._z_f if self._x is None else law.forward_state(first.interval, Phi, self._x, phi, zeta + each.rest)
        piece = self._piece(cell, z_f, phi, before[:-1], law.response(first.interval, Phi) @ change, zeta)
        self._phi, self._number = end, number + 1
        return piece

    def _piece(self, cell: list[Stretch], z_f: Array, phi: Array, asked: list[Array], change: Array, zeta: Array) -> PlanPiece:
        """The piece of a period; takes the planner's state to its end.

        Args:
            cell: the period's stretches.
            z_f: at its start.
            phi, asked: right after its start, and right before the end of each stretch.
            change: of [x; u; y] at the start against the last plan.
            zeta: at the start, as deviation from rest.
        """
        law, (n, m) = self.law, (self.law.plant.n_states, self.law.plant.n_inputs)
        first, each = cell[0], law.intervals[cell[0].interval]
        z_b = phi if first.Phi is None else first.Phi[0] @ z_f + phi
        values = (
            each.columns[0] @ z_f + each.columns[1] @ z_b + each.X_zeta @ zeta + each.X_chi @ (first.carrier.chi @ first.w_start)
        )
        starts, ends, times = [], [], law.plant.switch_times
        for stretch, at_end in zip(cell, asked, strict=True):
            starts.append(z_f)
            z_f = stretch.carrier.decay_f @ z_f + stretch.carrier.f @ stretch.w_start
            z_b = at_end if stretch.Phi is None else stretch.Phi[1] @ z_f + at_end
            ends.append(z_b)
            if self._x is not None:
                own = law.intervals[stretch.interval]
                parts = (own.system.forward.J[:n], own.system.backward.J[:n], own.J_zeta[:n])
                self._x = parts[0] @ z_f + parts[1] @ z_b + parts[2] @ (stretch.zeta[:-1] - own.rest) + own.plant.rest
            if stretch.interval < len(times) and stretch.end == times[stretch.interval]:
                z_f = law.junctions[stretch.interval].forward @ np.concatenate([z_f, z_b, stretch.zeta])
        self._z_f = z_f
        return PlanPiece(
            law=law,
            stretches=cell,
            starts=starts,
            ends=ends,
            x=values[:n] + each.plant.rest,
            u=values[n : n + m] + each.plant.operating_point.u0,
            state_change=change[:n],
            input_change=change[n : n + m],
        )

    def _checked(self, reference: PiecewiseSignal | None) -> PiecewiseSignal:
        """The reference, smooth enough and, where it is another one than last time, one that goes on from where that was left."""
        if reference is None:
            self._told = None
            return self._extension()
        if reference is not self._told:
            require_reference(self.law.plant, reference)
            self.law.chain.require_smooth(reference, self.law.plant.outputs.names)
            self._require_going_on(reference)
            self._told = reference
        return reference

    def _require_going_on(self, reference: PiecewiseSignal) -> None:
        chain, left, time = self.law.chain, self._horizon.zeta[:-1], self._horizon.end
        piece = int(np.searchsorted(reference.breakpoints, time, side="right"))
        generator = reference.generators[reference.kind[piece]]
        goes_on = chain.zeta(generator) @ state_at(reference, piece, time)
        sizes = np.concatenate([[reference.size(k)[i] for k in range(order)] for i, order in enumerate(chain.orders)])
        if np.any(np.abs(goes_on - left) > JUMP_TOLERANCE * np.maximum(sizes, np.abs(left))):
            raise TrajectoryError(
                f"the reference must go on at {time:.6g} s from where it was known to: the outputs and their derivatives are "
                f"{left.tolist()} there, got {goes_on.tolist()}; let a new target begin there, for instance with "
                "invtrack.rest_to_rest(..., start_time=planner.known_until)"
            )

    def _extension(self) -> PiecewiseSignal:
        """The polynomials as which the outputs go on."""
        generator, p = self.law.chain.generator, len(self.law.chain.orders)
        w = np.concatenate([self._horizon.zeta[:-1], np.zeros(p)])
        return PiecewiseSignal(np.array([self._horizon.end]), (generator,), np.zeros(2, dtype=np.intp), np.array([w, w]))

    def _stretches(self, reference: PiecewiseSignal, number: int) -> list[Stretch]:
        return stretches(self.law, self._deviations, reference, self._horizon.time(number), self._horizon.time(number + 1))

    def _know(self, cell: list[Stretch]) -> None:
        self._horizon.append(cell)
        self._cells.append(cell)


def positive_time(name: str, value: float) -> float:
    """The time [s]; raises PlanError unless it is positive and finite."""
    number = real_number(name, value, unit="s", error=PlanError)
    if not (0 < number < np.inf):
        raise PlanError(f"{name} must be positive and finite, got {value}")
    return number
