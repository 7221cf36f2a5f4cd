"""The closed loop: controller and plant, step by step, on a grid that respects every breakpoint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import by_name, instance, require_text
from invtrack.arrays import Array, real_number, real_numbers, require_duration, shown
from invtrack.channels import Channels
from invtrack.control.protocol import Controller, Planned
from invtrack.errors import SimulationError
from invtrack.linear.oscillation import slowest_flexible_period
from invtrack.plans.plan import Samples
from invtrack.plans.problem import left_out_of
from invtrack.plant.parameters import Change, ordered
from invtrack.plant.plant import Plant
from invtrack.results.result import Event, RunResult, Signal
from invtrack.simulation.acting_limits import limit_events
from invtrack.simulation.grid import Grid, held_instants, make_grid, stage_instants, update_times, updates_of_steps
from invtrack.simulation.linear_plant import LinearPlant, linear_plant
from invtrack.simulation.mujoco_plant import mujoco_plant
from invtrack.simulation.planned_values import planned_values
from invtrack.simulation.preflight import (
    require_fit,
    require_histories,
    require_known_parameters,
    require_planned_parameters,
    warn_of_fast_zeros,
    warn_of_limits,
    warn_of_start,
    warn_of_unstable_holds,
    warn_of_unused_sensors,
)
from invtrack.simulation.simulated_plant import Sensor, SensorChain, SimulatedPlant
from invtrack.simulation.span import span_of_run
from invtrack.simulation.stepping import Progress, Recorded, Run


def simulate(
    plant: Plant | LinearPlant,
    controller: Controller,
    *,
    schedule: Sequence[Change] | None = None,
    timestep: float = 1e-3,
    start: float | None = None,
    end: float | None = None,
    evaluate: Literal["held", "stages"] = "held",
    vibration_period: float | None = None,
    initial_state: ArrayLike | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    seed: int = 0,
    name: str = "run",
    progress: Progress | None = None,
) -> RunResult:
    """Drive a plant with a controller and record everything.

    Args:
        plant: a MuJoCo plant, or a LinearPlant in its place.
        controller: what acts on it; its plan sets the span of the run and what errors are measured against.
        schedule: when physical parameters really change, known to the controller or not; positions and velocities are continuous
            there. By default what the plan was made for happens: the parameters have the values of its model's first interval, and
            change at its switch times. With a schedule they have the plant's own values until its first change; () lets nothing
            change. A LinearPlant has its own switch times in place of all this.
        timestep: no step is longer [s]; each interval between breakpoints (of schedule, controller, its updates and reference) is
            divided evenly.
        start, end: times [s]; by default from the plan's preactuation until it has come to rest, and at least until the window
            for residual vibration ends (see `invtrack.residual_vibration`); at most 500 000 steps before and after the manoeuvre.
        evaluate: "held" holds the feedforward's mean over each update's hold (error of order hold^2), "stages" evaluates the law
            at every stage of RK4 (order timestep^4).
        vibration_period: of the slowest flexible mode [s], in which residual vibration is counted; by default that of the last
            interval of the plan's model, which may not be quite that of the plant.
        initial_state: deviation from the operating point (n,) in which the plant starts; at rest at its operating point unless
            given.
        sensors: noise, quantization and delay of named measurements, for controllers that use them.
        seed: of the noise.
        name: of the case.
        progress: called now and then with the share of the run that is done.

    A run that diverges (a state that is not finite, or MuJoCo's warnings about one) stops there; the result holds what was
    recorded, status "diverged" and the cause. A RuntimeWarning says beforehand where the plan needs more input than the actuators
    pass on, goes beyond other limits of the mechanism (forces, activations, ranges of joints and tendons) or brings geoms into
    contact, where it starts elsewhere than the plant, where the feedback is unstable for being held so long, where the plan's zeros
    are faster than that, and where sensors are given that the controller does not look at; a LongRunWarning where the run takes
    more than a million steps, or is cut short (then the result's `remarks` say so too) because its plan takes more than 500 000
    to leave rest or to come to rest and neither `start` nor `end` asks for them. In the run each of the limits, while it acts, is
    an event.

    Raises SimulationError, PlantError for what cannot be simulated as asked.
    """
    expected = "an invtrack.Plant, or invtrack.LinearPlant(model) for a linear model"
    instance("plant", plant, (Plant, LinearPlant), expected=expected, error=SimulationError)
    require_duration("timestep", timestep, error=SimulationError)
    if progress is not None and not callable(progress):
        raise SimulationError(f"progress must be a function of the share that is done, got {shown(progress)}")
    require_text("name", name, error=SimulationError)
    if sensors is not None:
        by_name("sensors", sensors, expected="sensors by the names of measurements", error=SimulationError)
    simulated = mujoco_plant(plant) if isinstance(plant, Plant) else linear_plant(plant)
    require_fit(simulated, controller, evaluate)
    plan = controller.plan
    if schedule is None and isinstance(plant, Plant):
        values, changes = plan.model.parameters, [Change(time, **new) for time, new in plan.schedule]
        require_planned_parameters(simulated, values)
    else:
        values, changes = {}, ordered(() if schedule is None else schedule)
        require_known_parameters(simulated, changes)
    warn_of_limits(simulated, controller)
    warn_of_unused_sensors(controller, sensors or {})
    if vibration_period is None:
        period = slowest_flexible_period(plan.model.systems[-1])
    else:
        period = real_number("vibration_period", vibration_period, unit="s", error=SimulationError)
        require_duration("vibration_period", period, error=SimulationError)
    start, end = (
        None if time is None else real_number(side, time, unit="s", error=SimulationError)
        for side, time in (("start", start), ("end", end))
    )
    span = span_of_run(plan, period=period, timestep=timestep, start=start, end=end)
    if start is None and initial_state is None and span.start <= plan.start:
        warn_of_start(simulated, controller)
    start, end = span.start, span.end
    updates = update_times(start, end, controller.period)
    breakpoints = [change.time for change in changes]
    for source in (controller.breakpoints, plan.breakpoints, simulated.breakpoints, updates):
        breakpoints.extend(source.tolist())
    grid = make_grid(start, end, breakpoints, timestep)
    require_histories(simulated, grid)
    parameters = _Parameters.on_grid({**simulated.parameter_values, **values}, changes, grid)
    update = updates_of_steps(grid, updates)
    if evaluate == "stages":
        samples, instants = plan(grid.time, inside=np.append(grid.middle, grid.middle[-1])), stage_instants(grid)
    else:
        samples, middle_inputs = planned_values(plan, grid)
        instants = held_instants(grid, update, Planned(plan, samples.x, middle_inputs))
    warn_of_unstable_holds(controller, instants, plant.model if isinstance(plant, LinearPlant) else plan.model)
    warn_of_fast_zeros(controller, float(np.max(grid.step if evaluate == "stages" else instants.hold)))
    chain = SensorChain(simulated.measurements.names, sensors or {}, seed)
    run = Run(
        plant=simulated,
        stepper=simulated.stepper(_state(simulated, initial_state), parameters.initial),
        law=controller.begin(instants),
        grid=grid,
        update=update,
        changes=parameters.later,
        sensors=chain if controller.measures == "sensors" else None,
    )
    recorded = run.go(at_stages=evaluate == "stages", progress=progress)
    remarks = (*left_out_of(plan.model), *span.remarks)
    stated = {"name": name, "timestep": timestep, "evaluate": evaluate, "vibration_period": period, "remarks": remarks}
    return _result(simulated, samples, controller, grid, parameters, recorded, stated)


def _state(plant: SimulatedPlant, initial_state: ArrayLike | None) -> Array:
    """The state (n,) to start in: at rest unless given."""
    n = len(plant.states)
    x_0 = plant.rest if initial_state is None else real_numbers("initial_state", initial_state, error=SimulationError)
    if x_0.shape != (n,) or not np.all(np.isfinite(x_0)):
        raise SimulationError(f"initial_state must be finite, ({n},): {plant.states}; got shape {x_0.shape}, {x_0.tolist()}")
    return x_0


@dataclass(frozen=True, eq=False)
class _Parameters:
    """The physical parameters over a run: their values when it starts, and what changes at which edge of its grid."""

    initial: dict[str, float]
    later: dict[int, dict[str, float]]

    @classmethod
    def on_grid(cls, initial: Mapping[str, float], changes: Iterable[Change], grid: Grid) -> _Parameters:
        """From values before all changes; what changes before the grid starts holds from its start on."""
        values: dict[str, float] = dict(initial)
        later: dict[int, dict[str, float]] = {}
        for change in changes:
            edge = grid.edge_index(change.time)
            if change.time <= grid.edges[0]:
                values.update(change.parameters)
            elif edge is not None and edge < len(grid.step):
                later.setdefault(edge, {}).update(change.parameters)
        return cls(values, later)

    def table(self, channels: Channels, grid: Grid) -> Array:
        """The values in force in each step (N, .)."""
        values, result = dict(self.initial), np.empty((grid.n_steps, len(channels)))
        edges = sorted({0, *self.later})
        for edge, until in zip(edges, [*edges[1:], len(grid.step)], strict=True):
            values.update(self.later.get(edge, {}))
            result[grid.first_step[edge] : grid.first_step[until]] = [values[name] for name in channels.names]
        return result

    def events(self, channels: Channels, grid: Grid) -> list[Event]:
        """One event for each edge at which something changes."""
        unit = dict(zip(channels.names, channels.units, strict=True))
        return [
            Event(
                float(grid.edges[edge]),
                "parameter",
                ", ".join(f"{name} = {value:g} {unit[name]}" for name, value in values.items()),
            )
            for edge, values in self.later.items()
        ]


def _result(
    plant: SimulatedPlant,
    planned: Samples,
    controller: Controller,
    grid: Grid,
    parameters: _Parameters,
    recorded: Recorded,
    stated: Mapping[str, Any],
) -> RunResult:
    """Attach what was wanted and what was planned, channels and events, and cut everything to the steps that were recorded."""
    steps = len(recorded.u)
    time = grid.time[: steps + 1]
    message = f"stopped at t = {time[-1]:.6g} s: {recorded.cause}" if recorded.cause else ""
    seen: dict[str, Any] = {}
    if recorded.estimate.shape[1]:
        seen["measured"] = Signal(recorded.measured, plant.measurements)
        seen["estimate"] = Signal(recorded.estimate, plant.states)
    T_i, T_f = controller.plan.manoeuvre
    events = [Event(T_i, "manoeuvre", "starts"), Event(T_f, "manoeuvre", "ends"), *parameters.events(plant.parameters, grid)]
    events += [Event(float(t), "parameter", "the linear model switches") for t in plant.breakpoints]
    events += limit_events(recorded.acting, time, (T_i, T_f))
    if message:
        events.append(Event(float(time[-1]), "end", message))
    return RunResult(
        model=plant.name,
        time=time,
        state=Signal(recorded.x, plant.states),
        state_reference=Signal(planned.x[: steps + 1], plant.states),
        output=Signal(recorded.y, plant.outputs),
        reference=Signal(planned.y_d[: steps + 1], plant.outputs),
        planned_output=Signal(planned.y[: steps + 1], plant.outputs),
        commanded=Signal(recorded.u, plant.inputs),
        applied=Signal(recorded.applied, plant.inputs),
        parameters=Signal(parameters.table(plant.parameters, grid)[:steps], plant.parameters),
        manoeuvre=(T_i, T_f),
        rest_inputs=controller.plan.rest_inputs,
        integrator=plant.integrator,
        events=tuple(sorted((event for event in events if time[0] <= event.time <= time[-1]), key=lambda event: event.time)),
        parameter_bodies=plant.parameter_bodies,
        qpos=recorded.qpos,
        status="diverged" if recorded.cause else "completed",
        message=message,
        mjb=plant.binary(parameters.initial),
        **seen,
        **stated,
    )
