"""What redesign trades over a range of weights: tracking error against input and internal motion."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy  # loads scipy.integrate at its first use
from numpy.typing import NDArray

from invtrack.arrays import Array, shown
from invtrack.errors import RedesignError
from invtrack.linear.switched import SwitchedSystem, as_switched
from invtrack.plans.plan import Plan
from invtrack.redesign.cost import cost
from invtrack.redesign.limits import StateRow, state_row
from invtrack.redesign.quadratic import quadratic_redesign
from invtrack.references.signal import PiecewiseSignal

NO_WORSE = 1e-9
"""Share of a figure's largest value by which two points may differ and still count as equal in it."""

SAMPLES = 12_288
"""Values of a plan, about, of which a peak is the largest."""

FIGURES = ("max_error", "peak_input", "rms_input")
WEIGHTS = {"R", "Q_x", "Q_y"}


@dataclass(frozen=True)
class Outcome:
    """What one plan gives up and what it asks for, from its values alone.

    max_error: largest |y_i - y_d,i|. peak_input: largest |u_i|. rms_input: square root of the integral of |u - u0|^2 from
    the plan's start to its end, divided by the duration of the manoeuvre. peaks: largest magnitude of each named internal quantity.
    Units are those of the outputs, inputs and states.
    """

    max_error: float
    peak_input: float
    rms_input: float
    peaks: Mapping[str, float]

    @property
    def figures(self) -> dict[str, float]:
        """All of it by name: max_error, peak_input, rms_input, and peak_<quantity> for each internal quantity."""
        named = {name: float(getattr(self, name)) for name in FIGURES}
        return named | {f"peak_{name}": value for name, value in self.peaks.items()}


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Outcomes of redesigns with different weights, in the order in which these were given.

    Args:
        weights: as given.
        plans: the redesigned trajectories.
        outcomes: what each of them gives up and asks for.
        costs: the integral that each of them minimises, with its own weights.
        exact: the outcome of exact inversion, None where its plan was not given.
    """

    weights: tuple[Mapping[str, Any], ...]
    plans: tuple[Plan, ...]
    outcomes: tuple[Outcome, ...]
    costs: tuple[float, ...]
    exact: Outcome | None

    def values(self, figure: str) -> Array:
        """One figure of all outcomes, (m,). Raises RedesignError for an unknown one."""
        known = self.outcomes[0].figures
        if not isinstance(figure, str) or figure not in known:
            raise RedesignError(f"no figure named {shown(figure)}; there are: {', '.join(known)}")
        return np.array([outcome.figures[figure] for outcome in self.outcomes])

    def shares(self, figure: str) -> Array:
        """That figure as a share of exact inversion's, (m,). Raises RedesignError where there is none to compare with."""
        if self.exact is None:
            raise RedesignError("there is no exact inversion to compare with; give its plan to pareto_sweep(..., exact=...)")
        values, whole = self.values(figure), self.exact.figures[figure]
        if whole <= NO_WORSE * float(np.max(values)):
            raise RedesignError(f"exact inversion's {figure} is zero, so that nothing is a share of it; take the values themselves")
        return np.asarray(values / whole)

    @cached_property
    def dominated(self) -> NDArray[np.bool_]:
        """Which points (m,) another one beats: no worse in any figure, better in at least one."""
        table = np.array([list(outcome.figures.values()) for outcome in self.outcomes])  # (m, figures)
        equal = NO_WORSE * np.max(np.where(np.isfinite(table), table, 0.0), axis=0)
        no_worse = np.all(table[:, None] <= table[None] + equal, axis=2)  # (m, m): the first against the second
        better = np.any(table[:, None] < table[None] - equal, axis=2)
        return np.asarray(np.any(no_worse & better, axis=0))

    @property
    def rows(self) -> list[dict[str, float | bool]]:
        """Figures, cost and whether it is dominated, one mapping per point: for tables and files."""
        points = zip(self.outcomes, self.costs, self.dominated.tolist(), strict=True)
        return [{**outcome.figures, "cost": cost_, "dominated": beaten} for outcome, cost_, beaten in points]


def pareto_sweep(
    model: Any,
    reference: PiecewiseSignal,
    *,
    weights: Sequence[Mapping[str, Any]],
    quantities: Mapping[str, StateRow] | None = None,
    exact: Plan | None = None,
    method: Callable[..., Plan] = quadratic_redesign,
    **options: Any,
) -> TradeOff:
    """Redesign with each of the weights, and what each plan gives up and asks for.

    Args:
        model: StateSpace, SwitchedSystem, or anything with A, B, C, D.
        reference: wanted outputs, absolute, in their units, held still before and after the manoeuvre.
        weights: one mapping {"R": ..., "Q_x": ..., "Q_y": ...} per point, Q_x zero unless stated.
        quantities: internal quantities by name, each a combination of states, {"th1": 1.0, "th2": -1.0}.
        exact: the plan of exact inversion for the same reference, to compare with.
        method: called as method(model, reference, **weights, **options) for each point.
        options: further ones of the method, the same for all points.

    Raises RedesignError for no or unknown weights, for quantities that do not fit the states, for an `exact` that is no plan and a
    `method` that makes none, and as the method does.
    """
    points = _points(weights)
    plant = as_switched(model)
    rows = _rows(quantities, plant)
    if exact is not None:
        _require_plan(exact, "exact must be a plan such as invtrack.invert(model, reference)")
    for point in points:
        _require_callable(method, {**point, **options})
    plans = tuple(method(plant, reference, **point, **options) for point in points)
    for plan in plans:
        _require_plan(plan, "method must return plans, as invtrack.quadratic_redesign does")
    return TradeOff(
        weights=points,
        plans=plans,
        outcomes=tuple(outcome(plan, rows) for plan in plans),
        costs=tuple(cost(plan, **point) for plan, point in zip(plans, points, strict=True)),
        exact=None if exact is None else outcome(exact, rows),
    )


def outcome(plan: Plan, quantities: Mapping[str, StateRow] | None = None) -> Outcome:
    """What a plan of any method gives up and asks for; quantities as in `pareto_sweep`.

    Raises RedesignError for what is no plan, and for quantities that do not fit the states.
    """
    _require_plan(plan, "expected a plan such as invtrack.invert(model, reference)")
    rows = _rows(quantities, plan.model)
    times, inside = _dense_times(plan)
    at = plan(times.ravel(), inside=inside)
    u = plan.departures(times.ravel(), inside=inside).u
    power = np.sum(u**2, axis=1).reshape(times.shape)
    energy = float(np.sum(scipy.integrate.simpson(power, x=times, axis=1)))
    return Outcome(
        max_error=_peak(at.y - at.y_d),
        peak_input=_peak(at.u),
        rms_input=float(np.sqrt(energy / (plan.manoeuvre[1] - plan.manoeuvre[0]))),
        peaks={name: _peak(at.x @ row) for name, row in rows.items()},
    )


def _points(weights: object) -> tuple[Mapping[str, Any], ...]:
    """The weights of each point. Raises RedesignError for what is no list of mappings with the weights' names, or an empty one."""
    no_list = isinstance(weights, (str, Mapping)) or (isinstance(weights, np.ndarray) and weights.ndim == 0)
    points: tuple[Any, ...] = tuple(weights) if isinstance(weights, Iterable) and not no_list else ()
    if not points or not all(isinstance(point, Mapping) and {"R", "Q_y"} <= set(point) <= WEIGHTS for point in points):
        got = [list(point) if isinstance(point, Mapping) else point for point in points] if points else weights
        raise RedesignError(f"expected a list with, for each point, a mapping with R, Q_y and, if wanted, Q_x; got {shown(got)}")
    return points


def _rows(quantities: object, plant: SwitchedSystem) -> dict[str, Array]:
    """The row (n,) of each quantity. Raises RedesignError for what is no mapping by names, and rows that do not fit the states."""
    if quantities is None:
        return {}
    if not isinstance(quantities, Mapping) or not all(isinstance(name, str) and name for name in quantities):
        raise RedesignError(
            f"quantities must be a mapping such as {{'twist': {{'th1': 1.0, 'th2': -1.0}}}}, got {shown(quantities)}"
        )
    return {name: state_row(name, row, plant) for name, row in quantities.items()}


def _require_callable(method: object, options: Mapping[str, Any]) -> None:
    """Raises RedesignError for what cannot be called as method(model, reference, **options)."""
    try:
        if callable(method):
            inspect.signature(method).bind(None, None, **options)
            return
        reason = "it is no function"
    except (TypeError, ValueError) as refusal:  # other arguments, or a builtin that does not say which it takes
        reason = str(refusal)
    given = ", ".join(f"{name}=..." for name in options)
    raise RedesignError(
        f"method must be a function such as invtrack.quadratic_redesign, called as method(model, reference, {given}), "
        f"got {shown(method)}: {reason}"
    )


def _require_plan(plan: object, expected: str) -> None:
    if not isinstance(plan, Plan):
        raise RedesignError(f"{expected}, got {shown(plan)}")


def _dense_times(plan: Plan) -> tuple[Array, Array]:
    """Times (pieces, m) over the whole plan, ends of the pieces included, and for each, flat, a time inside the piece meant: a peak
    may lie on one side of a jump."""
    edges = np.unique(np.concatenate([[plan.start], plan.breakpoints, [plan.end]]))
    middle = (edges[:-1] + edges[1:]) / 2
    count = 2 * max(4, SAMPLES // (2 * len(middle))) + 1  # odd, for Simpson's rule
    times = edges[:-1, None] + np.diff(edges)[:, None] * np.linspace(0.0, 1.0, count)
    return times, np.repeat(middle, count)


def _peak(values: Array) -> float:
    return float(np.max(np.abs(values)))
