"""Modified inversion on the nonlinear motion of a mechanism: outputs bent, as little as need be, so that slow zeros rest."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import scipy  # loads scipy.optimize at its first use
from numpy.typing import ArrayLike, NDArray

from invtrack.arrays import Array, ComplexArray
from invtrack.errors import InversionError, PlanError
from invtrack.inversion.modified.modified_plan import ModifiedPlan, costly, output_sizes, wanted_motion
from invtrack.inversion.modified.moved_zeros import NAME_TOLERANCE, Wish, require_movable
from invtrack.inversion.nonlinear.bend import Bending, Bumps
from invtrack.inversion.nonlinear.continuation import Progress
from invtrack.inversion.nonlinear.linearizations import linearizations_along
from invtrack.inversion.nonlinear.problem import MotionProblem
from invtrack.inversion.nonlinear.solver import MotionSolver, Solution
from invtrack.inversion.nonlinear.stable_inversion import ON_AXIS, MotionPlan, checked_limits, confirmed
from invtrack.linear.internal_dynamics import format_zeros
from invtrack.plans.actuation import ringing
from invtrack.plans.problem import actuation_times, left_out_of
from invtrack.plans.ringing import LEVEL
from invtrack.references.profiles import constant
from invtrack.references.signal import PiecewiseSignal

TIME_CONSTANTS = -math.log(LEVEL)
"""Outputs are bent for so many time constants of the places where zeros are moved to: what dies out so fast is then below LEVEL."""

RESOLVED = 0.5
"""Knots of the bend are so close that this, or less, is their distance times the magnitude of the zeros that it puts to rest."""

LEAST_SPANS = 3
"""Stretches between knots, at least, in units of those that a single bump takes."""

SMOOTHER = 2
"""A bend has so many continuous derivatives beyond the relative degree, less one: inputs then have a continuous slope."""


@dataclass(frozen=True, eq=False, repr=False)
class ModifiedMotion(ModifiedPlan, MotionPlan):
    """A plan of `modified_inversion` for the nonlinear motion of a plant: its output is `bend` away from the wanted one.

    Args:
        bend: y - y_d, of all bends in the window that keep the moved zeros at rest outside of it that with the least integral of
            (bend / output_scale)^2.
        optimality_gap: share of that integral by which it could be less, to first order.
        window: from when to when outputs are bent [s].
        moved: the zeros of the start that are at rest before the window, and after it (k,) [rad/s].
        left: those that are not (n_z - k,) [rad/s].
    """

    bend: PiecewiseSignal = field(default_factory=lambda: constant(0.0))
    optimality_gap: float = 0.0
    window: tuple[float, float] = (0.0, 0.0)
    moved: ComplexArray = field(default_factory=lambda: np.zeros(0, dtype=complex))
    left: ComplexArray = field(default_factory=lambda: np.zeros(0, dtype=complex))

    @property
    def alpha(self) -> float:
        """Rate [rad/s] at which the input decays backward in time before the window; infinite where it is at rest there."""
        return min((float(zero.real) for zero in self.left if zero.real > ON_AXIS * abs(zero)), default=math.inf)


def modified_motion(
    problem: MotionProblem,
    wish: Wish,
    *,
    output_scale: ArrayLike | None = None,
    accuracy: float = 1e-8,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
    max_postactuation: float | None = None,
    progress: Progress | None = None,
) -> ModifiedMotion:
    """A motion of a mechanism near the wanted one in which chosen zeros are at rest before and after it.

    f(x, u) = x', h(x, u) = y_d + sum_j a_j phi_j for B-splines phi_j in a window of time, with the least such bend that leaves what
    belongs to these zeros at rest outside of the window: their unstable part before it, their stable part after it. Newton's steps
    are those of stable inversion, bordered by as many rows as zeros are moved. See `invtrack.modified_inversion`.

    Args:
        problem: mechanism, wanted outputs, changes.
        wish: which zeros are moved, and where to.
        output_scale: sizes at which errors of the outputs count alike (p,), or one for all.
        accuracy: largest output error, beside the bend, between the points where outputs are matched, as a share of the motion.
        tolerance: what counts as rest, as a share of peaks.
        max_preactuation, max_postactuation: limit these [s].
        progress: called with the share of the motion that has been found.
    """
    limits = checked_limits(accuracy, tolerance, max_preactuation, max_postactuation)
    start, end, reference = problem.internals[0], problem.internals[-1], problem.reference
    wish.require_known(start.zeros)
    moved, places = wish.named(start.zeros)
    require_movable(problem.linear_models[0], start, moved, interval=0, endless=False)
    _require_own_frequencies(start.zeros[moved], places[moved])
    begin, until = problem.manoeuvre
    reach = _reach(places[moved].real, 1.0), _reach(places[moved].real, -1.0)
    inside, window = _inside(reach, limits), (begin - reach[0], until + reach[1])
    rest = problem.linear_models[0].operating_point.y0
    motion = wanted_motion(reference, reference + constant(-rest, at=begin), problem.manoeuvre)
    sizes, bending = output_sizes(output_scale, motion), None
    if np.any(moved):
        degree = max(start.form.orders) + SMOOTHER
        bumps = Bumps(_knots(window, start.zeros[moved], degree), degree, sizes)
        at_rest = start.zeros[moved], _followed(start.zeros, end.zeros, moved)
        bending = Bending(bumps, at_rest, problem.dynamics[0].state_coordinates)
    solver = MotionSolver(problem.with_stops(window), accuracy, inside, progress, bending)
    zeros = start.zeros[moved], start.zeros[~moved]
    plan = _plan(problem, solver, solver.refined(), window, tolerance=tolerance, limits=limits, sizes=sizes, zeros=zeros)
    rings = ringing(plan)
    remarks = (*_none_moved(wish, moved), *plan.remarks, *costly(plan, output_sizes(None, motion)))
    return replace(plan, ringing=rings, remarks=remarks if rings is None else (*remarks, rings.remark))


def _plan(
    problem: MotionProblem,
    solver: MotionSolver,
    solution: Solution,
    window: tuple[float, float],
    *,
    tolerance: float,
    limits: tuple[float | None, float | None],
    sizes: Array,
    zeros: tuple[ComplexArray, ComplexArray],
) -> ModifiedMotion:
    """The plan for a motion, confirmed by the simulator.

    Args:
        problem: what was asked for.
        solver, solution: what was solved, and the motion that was found.
        window: from when to when outputs are bent [s].
        tolerance: what counts as rest, as a share of peaks.
        limits: longest preactuation and postactuation [s], or None.
        sizes: of the outputs at which their errors count alike (p,).
        zeros: of the start, those that are moved and those that are not.
    """
    bend, gap = constant(np.zeros(len(sizes)), at=window[0]), 0.0
    if solver.bending is not None:
        shooting, motion = solution.shooting, solution.motion
        bend, nodes = solver.bending.bumps.signal(motion.bend), shooting.nodes(motion)
        gap = shooting.step(motion, nodes, *shooting.misses(motion, nodes)).gap
    found = confirmed(solver.problem, solution, solver.outputs_of(solution.motion), solver.accuracy, exact=True)
    (begin, until), (_, left) = problem.manoeuvre, zeros
    preactuation, postactuation, limited = actuation_times(found.trajectory, problem.manoeuvre, tolerance, limits)
    if not np.any(left.real > ON_AXIS * np.abs(left)):  # before the window nothing moves but rounding, and after it
        preactuation = begin - window[0]
    if not np.any(left.real < -ON_AXIS * np.abs(left)):
        postactuation = window[1] - until
    return ModifiedMotion(
        method="modified inversion of the nonlinear plant",
        model=found.model,
        reference=problem.reference,
        trajectory=found.trajectory,
        manoeuvre=problem.manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=tolerance,
        certificate=found.certificate,
        remarks=(*limited, *left_out_of(found.model)),
        difference=problem.mechanism.state_difference if problem.mechanism.turns else None,
        linearizations=linearizations_along(solution.shooting, solution.motion),
        iterations=solution.log,
        checks=found.checks,
        output_scale=sizes,
        bend=bend,
        optimality_gap=gap,
        window=window,
        moved=zeros[0],
        left=left,
    )


def _require_own_frequencies(zeros: ComplexArray, places: ComplexArray) -> None:
    """Raises InversionError for zeros (k,) that are to go to places (k,) with other imaginary parts."""
    away = np.abs(places.imag - zeros.imag) > NAME_TOLERANCE * np.abs(zeros)
    if np.any(away):
        raise InversionError(
            f"on the nonlinear motion of a plant zeros are put to rest, not placed: of where they go only the real part counts, "
            f"which sets how long outputs are bent; got {format_zeros(zeros[away])} to {format_zeros(places[away])}; give each its "
            "own imaginary part"
        )


def _none_moved(wish: Wish, moved: NDArray[np.bool_]) -> tuple[str, ...]:
    """A remark where no zero is so near to the axis that it is moved."""
    if np.any(moved) or wish.axis_distance is None:
        return ()
    return (f"no zeros were moved: within {wish.axis_distance:g} rad/s of the imaginary axis there are none",)


def _reach(real_parts: Array, sign: float) -> float:
    """How long outputs are bent before (sign 1) or after (-1) the manoeuvre [s], for zeros that go to these real parts [rad/s]."""
    return TIME_CONSTANTS * float(np.max(1 / np.abs(real_parts[real_parts * sign > 0]), initial=0.0))


def _knots(window: tuple[float, float], zeros: ComplexArray, degree: int) -> Array:
    """Even knots over a window [s] for a bend of that degree that puts zeros [rad/s] to rest."""
    needed = math.ceil((window[1] - window[0]) * float(np.max(np.abs(zeros))) / RESOLVED)
    spans = max(LEAST_SPANS * (degree + 1), needed)
    return np.linspace(*window, spans + 1)


def _followed(start: ComplexArray, end: ComplexArray, moved: NDArray[np.bool_]) -> ComplexArray:
    """Those of the end's zeros (n_e,) that the moved ones of the start's (n_s,) lead to: nearest to them, all taken together."""
    rows, columns = scipy.optimize.linear_sum_assignment(np.abs(start[:, None] - end[None]))
    return np.asarray(end[columns[moved[rows]]])


def _inside(reach: tuple[float, float], limits: tuple[float | None, float | None]) -> tuple[float | None, float | None]:
    """What limits [s] leave before and after the window, which reaches so far [s]. Raises PlanError for less than none."""
    for name, own, limit in zip(("preactuation", "postactuation"), reach, limits, strict=True):
        if limit is not None and limit < own:
            raise PlanError(
                f"outputs are to be bent from {reach[0]:.4g} s before the manoeuvre to {reach[1]:.4g} s after it, for that is how "
                f"long what dies out at the real parts asked for takes to fall to {LEVEL:g}; max_{name}={limit:g} s does not allow "
                "that: move the zeros farther, or leave the limit out"
            )
    before, after = (None if limit is None else limit - own for own, limit in zip(reach, limits, strict=True))
    return before, after
