"""Modified inversion: exactness given up, as little as need be, for a shorter preactuation or where no exact inverse exists."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import one_of
from invtrack.arrays import Array, ComplexArray
from invtrack.errors import InversionError, RelativeDegreeError
from invtrack.inversion.inverse_system import require_square
from invtrack.inversion.modified.default_error_poles import default_error_poles
from invtrack.inversion.modified.design import least_error_design, robust_design
from invtrack.inversion.modified.design_problem import Candidate, DesignProblem
from invtrack.inversion.modified.modified_dynamics import equilibrium, has_equilibrium, undivided_dynamics
from invtrack.inversion.modified.modified_plan import ModifiedPlan, costly, output_sizes, wanted_motion
from invtrack.inversion.modified.motion_planner import motion_planner
from invtrack.inversion.modified.moved_zeros import Wish, intervals_named, require_movable
from invtrack.inversion.modified.placement import MovablePart, movable_part
from invtrack.inversion.motion_options import checked_motion_options, require_no_schedule
from invtrack.inversion.smoothness import require_smooth
from invtrack.linear.internal_dynamics import InternalDynamics, format_zeros
from invtrack.linear.switched import SwitchedSystem
from invtrack.plans.dynamics import ScheduledChange, mechanism
from invtrack.plans.problem import PlanningProblem
from invtrack.references.signal import PiecewiseSignal

Design = Literal["least error", "robust"]

HELD_TOLERANCE = 1e-9
"""A held output counts as in equilibrium where what is left of the internal dynamics is below this share of its terms."""


@dataclass(frozen=True, eq=False)
class Modification:
    """How the inverse was modified in one interval: v = F [e; eta - eta_eq] + L [zeta_d; y_d^(r)].

    F and L refer to the coordinates of `normal_form`; e = zeta - zeta_d, eta_eq the internal equilibrium of the held output.

    Args:
        interval: its number.
        F, L: (p, n) and (p, rho + p).
        zeros_before: the plant's zeros (n_z,) [rad/s].
        zeros_after: where they went, in the same order.
        error_poles: poles of e (rho,) [rad/s].
    """

    interval: int
    F: Array
    L: Array
    zeros_before: ComplexArray
    zeros_after: ComplexArray
    error_poles: ComplexArray

    @property
    def alpha(self) -> float:
        """Smallest positive real part [rad/s] of the modified inverse's poles; infinite where none is antistable (no preactuation).

        It is the rate at which the input before the manoeuvre decays backward in time.
        """
        return min((float(s.real) for s in self.zeros_after if s.real > 0), default=math.inf)

    def __str__(self) -> str:
        moved = np.abs(self.zeros_after - self.zeros_before) > 0
        pairs = [(a, b) for a, b in zip(self.zeros_before[moved], self.zeros_after[moved], strict=True) if a.imag >= 0]
        text = ", ".join(f"{format_zeros(a)} to {format_zeros(b)}" for a, b in pairs) or "none"
        return f"interval {self.interval}: zeros moved: {text}; alpha = {self.alpha:.4g} rad/s"


@dataclass(frozen=True, eq=False, repr=False)
class ModifiedTrajectory(ModifiedPlan):
    """A plan of `modified_inversion` for a linear model: a trajectory whose output is near the wanted one, not on it.

    Args:
        modification: of each interval.
        design: name of the choice taken.
        candidates: the choices that were worked out and compared; none for the robust design.
    """

    modification: tuple[Modification, ...] = ()
    design: str = ""
    candidates: tuple[Candidate, ...] = ()

    @property
    def alpha(self) -> float:
        """Rate [rad/s] at which the input decays backward in time before the manoeuvre; infinite without preactuation."""
        return self.modification[0].alpha


def modified_inversion(
    model: Any,
    reference: PiecewiseSignal,
    *,
    error_poles: Sequence[complex] | None = None,
    move: Mapping[complex, complex] | None = None,
    axis_distance: float | None = None,
    real_part: float | None = None,
    interval: int | Sequence[int] | None = None,
    design: Design = "least error",
    output_scale: ArrayLike | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
    schedule: Sequence[ScheduledChange] = (),
    accuracy: float = 1e-8,
    progress: Callable[[float], None] | None = None,
) -> ModifiedPlan:
    """A bounded trajectory of the plant near `reference`, from an inverse some of whose poles (zeros of the plant) are moved.

    u = B_y^-1 [y_d^(r) - A_x x + v], v = F [e; eta - eta_eq] + L [zeta_d; y_d^(r)], e = zeta - zeta_d. F moves the zeros asked for
    and places the chains of integrators of e; the other zeros stay. eta_eq is the internal equilibrium of the held output and L
    acts on derivatives of y_d alone, so the output comes to rest on its target. What comes back is a ModifiedTrajectory.

    A Plant is planned for as it moves (`invert`), with outputs y = y_d + sum_j a_j phi_j: of all such bends, in B-splines phi_j,
    that leave what belongs to the moved zeros at rest before and after them that with the least integral of the squares of
    bend / output_scale. No law of feedback is in it, so zeros are put to rest rather than placed: where one goes to says how long
    outputs are bent, until what dies out with that real part has fallen to 1 %, before the manoeuvre for a positive one, after it
    for a negative one. The other zeros keep their tails. What comes back is a ModifiedMotion.

    Args:
        model, reference, tolerance, max_preactuation, max_postactuation, schedule, accuracy, progress: as for `invert`.
        error_poles: poles of e [rad/s], as many as the relative degrees add up to, output by output; by default a Butterworth
            pattern for each output, 1.25 times as fast as the fastest place to which a zero is moved (see `default_error_poles`).
            A Plant has none.
        move: {zero: where it goes} [rad/s], zeros to four digits, conjugates implied.
        axis_distance, real_part: instead of `move`, all zeros with |Re| <= axis_distance get that real part [rad/s] (positive:
            still preactuation, but faster; negative: postactuation instead).
        interval: number or numbers of the intervals of a switched model in which zeros are moved; None: all. A zero named in `move`
            is moved in those of them that have it. A Plant's zeros are named as they are at the start.
        design: "least error" works out several choices of the freedom in F (several outputs) and L (least squares) and keeps the
            one with the least integral square of the error for this reference; "robust" places robustly, L = 0. A Plant's bend
            is always the least one.
        output_scale: sizes at which errors of the outputs count alike (p,), or one for all; by default the peak of each output's
            motion, and the largest of these for outputs that hold still.

    Raises PlanError (options out of range; too ill-conditioned), InversionError (other options, zeros that cannot be moved,
    no equilibrium for the held output), NonHyperbolicError (zeros on the axis not moved), TrajectoryError, RelativeDegreeError,
    BoundednessError, and for a Plant what `invert` raises. Source: Devasia 1996 (non-hyperbolic internal dynamics), eqs. 12-18.
    """
    one_of("design", design, get_args(Design), error=InversionError)
    wish = Wish(move, axis_distance, real_part)
    schedule, moving = checked_motion_options(schedule, accuracy, progress), mechanism(model)
    if moving is not None:
        _, planned = motion_planner(
            moving,
            reference,
            error_poles=error_poles,
            interval=interval,
            design=design,
            output_scale=output_scale,
            tolerance=tolerance,
            max_preactuation=max_preactuation,
            max_postactuation=max_postactuation,
            schedule=schedule,
            accuracy=accuracy,
            progress=progress,
        )
        return planned(wish)
    require_no_schedule(schedule)
    planning = PlanningProblem.of(
        model, reference, tolerance=tolerance, max_preactuation=max_preactuation, max_postactuation=max_postactuation
    )
    plant, deviation = planning.plant, planning.deviation
    require_square(plant, "modified_inversion")
    splits = undivided_dynamics(plant)
    require_smooth(plant, [split.internal for split in splits], deviation)
    internals = [split.internal for split in splits]
    _require_relative_degree(plant, internals)
    duration = planning.manoeuvre[1] - planning.manoeuvre[0]
    choices = _choices(plant, internals, wish, intervals_named(interval, len(plant)), error_poles, duration)
    _require_equilibrium(plant, internals, deviation)
    motion = wanted_motion(reference, deviation, planning.manoeuvre)
    scale = output_sizes(output_scale, motion)
    problem = DesignProblem(planning, internals, [c[0] for c in choices], [c[2] for c in choices], scale)
    solved = least_error_design(problem) if design == "least error" else robust_design(problem)
    remarks = solved.solution.remarks + solved.remarks
    if axis_distance is not None and not any(len(part.targets) for part in problem.parts):
        remarks += (
            f"no zeros were moved: within {axis_distance:g} rad/s of the imaginary axis there are none that are not at "
            f"{real_part:g} already",
        )
    plan = planning.plan(
        "modified inversion",
        solved.solution.trajectory,
        exact=False,
        remarks=remarks,
        kind=ModifiedTrajectory,
        modification=tuple(
            Modification(k, dynamics.F, L + dynamics.feedthrough, internal.zeros, after, part.error_poles)
            for k, (dynamics, L, internal, (part, after, _)) in enumerate(
                zip(solved.dynamics, solved.L, internals, choices, strict=True)
            )
        ),
        design=solved.name,
        candidates=solved.candidates,
        output_scale=scale,
    )
    remark = costly(plan, output_sizes(None, motion))
    return replace(plan, remarks=(*plan.remarks, *remark)) if remark else plan


def _choices(
    plant: SwitchedSystem,
    internals: Sequence[InternalDynamics],
    wish: Wish,
    named: list[int],
    error_poles: Sequence[complex] | None,
    duration: float,
) -> list[tuple[MovablePart, ComplexArray, ComplexArray]]:
    """Per interval: the part to place, all zeros where they go, and those that stay.

    Args:
        plant: with its intervals.
        internals: internal dynamics of each.
        wish: which zeros go where.
        named: in which intervals.
        error_poles: poles of the outputs' errors [rad/s], or None for the default.
        duration: of the manoeuvre [s].
    """
    wish.require_known(np.concatenate([internals[k].zeros for k in named]))
    stay = [(np.zeros(len(internal.zeros), dtype=bool), internal.zeros) for internal in internals]
    wishes = [wish.targets(internal.zeros) if k in named else stay[k] for k, internal in enumerate(internals)]
    places = np.concatenate([after[moved] for moved, after in wishes])
    choices = []
    for k, (system, internal, (moved, after)) in enumerate(zip(plant.systems, internals, wishes, strict=True)):
        require_movable(system, internal, moved, interval=k, endless=k in (0, len(plant) - 1))
        poles = default_error_poles(internal.form.orders, places, duration) if error_poles is None else error_poles
        choices.append((movable_part(internal, moved, after, poles), after, internal.zeros[~moved]))
    return choices


def _require_relative_degree(plant: SwitchedSystem, internals: Sequence[InternalDynamics]) -> None:
    """Raises RelativeDegreeError where the outputs' errors are no chains of integrators."""
    for k, internal in enumerate(internals):
        if internal.form.combined:
            raise RelativeDegreeError(
                f"interval {k}: the outputs {list(plant.outputs.names)} have no vector relative degree, which moving zeros needs; "
                "invtrack.invert, invtrack.quadratic_redesign and invtrack.constrained_redesign do without, and other outputs may "
                "have one"
            )


def _require_equilibrium(plant: SwitchedSystem, internals: Sequence[InternalDynamics], deviation: PiecewiseSignal) -> None:
    """With a zero at the origin not every value of the output can be held: those held at the ends have to be among them."""
    for internal, t in ((internals[0], deviation.breakpoints[0] - 1.0), (internals[-1], deviation.breakpoints[-1] + 1.0)):
        if has_equilibrium(internal):
            continue
        held = deviation(t)
        left = equilibrium(internal).residual @ held
        terms = np.linalg.norm(np.hstack([internal.A_zeta, internal.B_r])) * np.max(deviation.size(0))
        if np.linalg.norm(left) > HELD_TOLERANCE * terms:
            raise InversionError(
                f"a zero at the origin: the internal dynamics have no equilibrium in which the outputs "
                f"{list(plant.outputs.names)} hold {held.tolist()} (deviations from the operating point), so the inverse "
                "cannot come to rest; let the reference start and end at the operating point, or track another output"
            )
