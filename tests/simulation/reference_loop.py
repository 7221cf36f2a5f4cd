"""The closed loop once more, step by step in plain Python, to hold the compiled one against; and single runs of a stepper."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass

import mujoco
import numpy as np

import invtrack
from invtrack.control.protocol import AffineLaw, Controller, Law
from invtrack.plant.configuration import configuration_of
from invtrack.simulation.grid import held_instants, make_grid, stage_instants, update_times, updates_of_steps
from invtrack.simulation.mujoco_plant import mujoco_plant
from invtrack.simulation.simulated_plant import SensorChain, SimulatedPlant
from invtrack.simulation.stepping import Recorded, Run


def stepped(
    plant: invtrack.Plant | SimulatedPlant,
    x: np.ndarray,
    law: np.ndarray | Law,
    *,
    timestep: float,
    steps: int | None = None,
    sensors: SensorChain | None = None,
) -> Recorded:
    """A run from state x under a law, or under given inputs (N, p)."""
    simulated = mujoco_plant(plant) if isinstance(plant, invtrack.Plant) else plant
    if isinstance(law, np.ndarray):
        steps = len(law)
        law = AffineLaw(law, [np.zeros((law.shape[1], len(x)))], np.zeros(len(law), dtype=np.intp))
    assert steps is not None
    grid = make_grid(0.0, steps * timestep, [], timestep)
    stepper = simulated.stepper(x, simulated.parameter_values)
    return Run(simulated, stepper, law, grid, np.arange(steps), {}, sensors).go(at_stages=False, progress=None)


@dataclass
class Trace:
    """What `python_loop` saw: states (N + 1, n), inputs (N, p), and what the sensors showed (N, m)."""

    x: np.ndarray
    u: np.ndarray
    measured: np.ndarray


def python_loop(
    plant: invtrack.Plant,
    controller: Controller,
    *,
    start: float,
    end: float,
    timestep: float,
    evaluate: str = "held",
    changes: Sequence[invtrack.Change] = (),
    sensors: Mapping[str, invtrack.Sensor] | None = None,
    seed: int = 0,
) -> Trace:
    """The meaning of `simulate` for a MuJoCo plant, with mj_step and the law's `update`, one thing after the other."""
    updates = update_times(start, end, controller.period)
    grid = make_grid(
        start, end, [*controller.breakpoints, *controller.plan.breakpoints, *updates, *(c.time for c in changes)], timestep
    )
    update = updates_of_steps(grid, updates)
    law = controller.begin(stage_instants(grid) if evaluate == "stages" else held_instants(grid, update))
    model, x0 = plant.model_with(), plant.operating_point.x0
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    data = plant.new_data(model)
    data.qpos[:], data.qvel[:], data.act[:] = configuration_of(model, x0, np.zeros(2 * model.nv + model.na))
    noise = np.random.default_rng(seed)
    known = [(sensors or {}).get(name, invtrack.Sensor()) for name in plant.measurements.names]
    trace = Trace(
        *(np.zeros((grid.n_steps + extra, size)) for extra, size in ((1, plant.n_states), (0, len(plant.inputs)), (0, len(known))))
    )
    ideal: list[np.ndarray] = []
    stage = [0, 4]  # number of the step, and of the evaluation within it

    def control(_model: mujoco.MjModel, its_data: mujoco.MjData) -> None:
        if its_data is data and stage[1] < 4:
            u = law.update(3 * stage[0] + (0, 1, 1, 2)[stage[1]], plant.state(data))
            data.ctrl[plant.input_addresses] = u
            if stage[1] == 1:
                trace.u[stage[0]] = u
            stage[1] += 1

    latest, u = -1, np.zeros(len(plant.inputs))
    with ExitStack() as stack:
        stack.enter_context(plant.forces(model))
        if evaluate == "stages":
            mujoco.set_mjcb_control(control)
            stack.callback(mujoco.set_mjcb_control, None)
        for i in range(grid.n_steps):
            for edge in np.flatnonzero(grid.first_step[:-1] == i):
                model.opt.timestep, data.time = grid.step[edge], grid.edges[edge]
                for change in changes:
                    if abs(change.time - grid.edges[edge]) < 1e-9:
                        plant.apply(model, change.parameters)
            trace.x[i] = plant.state(data)
            if evaluate == "held":
                if controller.measures == "sensors":
                    mujoco.mj_forward(model, data)
                    ideal.append(plant.measurement_readings.values(data))
                if update[i] != latest:
                    latest = update[i]
                    seen = trace.x[i]
                    if controller.measures == "sensors":
                        late = grid.time[i] - np.array([sensor.delay for sensor in known])
                        seen = np.array([np.interp(t, grid.time[: i + 1], np.array(ideal)[:, j]) for j, t in enumerate(late)])
                        if any(sensor.noise for sensor in known):
                            seen = seen + np.array([sensor.noise for sensor in known]) * noise.standard_normal(len(known))
                        for j, sensor in enumerate(known):
                            if sensor.quantization:
                                seen[j] = sensor.quantization * np.rint(seen[j] / sensor.quantization)
                        trace.measured[i] = seen
                    u = law.update(int(update[i]), seen)
                elif controller.measures == "sensors":
                    trace.measured[i] = trace.measured[i - 1]
                trace.u[i] = u
                data.ctrl[plant.input_addresses] = u
            stage[:] = [i, 0]
            mujoco.mj_step(model, data)
        trace.x[-1] = plant.state(data)
    return trace
