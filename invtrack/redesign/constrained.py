"""Optimal output-trajectory redesign under hard limits on inputs, their rates, outputs and states."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arrays import require_duration
from invtrack.errors import RedesignError
from invtrack.plans.plan import Plan
from invtrack.plans.tail import Tail
from invtrack.redesign.cost import as_weights
from invtrack.redesign.limited.active_limits import ActiveLimit, active_limits
from invtrack.redesign.limited.optimality import Optimality
from invtrack.redesign.limited.window import KEPT, LimitedProblem, free_excess, solve_limited
from invtrack.redesign.limits import Bound, Limits, bounds_of
from invtrack.redesign.quadratic import free_optimum
from invtrack.references.signal import PiecewiseSignal

METHOD = "constrained redesign"

LEAST_MARGIN = 1e-6
"""How far inside its limits a plan must be at rest, as a share of their size: a tail that dies out there keeps within them."""


@dataclass(frozen=True, eq=False, repr=False)
class ConstrainedTrajectory(Plan):
    """A plan with limits.

    Args:
        limits: all that it has to keep.
        active: those that it touches, when, and what more room there would be worth.
        overshoot: largest excess of any limit anywhere, as a share of the limit's size; zero where all are kept.
        step: longest time over which the input is linear [s]. Zero where no limit is active: the plan is then the optimum without
            limits, in closed form.
        optimality: cost and duality gap, how far from the best plan within the limits it can be; None where no limit is active.
    """

    limits: tuple[Bound, ...] = ()
    active: tuple[ActiveLimit, ...] = ()
    overshoot: float = 0.0
    step: float = 0.0
    optimality: Optimality | None = None

    @property
    def shadow_prices(self) -> dict[str, float]:
        """By how much the cost falls per unit by which each limit is loosened on both of its sides, to first order.

        For a limit that was stated as one number it is minus the derivative of the cost by it; zero for limits that are not active.
        """
        return {limit.name: sum((a.multiplier for a in self.active if a.name == limit.name), start=0.0) for limit in self.limits}

    def __str__(self) -> str:
        """What it is, and a table of its limits: how long each side acts, and what one unit more there would save."""
        head = [repr(self)]
        if self.optimality is not None:
            cost, gap = self.optimality.cost, self.optimality.duality_gap
            head.append(f"cost {cost:.6g}; the best plan within the limits costs less by a share of {gap:.0e} at most")
        rows = [("limit", "unit", "side", "value", "active [s]", "stretches", "cost saved per unit")]
        for limit in self.limits:
            for side, value in (("low", limit.low), ("high", limit.high)):
                if np.isfinite(value):
                    at = f"{value + limit.offset:.6g}"
                    rows.append((limit.name, limit.unit or "-", side, at, *self._activity(limit.name, side)))
        widths = [max(map(len, column)) + 2 for column in zip(*rows, strict=True)]
        lines = ("".join(f"{entry:<{width}}" for entry, width in zip(row, widths, strict=True)).rstrip() for row in rows)
        return "\n".join([*head, *lines])

    def _activity(self, name: str, side: str) -> tuple[str, str, str]:
        """How long a side of a limit acts, in how many stretches, and what one unit more saves, as text."""
        for each in self.active:
            if (each.name, each.side) == (name, side):
                return f"{each.duration:.4g}", str(len(each.stretches)), f"{each.multiplier:.4g}"
        return "0", "0", "0"


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
    max_postactuation: float | None = None,
) -> ConstrainedTrajectory:
    """The trajectory of `model` that costs least among those that keep within `limits`, over all of time.

    minimise  integral of (u - u0)'R (u - u0) + x'Q_x x + (y - y_d)'Q_y (y - y_d)
    subject to  x' = A_k x + B_k (u - u0),  low <= u, u', y, c'x <= high.

    What costs is the departure from the rest of the interval in force, as in `quadratic_redesign`; limits are absolute. With a
    limited rate the input does not jump where a jump of the plant moves its value at rest.

    Where the optimum without limits keeps within them it is returned as it is. Otherwise the input is continuous (but for the jumps
    of B and D) and linear in time over steps within a window around the manoeuvre; before and after the window the plan is the
    optimum without limits in closed form, whose exact cost is part of the programme, so no horizon is truncated. The window is
    widened until that part keeps within the limits too and none acts where it joins; then nothing is lost by leaving them out
    there. Within a step transitions and costs are exact (matrix exponentials). Inputs and rates keep their limits at every instant,
    to rounding; states and outputs to 1e-6 of them, checked between the steps' ends, where further instants are imposed as needed.
    The plan's `active` says where it touches which limit and what a unit more of it would save there (the integral of its Lagrange
    multiplier), `shadow_prices` what that is in all; `optimality` holds the plan's cost and its duality gap, from the multipliers:
    no plan with the same steps costs less by more than that. As `step` goes to zero the plan tends to the optimum among all inputs,
    its cost and its input with an error of order step^2 away from the instants at which a limit begins or ceases to act.

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
        max_preactuation, max_postactuation: longest time before the manoeuvre at which the plan may start, and after it at which it
            may end [s]; None: as long as the tolerance asks.

    Raises what `quadratic_redesign` does, and RedesignError for limits that make no sense, that the plan at rest before or after
    the manoeuvre does not keep, or that cannot be kept all at once (which conflict and how far one has to give way), and where the
    plan found has a duality gap of more than 1e-6 of its cost.
    Method: dual-mode quadratic programming (P. Scokaert, J. Rawlings, "Constrained linear quadratic regulation", IEEE Trans.
    Automatic Control 43(8), 1998), in continuous time and at both ends.
    """
    if step is not None:
        require_duration("step", step, error=RedesignError)
    free = free_optimum(
        model,
        reference,
        R=R,
        Q_x=Q_x,
        Q_y=Q_y,
        tolerance=tolerance,
        max_preactuation=max_preactuation,
        max_postactuation=max_postactuation,
    )
    problem = LimitedProblem(free, bounds_of(limits, free.problem.plant))
    _require_rest_within(problem.tails, problem.bounds)
    if not free_excess(problem) > KEPT:  # what is no number is refused by the certificate
        remark = "no limit is active: this is the optimum without limits"
        return free.problem.plan(
            METHOD, free.trajectory, exact=False, remarks=(remark,), kind=ConstrainedTrajectory, limits=problem.bounds
        )
    solution = solve_limited(problem, step)
    # Found in a unit of the cost of its own, in which the weights are about one.
    unit = as_weights(free.problem.plant, R=R, Q_x=Q_x, Q_y=Q_y).size / free.weights.size
    active = active_limits(solution.trajectory, problem.bounds, solution.rows, solution.multipliers * unit)
    steps = len(solution.trajectory.breakpoints) - 1
    remarks = (
        f"the input is linear in time over {steps} steps of up to {solution.step:.4g} s",
        *map(str, active),
        *([f"a limit is exceeded by {solution.overshoot:.1e} of it between steps"] if solution.overshoot > KEPT else []),
    )
    return free.problem.plan(
        METHOD,
        solution.trajectory,
        exact=False,
        remarks=remarks,
        kind=ConstrainedTrajectory,
        limits=problem.bounds,
        active=active,
        overshoot=solution.overshoot,
        step=solution.step,
        optimality=replace(solution.optimality, cost=solution.optimality.cost * unit),
    )


def _require_rest_within(tails: tuple[Tail, Tail], bounds: Sequence[Bound]) -> None:
    """Raises RedesignError where the plan at rest lies outside a limit, or so near to one that nothing may move there."""
    for tail, when in zip(tails, ("before", "after"), strict=True):
        for bound in bounds:
            moved = bound.rest[0 if tail.direction < 0 else -1]
            rest = 0.0 if bound.kind == "input rate" else float(bound.row @ tail.held + moved)
            if bound.excess(np.array(rest)) > -LEAST_MARGIN:
                at, low, high = rest + bound.offset, bound.low + bound.offset, bound.high + bound.offset
                raise RedesignError(
                    f"limits that cannot be kept: at rest {when} the manoeuvre {bound.name} is {at:.6g}, expected strictly between "
                    f"its limits {low:.6g} and {high:.6g} (off by {max(low - at, at - high):.3g}); loosen that limit, or choose "
                    "another operating point or held value"
                )
