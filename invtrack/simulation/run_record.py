"""From the arrays of a run to a RunResult with names, units, references and events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Controller
from invtrack.results.result import Event, RunResult, Signal
from invtrack.simulation.grid import Grid
from invtrack.simulation.simulated_plant import SimulatedPlant
from invtrack.simulation.stepping import Recorded

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Circumstances:
    """How a run was made: its grid, parameters at the start (initial) and later by edge number, and what the user asked for."""

    grid: Grid
    initial: dict[str, float]
    later: dict[int, dict[str, float]]
    timestep: float
    evaluate: str
    vibration_period: float


def make_result(name: str, plant: SimulatedPlant, controller: Controller, recorded: Recorded, made: Circumstances) -> RunResult:
    """Attach what was wanted and what was planned, names, units and events, and cut everything to the steps that were recorded."""
    steps = len(recorded.u)
    time = made.grid.time[: steps + 1]
    plan = controller.plan(time, inside=np.append(made.grid.middle, made.grid.middle[-1])[: steps + 1])
    message = f"stopped at t = {time[-1]:.6g} s: {recorded.cause}" if recorded.cause else ""
    low, high = plant.input_limits.T
    seen = {}
    if recorded.estimate.shape[1]:
        seen["measured"] = Signal(recorded.measured, plant.measurement_names, plant.measurement_units)
        seen["estimate"] = Signal(recorded.estimate, plant.state_names, plant.state_units)
    states = (plant.state_names, plant.state_units)
    inputs = (plant.input_names, plant.input_units)
    outputs = (plant.output_names, plant.output_units)
    return RunResult(
        name=name,
        model=plant.name,
        time=time,
        state=Signal(recorded.x, *states),
        state_reference=Signal(plan.x, *states),
        output=Signal(recorded.y, *outputs),
        reference=Signal(plan.y_d, *outputs),
        planned_output=Signal(plan.y, *outputs),
        commanded=Signal(recorded.u, *inputs),
        applied=Signal(np.clip(recorded.u, low, high), *inputs),
        parameters=Signal(
            _parameter_table(plant, made)[:steps], tuple(plant.parameter_units), tuple(plant.parameter_units.values())
        ),
        manoeuvre=controller.plan.manoeuvre,
        timestep=made.timestep,
        evaluate=made.evaluate,
        integrator=plant.integrator,
        vibration_period=made.vibration_period,
        events=_events(plant, controller, made, time, message),
        parameter_bodies=plant.parameter_bodies,
        qpos=recorded.qpos,
        status="diverged" if recorded.cause else "completed",
        message=message,
        mjb=plant.binary(made.initial),
        **seen,
    )


def _parameter_table(plant: SimulatedPlant, made: Circumstances) -> Array:
    values, rows = dict(made.initial), []
    for k in range(len(made.grid.step)):
        values.update(made.later.get(k, {}))
        rows.append([values[key] for key in plant.parameter_units])
    return np.array(rows).reshape(len(made.grid.step), len(plant.parameter_units))[made.grid.interval]


def _events(plant: SimulatedPlant, controller: Controller, made: Circumstances, time: Array, message: str) -> tuple[Event, ...]:
    T_i, T_f = controller.plan.manoeuvre
    events = [Event(T_i, "manoeuvre", "starts"), Event(T_f, "manoeuvre", "ends")]
    for edge, values in made.later.items():
        text = ", ".join(f"{key} = {value:g} {plant.parameter_units[key]}" for key, value in values.items())
        events.append(Event(float(made.grid.edges[edge]), "parameter", text))
    events += [Event(float(t), "parameter", "the linear model switches") for t in plant.breakpoints]
    if message:
        events.append(Event(float(time[-1]), "end", message))
    return tuple(sorted((event for event in events if time[0] <= event.time <= time[-1]), key=lambda event: event.time))
