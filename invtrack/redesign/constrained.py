"""Optimal output-trajectory redesign under hard limits on inputs, their rates, outputs and states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.checks import require_duration
from invtrack.errors import RedesignError
from invtrack.linear.switched import as_switched
from invtrack.plans.certificate import certify
from invtrack.plans.ends import actuation_times
from invtrack.plans.plan import Plan, TwoSidedTrajectory
from invtrack.plans.problem import deviation_reference
from invtrack.redesign.limited.discretization import Tail
from invtrack.redesign.limited.limit_check import ActiveLimit, active_limits
from invtrack.redesign.limited.window import KEPT, LimitedProblem, LimitedSolution, free_excess, solve_limited
from invtrack.redesign.limits import Bound, Limits, bounds_of
from invtrack.redesign.quadratic import ACCURACY, quadratic_redesign
from invtrack.redesign.weights import Weights, as_weights
from invtrack.references.signal import PiecewiseSignal

Array = NDArray[np.float64]

METHOD = "constrained redesign"

LEAST_MARGIN = 1e-6
"""How far inside its limits a plan must be at rest, as a share of their size: a tail that dies out there keeps within them."""


@dataclass(frozen=True, eq=False, repr=False)
class ConstrainedTrajectory(Plan):
    """A plan with limits.

    Args:
        active: the limits that it touches, and when.
        overshoot: largest excess of any limit anywhere, as a share of the limit's size; zero where all are kept.
        step: longest time over which the input is linear [s]. Zero where no limit is active: the plan is then the optimum without
            limits, in closed form.
    """

    active: tuple[ActiveLimit, ...] = field(default=())
    overshoot: float = 0.0
    step: float = 0.0


def constrained_redesign(
    model: Any,
    reference: PiecewiseSignal,
    *,
    R: ArrayLike,
    Q_x: ArrayLike = 0.0,
    Q_y: ArrayLike,
    limits: Limits,
    step: float | None = None,
    tolerance: float = 1e-10,
    max_preactuation: float | None = None,
) -> ConstrainedTrajectory:
    """The trajectory of `model` that costs least among those that keep within `limits`, over all of time.

    minimise  integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d)
    subject to  x' = A_k x + B_k (u - u0),  low <= u, u', y, c'x <= high.

    Where the optimum without limits keeps within them it is returned as it is. Otherwise the input is continuous (but for the jumps
    of B and D) and linear in time over steps within a window around the manoeuvre; before and after the window the plan is the
    optimum without limits in closed form, whose exact cost is part of the programme, so no horizon is truncated. The window is
    widened until that part keeps within the limits too and none acts where it joins; then nothing is lost by leaving them out
    there. Within a step transitions and costs are exact (matrix exponentials). Inputs and rates keep their limits at every instant,
    to rounding; states and outputs to 1e-6 of them, checked between the steps' ends, where further instants are imposed as needed.
    As `step` goes to zero the plan tends to the optimum among all inputs, its cost and its input with an error of order step^2 away
    from the instants at which a limit begins or ceases to act.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D.
        reference: wanted outputs, absolute, in their units, held still before and after the manoeuvre.
        R: weight of the inputs (p, p), positive definite; a number stands for that multiple of the identity, here and below.
        Q_x: weight of the states (n, n), positive semidefinite.
        Q_y: weight of the output errors (p, p), positive semidefinite.
        limits: what the plan must never exceed.
        step: longest time over which the input is linear [s]; by default such that linear interpolation of the optimal input
            without limits misses it by 1e-5 of its peak (up to 1e-3 where that takes many steps).
        tolerance: share of its peak below which what is left of the plan before its start and after its end counts as rest.
        max_preactuation: longest time before the manoeuvre at which the plan may start [s]; None: as long as the tolerance asks.

    Raises what `quadratic_redesign` does, and RedesignError for limits that make no sense, that the plan at rest before or after
    the manoeuvre does not keep, or that cannot be kept all at once: which conflict and how far one has to give way.
    Method: dual-mode quadratic programming (P. Scokaert, J. Rawlings, "Constrained linear quadratic regulation", IEEE Trans.
    Automatic Control 43(8), 1998), in continuous time and at both ends.
    """
    if step is not None:
        require_duration("step", step, error=RedesignError)
    plant = as_switched(model)
    bounds = bounds_of(limits, plant)
    weights = as_weights(plant, R=R, Q_x=Q_x, Q_y=Q_y)
    free = quadratic_redesign(
        plant, reference, R=weights.R, Q_x=weights.Q_x, Q_y=weights.Q_y, tolerance=tolerance, max_preactuation=max_preactuation
    )
    tails, v = _tails(free.trajectory, weights)
    _require_rest_within(tails, bounds)
    problem = LimitedProblem(
        plant=plant,
        reference=deviation_reference(plant, reference),
        weights=weights,
        bounds=bounds,
        free=free.trajectory,
        tails=tails,
        v=v,
    )
    if free_excess(problem) <= KEPT:
        return _unlimited(free)
    return _plan(problem, solve_limited(problem, step), free, max_preactuation)


def _tails(optimum: TwoSidedTrajectory, weights: Weights) -> tuple[tuple[Tail, Tail], tuple[Array, Array]]:
    """The tails before and after an optimum without limits, and the v that each has there."""
    before, after = (optimum.generators[optimum.kind[place]] for place in (0, -1))
    ends = (
        (-before.M_b, before.X_b, optimum.v_b[0, : len(before.M_b)], -1),
        (after.M_f, after.X_f, optimum.v_f[-1, : len(after.M_f)], 1),
    )
    tails, v = [], []
    for M, X, state, direction in ends:  # state [s; 1] with s' = M_s s + M_1: relative to where s comes to rest
        rest = -np.linalg.solve(M[:-1, :-1], M[:-1, -1]) * state[-1]
        held = X[:, :-1] @ rest + X[:, -1] * state[-1]
        tails.append(Tail(M[:-1, :-1], X[:, :-1], held, direction, weights))
        v.append(state[:-1] - rest)
    return (tails[0], tails[1]), (v[0], v[1])


def _unlimited(free: Plan) -> ConstrainedTrajectory:
    inherited = {each.name: getattr(free, each.name) for each in fields(Plan)}
    remarks = (*free.remarks, "no limit is active: this is the optimum without limits")
    return ConstrainedTrajectory(**{**inherited, "method": METHOD, "remarks": remarks})


def _plan(problem: LimitedProblem, solution: LimitedSolution, free: Plan, max_preactuation: float | None) -> ConstrainedTrajectory:
    """The solution with its ends, its certificate and what a user should know; `free`: the plan without limits."""
    trajectory, manoeuvre = solution.trajectory, problem.reference.manoeuvre
    preactuation, postactuation, remarks = _actuation_times(problem, solution, free.tolerance, max_preactuation)
    span = (manoeuvre[0] - preactuation, manoeuvre[1] + postactuation)
    certificate = certify(problem.plant, trajectory, problem.reference, span)
    worst = max(certificate.dynamics_residual, certificate.continuity)
    if not worst <= ACCURACY:
        raise RedesignError(
            "the limited redesign is too ill-conditioned to be trusted: the plan misses the plant's equations by "
            f"{worst:.1e} of its size ({certificate}); take a larger step, or bring weights and units closer to each other"
        )
    active = active_limits(trajectory, problem.bounds)
    steps = len(trajectory.breakpoints) - 1
    return ConstrainedTrajectory(
        method=METHOD,
        model=problem.plant,
        reference=free.reference,
        trajectory=trajectory,
        manoeuvre=manoeuvre,
        preactuation=preactuation,
        postactuation=postactuation,
        tolerance=free.tolerance,
        certificate=certificate,
        remarks=(
            *remarks,
            f"the input is linear in time over {steps} steps of up to {solution.step:.4g} s",
            *map(str, active),
            *([f"a limit is exceeded by {solution.overshoot:.1e} of it between steps"] if solution.overshoot > KEPT else []),
        ),
        active=active,
        overshoot=solution.overshoot,
        step=solution.step,
    )


def _actuation_times(
    problem: LimitedProblem, solution: LimitedSolution, tolerance: float, limit: float | None
) -> tuple[float, float, tuple[str, ...]]:
    """How long [s] before and after the manoeuvre the plan is away from rest; the window counts as away throughout."""
    trajectory, (start, end) = solution.trajectory, problem.reference.manoeuvre
    edges = trajectory.breakpoints
    departures = tuple(tail.departure(v) for tail, v in zip(problem.tails, solution.v, strict=True))
    before, after, _ = actuation_times(trajectory, (departures[0], departures[1]), tolerance, None)
    preactuation, postactuation = start - edges[0] + before, edges[-1] - end + after
    if limit is None or preactuation <= limit:
        return preactuation, postactuation, ()
    at = np.concatenate([[start - limit], edges])
    values = np.abs(trajectory(at, trajectory.locate(at)) - np.outer(at < start, problem.tails[0].held))
    peak = np.max(values, axis=0)
    share = float(np.max(values[0] / np.where(peak > 0, peak, 1.0)))
    return limit, postactuation, (f"preactuation limited to {limit} s: the plan starts {share:.1e} of its peak away from rest",)


def _require_rest_within(tails: tuple[Tail, Tail], bounds: Sequence[Bound]) -> None:
    """Raises RedesignError where the plan at rest lies outside a limit, or so near to one that nothing may move there."""
    for tail, when in zip(tails, ("before", "after"), strict=True):
        for bound in bounds:
            rest = 0.0 if bound.kind == "input rate" else float(bound.row @ tail.held)
            if bound.excess(np.array(rest)) > -LEAST_MARGIN:
                at, low, high = rest + bound.offset, bound.low + bound.offset, bound.high + bound.offset
                raise RedesignError(
                    f"limits that cannot be kept: at rest {when} the manoeuvre {bound.name} is {at:.6g}, expected strictly between "
                    f"its limits {low:.6g} and {high:.6g} (off by {max(low - at, at - high):.3g}); loosen that limit, or choose "
                    "another operating point or held value"
                )
