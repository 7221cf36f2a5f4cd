"""What can be said of a run before it starts: whether its parts fit each other, and what will surprise whoever started it."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray

from invtrack.arguments import one_of
from invtrack.arrays import Array
from invtrack.control.protocol import Controller, Instants
from invtrack.control.tracking_controller import PlanFollower
from invtrack.errors import SimulationError
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.switched import SAME_POINT, SwitchedSystem
from invtrack.plans.actuation import peak_departure
from invtrack.plans.input_tail import input_tail
from invtrack.plans.tail import SIDES
from invtrack.plant.parameters import Change
from invtrack.simulation.acting_limits import noticeable, size_of
from invtrack.simulation.grid import Grid
from invtrack.simulation.simulated_plant import SimulatedPlant

STACK = 3
"""Warnings point at the line that called `simulate`."""

FAR_FROM_REST = 0.05
"""A run starts elsewhere than its plan where a state of the plan is then beyond this share of its peak."""

PLAN_SAMPLES = 2001

SAME_HOLD = 1e-3
"""Holds that differ by less than this share of the longest are as stable as each other."""

NOTICED = 0.01
"""Share of the peak input from which on a part of it counts."""

DELAY_ROUNDING = 1e-9
"""Times are compared with an actuator's delay to within this share of it."""


def require_fit(plant: SimulatedPlant, controller: Controller, evaluate: str) -> None:
    """Raises SimulationError where plant, controller and evaluation do not fit each other."""
    if isinstance(controller, type) or not callable(getattr(controller, "begin", None)):
        raise SimulationError(
            f"expected a controller, got {type(controller).__name__}; make one of a plan: invtrack.TrackingController(plan, gains)"
        )
    model = controller.plan.model
    for kind in ("states", "inputs", "outputs", *(["measurements"] if controller.measures == "sensors" else [])):
        planned, real = getattr(model, kind), getattr(plant, kind)
        if not planned.fits(real):
            raise SimulationError(f"the plan's {kind} are {planned}, the plant's are {real}; plan for invtrack.linearize(plant)")
    rests_alike = np.allclose(model.rest_states[0], plant.rest, rtol=SAME_POINT, atol=SAME_POINT)
    if not (model.operating_point.agrees_with(plant.operating_point) and rests_alike):
        raise SimulationError("the plan was made about another operating point than the plant's; linearize this plant")
    one_of("evaluate", evaluate, ("held", "stages"), error=SimulationError)
    if evaluate == "stages" and not (controller.stateless and controller.period is None):
        raise SimulationError(
            'evaluate="stages" evaluates the law several times per step, so it needs a controller without a state and without a '
            "period"
        )


def require_known_parameters(plant: SimulatedPlant, changes: Iterable[Change]) -> None:
    """Raises SimulationError where a schedule names parameters that the plant does not have."""
    for change in changes:
        unknown = [name for name in change.parameters if name not in plant.parameters]
        if unknown:
            known = ", ".join(plant.parameters.names) or "none"
            raise SimulationError(
                f"{change} names unknown parameters {unknown}; the plant's are: {known}. Those of a MuJoCo plant are stated with"
                ' it, as Plant.from_xml(..., parameters=["body:tip:mass"]); a linear model switches by its own switch times'
            )


def require_planned_parameters(plant: SimulatedPlant, planned: Iterable[str]) -> None:
    """Raises SimulationError where the plan was made for values of parameters that the plant does not have."""
    unknown = [name for name in planned if name not in plant.parameters]
    if unknown:
        raise SimulationError(
            f"the plan was made for values of {', '.join(unknown)}; the plant's parameters are: {plant.parameters}. Give the plant "
            "the parameters of the one that was linearized, or say what changes in this run: schedule=() if nothing does"
        )


def require_histories(plant: SimulatedPlant, grid: Grid) -> None:
    """Raises SimulationError where an actuator's delay is longer than the steps whose controls MuJoCo keeps for it."""
    for late in plant.delays:
        starts = grid.time[grid.time <= grid.time[-1] - late.delay]
        past = np.searchsorted(grid.time, starts + (1 - DELAY_ROUNDING) * late.delay) - np.arange(len(starts))
        needed = int(np.max(past, initial=0))
        if needed > late.samples:
            raise SimulationError(
                f"actuator {late.actuator!r} acts {late.delay:.6g} s late, which is up to {needed} steps of this run, but its model"
                f" keeps the controls of the last {late.samples} only; set nsample={needed} in the file, or take longer steps"
            )


def warn_of_limits(plant: SimulatedPlant, controller: Controller) -> None:
    """Say before anything is simulated where the plan exceeds the actuators and other limits of the mechanism."""
    lowest, highest = controller.plan.input_range
    least, most = plant.input_limits.T
    needed = noticeable(np.maximum(least - lowest, highest - most), size_of(plant.input_limits))
    for i, (name, unit) in enumerate(zip(plant.inputs.names, plant.inputs.units, strict=True)):
        if needed[i] > 0:
            span = f"{name} from {lowest[i]:.4g} to {highest[i]:.4g} {unit}".rstrip()
            warnings.warn(
                f"the plan needs {span}, its actuator passes on {least[i]:.4g} to {most[i]:.4g}: expect saturation",
                RuntimeWarning,
                stacklevel=STACK,
            )
    beyond = plant.beyond(controller.plan)
    contacts = [each for each in beyond if each[0].kind == "contact"]
    for limit, first, excess in [each for each in beyond if each[0].kind == "limit"] + contacts[:1]:
        amount = f"{excess:.3g} {limit.unit}".rstrip()
        if limit.kind == "contact":
            others = f" (and into {len(contacts) - 1} more)" if len(contacts) > 1 else ""
            message = (
                f"the plan leads into a {limit.text}, {amount} deep, from t = {first:.4g} s on{others}: expect it to be stopped"
            )
        else:
            message = f"the plan goes beyond the {limit.text} by up to {amount}, from t = {first:.4g} s on: expect it to be limited"
        warnings.warn(message, RuntimeWarning, stacklevel=STACK)


def warn_of_unused_sensors(controller: Controller, sensors: Mapping[str, object]) -> None:
    """Say that noise and delays of sensors do not reach a controller that knows the state."""
    if sensors and controller.measures == "state":
        warnings.warn(
            f"sensors are given for {', '.join(sensors)}, but {type(controller).__name__} knows the state and looks at none; "
            "use invtrack.OutputFeedbackController to see their effect",
            RuntimeWarning,
            stacklevel=STACK,
        )


def warn_of_start(plant: SimulatedPlant, controller: Controller) -> None:
    """Say that the plant, which starts at its operating point, is not where the plan begins."""
    plan = controller.plan
    first, whole = plan(plan.start), plan(np.linspace(plan.start, plan.end, PLAN_SAMPLES))
    rest = plant.rest
    if not np.any(_far(first.x[0] - rest, whole.x - rest)):
        return
    y_0 = plan.model.operating_point.y0
    if np.any(_far(first.y[0] - y_0, whole.y - y_0)):
        wanted = ", ".join(
            f"{name} at {begins:.4g} instead of {at:.4g}"
            for name, begins, at in zip(plant.outputs.names, first.y[0], y_0, strict=True)
        )
        reason = f"{wanted}. References are absolute; let yours begin at the operating point"
    else:
        reason = "its preactuation was cut short. Allow more of it"
    warnings.warn(
        f"the plan does not begin where the plant is, at rest at its operating point: {reason}, or start the plant elsewhere with "
        "initial_state",
        RuntimeWarning,
        stacklevel=STACK,
    )


def _far(first: Array, whole: Array) -> NDArray[np.bool_]:
    """Which channels (n,) begin far from rest, for values (m, n) over the whole plan."""
    return np.asarray(np.abs(first) > FAR_FROM_REST * np.max(np.abs(whole), axis=0))


def warn_of_unstable_holds(controller: Controller, instants: Instants, model: SwitchedSystem) -> None:
    """Say that a feedback which stabilizes the plant's model does not do so when its input is held between updates.

    That is so where an eigenvalue of the sampled closed loop A_d - B_d K lies outside the unit circle. Along a nonlinear motion the
    eigenvalues of an instant decide nothing, so there only the feedback at rest before and after it is looked at.
    """
    if not isinstance(controller, PlanFollower) or not np.any(instants.hold > 0):
        return
    gains, longest = controller.gains, float(np.max(instants.hold))
    holds = np.rint(instants.hold / longest / SAME_HOLD).astype(np.int64)
    inside = instants.inside
    if (along := controller.plan.linearizations) is not None:
        outside = (inside < along.edges[0]) | (inside > along.edges[-1])
        holds, inside = holds[outside], inside[outside]
    cases = (-holds, model.interval(inside), gains.interval(inside))
    changed = np.flatnonzero(np.any([np.diff(case, prepend=-1) != 0 for case in cases], axis=0))
    found = np.column_stack([case[changed] for case in cases])
    for steps, k, g in np.unique(found, axis=0).tolist():  # the longest first
        A, B, K, hold = model.systems[k].A, model.systems[k].B, gains.gains[g], -steps * SAME_HOLD * longest
        if hold <= 0:
            return
        A_d, B_d = zero_order_hold(A, B, hold)
        radius = float(np.max(np.abs(np.linalg.eigvals(A_d - B_d @ K))))
        poles = np.linalg.eigvals(A - B @ K)
        if radius > 1 + 1e-9 and np.max(poles.real) < 0:
            warnings.warn(
                f"the feedback is unstable when its input is held for {hold:.4g} s: errors grow {radius:.4g} times from update to "
                f"update (its fastest pole is at {np.max(np.abs(poles)):.4g} rad/s); take a smaller timestep or period, or lower "
                "gains",
                RuntimeWarning,
                stacklevel=STACK,
            )
            return


def warn_of_fast_zeros(controller: Controller, hold: float) -> None:
    """Say that part of the plan's input comes before the manoeuvre, or goes after it, within less than a hold [s]."""
    plan = controller.plan
    tails = (plan.trajectory.before, plan.trajectory.after)
    for side, end, rest, moves in zip(SIDES, tails, plan.rest_inputs, ("grows before", "dies out after"), strict=True):
        if not end.departs or not np.any(np.abs(end.departure.eigenvalues) * hold > 1) or np.any(np.isnan(rest)):
            continue
        tail = input_tail(plan, side)
        fast = np.abs(tail.rates) * hold > 1
        share = tail.amplitude(fast) / peak_departure(plan, side) if np.any(fast) else 0.0
        if share > NOTICED:
            rate = float(np.max(np.abs(tail.rates[fast])))
            warnings.warn(
                f"a part of the plan's input, {share:.2g} of its peak, {moves} the manoeuvre at {rate:.4g} rad/s, a zero faster "
                f"than the {hold:.4g} s for which an input is held: the run cannot follow it; take a timestep and period below "
                f"{0.1 / rate:.2g} s, or plan with zeros that are slower (quadratic_redesign, another output)",
                RuntimeWarning,
                stacklevel=STACK,
            )
