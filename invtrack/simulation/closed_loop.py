"""The closed loop: controller and plant, step by step, on a grid that respects every breakpoint."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.control.protocol import Controller
from invtrack.errors import SimulationError
from invtrack.plant.change import Change, ordered
from invtrack.plant.plant import Plant
from invtrack.results.result import RunResult
from invtrack.simulation.grid import Grid, held_instants, make_grid, stage_instants, update_times, updates_of_steps
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.simulation.mujoco_plant import MujocoPlant
from invtrack.simulation.preflight import (
    require_fit,
    warn_of_limits,
    warn_of_start,
    warn_of_unstable_holds,
    warn_of_unused_sensors,
)
from invtrack.simulation.run_record import Circumstances, make_result
from invtrack.simulation.sensors import Sensor, SensorChain
from invtrack.simulation.simulated_plant import SimulatedPlant
from invtrack.simulation.stepping import Progress, Run

Array = NDArray[np.float64]

RESIDUAL_PERIODS = 5
"""A run goes on for this many periods of the slowest flexible mode after the manoeuvre, unless told otherwise."""


def simulate(
    plant: Plant | LinearPlant,
    controller: Controller,
    *,
    schedule: Sequence[Change] = (),
    timestep: float = 1e-3,
    start: float | None = None,
    end: float | None = None,
    evaluate: Literal["held", "stages"] = "held",
    initial_state: ArrayLike | None = None,
    sensors: Mapping[str, Sensor] | None = None,
    seed: int = 0,
    name: str = "run",
    progress: Progress | None = None,
) -> RunResult:
    """Drive a plant with a controller and record everything.

    plant: a MuJoCo plant, or a LinearPlant in its place; it starts at rest at its operating point, or at `initial_state` (n,).
    schedule: when physical parameters really change, known to the controller or not; positions and velocities are continuous there.
    timestep [s]: no step is longer; each interval between breakpoints (of schedule, controller, its updates and reference) is
    divided evenly. start, end [s]: by default from the plan's preactuation until it has come to rest, and at least 5 periods of
    the slowest flexible mode after the manoeuvre. evaluate: "held" holds the feedforward's mean over each update's hold (error of
    order hold^2), "stages" evaluates the law at every stage of RK4 (order timestep^4). sensors: noise, quantization and delay
    of named measurements, for controllers that use them; seed: of the noise. progress: called now and then with the share of the
    run that is done.

    A run that diverges (a state that is not finite, or MuJoCo's warnings about one) stops there; the result holds what was
    recorded, status "diverged" and the cause. A RuntimeWarning says beforehand where the plan needs more input than the actuators
    pass on, where it starts elsewhere than the plant, where the feedback is unstable for being held so long, and where sensors are
    given that the controller does not look at.

    Raises SimulationError, PlantError for what cannot be simulated as asked.
    """
    simulated: SimulatedPlant = MujocoPlant(plant) if isinstance(plant, Plant) else plant
    changes = ordered(schedule)
    require_fit(simulated, controller, evaluate, changes)
    warn_of_limits(simulated, controller)
    warn_of_unused_sensors(controller, sensors or {})
    plan = controller.plan
    end_values = simulated.parameter_values
    for change in changes:
        end_values.update(change.parameters)
    period = simulated.vibration_period(end_values)
    if start is None and initial_state is None:
        warn_of_start(simulated, controller)
    start = plan.start if start is None else float(start)
    if end is None:
        end = max(plan.end, plan.manoeuvre[1] + (RESIDUAL_PERIODS * period if np.isfinite(period) else 0.0))
    updates = update_times(start, end, controller.period)
    breakpoints = [change.time for change in changes]
    for source in (controller.breakpoints, plan.breakpoints, simulated.breakpoints, updates):
        breakpoints.extend(source.tolist())
    grid = make_grid(start, end, breakpoints, timestep)
    initial, later = _parameters_on_grid(simulated, changes, grid)
    update = updates_of_steps(grid, updates)
    instants = stage_instants(grid) if evaluate == "stages" else held_instants(grid, update)
    warn_of_unstable_holds(controller, instants)
    run = Run(
        stepper=simulated.stepper(_state(simulated, initial_state), initial),
        law=controller.begin(instants),
        grid=grid,
        update=update,
        changes=later,
        measures=controller.measures,
        sensors=SensorChain(simulated.measurement_names, sensors or {}, seed),
    )
    recorded = run.go(at_stages=evaluate == "stages", progress=progress)
    return make_result(
        name, simulated, controller, recorded, Circumstances(grid, initial, later, timestep, evaluate, vibration_period=period)
    )


def _state(plant: SimulatedPlant, initial_state: ArrayLike | None) -> Array:
    """The state (n,) to start in: at rest at the operating point unless given."""
    n = len(plant.state_names)
    x_0 = np.zeros(n) if initial_state is None else np.array(initial_state, dtype=float)
    if x_0.shape != (n,):
        raise SimulationError(f"initial_state has shape {x_0.shape}, expected ({n},): {', '.join(plant.state_names)}")
    return x_0


def _parameters_on_grid(
    plant: SimulatedPlant, changes: Iterable[Change], grid: Grid
) -> tuple[dict[str, float], dict[int, dict[str, float]]]:
    """Parameter values at the start, and what changes at which edge of the grid."""
    initial = plant.parameter_values
    later: dict[int, dict[str, float]] = {}
    for change in changes:
        edge = grid.edge_index(change.time)
        if change.time <= grid.edges[0]:
            initial.update(change.parameters)
        elif edge is not None and edge < len(grid.step):
            later.setdefault(edge, {}).update(change.parameters)
    return initial, later
