"""The closed loop: controller and plant, step by step, on a grid that respects every breakpoint."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.control.protocol import Controller
from invtrack.errors import SimulationError
from invtrack.physics.plant import Plant
from invtrack.runs.result import RunResult
from invtrack.simulation.grid import Grid, make_grid
from invtrack.simulation.instants import held_instants, stage_instants, update_times, updates_of_steps
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.simulation.mujoco_plant import MujocoPlant
from invtrack.simulation.result import Circumstances, make_result
from invtrack.simulation.schedule import Change, ordered
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
    stop: float | None = None,
    hold: Literal["midpoint", "continuous"] = "midpoint",
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
    divided evenly. start, stop [s]: by default from the plan's preactuation until it has come to rest, and at least 5 periods of
    the slowest flexible mode after the manoeuvre. hold: "midpoint" holds the feedforward's mean over each update's hold (error of
    order hold^2), "continuous" evaluates the law at every stage of RK4 (order timestep^4). sensors: noise, quantization and delay
    of named measurements, for controllers that use them; seed: of the noise. progress: called now and then with the share of the
    run that is done.

    A run that diverges (a state that is not finite, or MuJoCo's warnings about one) stops there; the result holds what was
    recorded, status "diverged" and the cause. Where the plan needs more input than the actuators pass on, a RuntimeWarning says
    so beforehand.

    Raises SimulationError, PlantError for what cannot be simulated as asked.
    """
    simulated: SimulatedPlant = MujocoPlant(plant) if isinstance(plant, Plant) else plant
    changes = ordered(schedule)
    _require_fit(simulated, controller, hold, changes)
    _warn_of_limits(simulated, controller)
    nominal = controller.nominal
    end_values = simulated.parameter_values
    for change in changes:
        end_values.update(change.parameters)
    period = simulated.vibration_period(end_values)
    start = nominal.start if start is None else float(start)
    if stop is None:
        stop = max(nominal.end, nominal.support[1] + (RESIDUAL_PERIODS * period if np.isfinite(period) else 0.0))
    updates = update_times(start, stop, controller.period)
    breakpoints = [change.time for change in changes]
    for source in (controller.breakpoints, nominal.breakpoints, simulated.breakpoints, updates):
        breakpoints.extend(source.tolist())
    grid = make_grid(start, stop, breakpoints, timestep)
    x_0 = np.zeros(len(simulated.state_names)) if initial_state is None else np.array(initial_state, dtype=float)
    if x_0.shape != (len(simulated.state_names),):
        expected = f"({len(simulated.state_names)},): {', '.join(simulated.state_names)}"
        raise SimulationError(f"initial_state has shape {x_0.shape}, expected {expected}")
    initial, later = _parameters_on_grid(simulated, changes, grid)
    update = updates_of_steps(grid, updates)
    run = Run(
        stepper=simulated.stepper(x_0, initial),
        law=controller.begin(stage_instants(grid) if hold == "continuous" else held_instants(grid, update)),
        grid=grid,
        update=update,
        changes=later,
        measures=controller.measures,
        sensors=SensorChain(simulated.measurement_names, sensors or {}, seed),
    )
    recorded = run.go(at_stages=hold == "continuous", progress=progress)
    return make_result(
        name, simulated, controller, recorded, Circumstances(grid, initial, later, timestep, hold, vibration_period=period)
    )


def _require_fit(plant: SimulatedPlant, controller: Controller, hold: str, changes: Iterable[Change]) -> None:
    first = controller.nominal.model.systems[0]
    pairs = [(kind, getattr(first, kind), getattr(plant, kind)) for kind in ("state_names", "input_names", "output_names")]
    if controller.measures == "sensors":
        pairs.append(("measurement_names", first.measurement.names, plant.measurement_names))
    for kind, planned, real in pairs:
        if planned != real:
            raise SimulationError(
                f"the plan's {kind.replace('_', ' ')} are {list(planned)}, the plant's are {list(real)}; plan for "
                "invtrack.linearize(plant)"
            )
    if not first.operating_point.agrees_with(plant.operating_point):
        raise SimulationError("the plan was made about another operating point than the plant's; linearize this plant")
    for change in changes:
        unknown = [name for name in change.parameters if name not in plant.parameter_units]
        if unknown:
            known = ", ".join(plant.parameter_units) or "none (a linear model switches by its own switch times)"
            raise SimulationError(f"{change} names unknown parameters {unknown}; the plant's are: {known}")
    if hold not in ("midpoint", "continuous"):
        raise SimulationError(f'hold must be "midpoint" or "continuous", got {hold!r}')
    if hold == "continuous" and not (controller.stateless and controller.period is None):
        raise SimulationError(
            'hold="continuous" evaluates the law several times per step, so it needs a controller without a state and without a '
            "period"
        )


def _warn_of_limits(plant: SimulatedPlant, controller: Controller) -> None:
    """Say before anything is simulated where the plan exceeds the actuators."""
    lowest, highest = controller.nominal.input_range
    for i, name in enumerate(plant.input_names):
        low, high = plant.input_limits[i]
        if lowest[i] < low or highest[i] > high:
            warnings.warn(
                f"the plan needs {name} from {lowest[i]:.4g} to {highest[i]:.4g} {plant.input_units[i]}, its actuator passes on "
                f"{low:.4g} to {high:.4g}: expect saturation",
                RuntimeWarning,
                stacklevel=3,
            )


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
