"""From the arrays of a run to a RunResult with names, units, references and events."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Controller
from invtrack.physics.plant import Plant
from invtrack.runs.result import Event, RunResult, Signal
from invtrack.simulation.grid import Grid

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Recorded:
    """What the loop wrote down over M <= N steps: x (M + 1, n), qpos (M + 1, nq), y (M + 1, p), commanded (M, p), and
    why it ended early."""

    x: Array
    qpos: Array
    y: Array
    commanded: Array
    cause: str


def make_result(
    *,
    name: str,
    plant: Plant,
    controller: Controller,
    grid: Grid,
    recorded: Recorded,
    applied: Array,
    initial: dict[str, float],
    later: dict[int, dict[str, float]],
    timestep: float,
    hold: str,
    vibration_period: float,
) -> RunResult:
    """Attach what was wanted and what was planned, names, units and events, and cut everything to the steps that were recorded."""
    steps = len(recorded.commanded)
    time = grid.time[: steps + 1]
    inside = np.append(grid.middle, grid.middle[-1])[: steps + 1]
    plan = controller.nominal(time, inside=inside)
    parameters = _parameter_table(plant, grid, initial, later)[:steps]
    message = f"stopped at t = {time[-1]:.6g} s: {recorded.cause}" if recorded.cause else ""
    outputs = (plant.output_names, plant.output_units)
    return RunResult(
        name=name,
        model=plant.name,
        time=time,
        state=Signal(recorded.x, plant.state_names, plant.state_units),
        state_reference=Signal(plan.x, plant.state_names, plant.state_units),
        output=Signal(recorded.y, *outputs),
        reference=Signal(plan.y_d, *outputs),
        planned_output=Signal(plan.y, *outputs),
        commanded=Signal(recorded.commanded, plant.input_names, plant.input_units),
        applied=Signal(applied, plant.input_names, plant.input_units),
        parameters=Signal(parameters, tuple(plant.parameters), tuple(plant.parameter_units[key] for key in plant.parameters)),
        manoeuvre=controller.nominal.support,
        timestep=timestep,
        hold=hold,
        integrator=mujoco.mjtIntegrator(plant.model.opt.integrator).name.removeprefix("mjINT_"),
        vibration_period=vibration_period,
        events=_events(plant, controller, grid, later, time, message),
        parameter_bodies=plant.parameter_bodies,
        qpos=recorded.qpos,
        status="diverged" if recorded.cause else "completed",
        message=message,
        mjb=_binary(plant.model_with(initial)),
    )


def _parameter_table(plant: Plant, grid: Grid, initial: dict[str, float], later: dict[int, dict[str, float]]) -> Array:
    values, rows = dict(initial), []
    for k in range(len(grid.step)):
        values.update(later.get(k, {}))
        rows.append([values[key] for key in plant.parameters])
    return np.array(rows).reshape(len(grid.step), len(plant.parameters))[grid.interval]


def _events(
    plant: Plant, controller: Controller, grid: Grid, later: dict[int, dict[str, float]], time: Array, message: str
) -> tuple[Event, ...]:
    T_i, T_f = controller.nominal.support
    events = [Event(T_i, "manoeuvre", "starts"), Event(T_f, "manoeuvre", "ends")]
    for edge, values in later.items():
        text = ", ".join(f"{key} = {value:g} {plant.parameter_units[key]}" for key, value in values.items())
        events.append(Event(float(grid.edges[edge]), "parameter", text))
    if message:
        events.append(Event(float(time[-1]), "stop", message))
    return tuple(sorted((event for event in events if time[0] <= event.time <= time[-1]), key=lambda event: event.time))


def _binary(model: mujoco.MjModel) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.mjb"
        mujoco.mj_saveModel(model, str(path))
        return path.read_bytes()
