"""The closed loop: controller and plant, step by step, on a grid that respects every breakpoint."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.control.protocol import Controller, Instants, Law
from invtrack.errors import SimulationError
from invtrack.physics.callbacks import mujoco_warnings
from invtrack.physics.plant import Plant
from invtrack.runs.result import RunResult
from invtrack.simulation.grid import Grid, make_grid
from invtrack.simulation.mujoco_stepper import ContinuousInput, MujocoStepper
from invtrack.simulation.result import Recorded, make_result
from invtrack.simulation.schedule import Change, ordered
from invtrack.simulation.vibration import slowest_flexible_period

Array = NDArray[np.float64]
Progress = Callable[[float], object]

CHECK_EVERY = 128
"""Steps between two looks for divergence (and two reports of progress)."""

LARGEST = 1e10
"""Beyond this (MuJoCo's mjMAXVAL) a state or an input counts as diverged."""

RESIDUAL_PERIODS = 5
"""A run goes on for this many periods of the slowest flexible mode after the manoeuvre, unless told otherwise."""


def simulate(
    plant: Plant,
    controller: Controller,
    *,
    schedule: Sequence[Change] = (),
    timestep: float = 1e-3,
    start: float | None = None,
    stop: float | None = None,
    hold: Literal["midpoint", "continuous"] = "midpoint",
    initial_state: ArrayLike | None = None,
    name: str = "run",
    progress: Progress | None = None,
) -> RunResult:
    """Drive a MuJoCo plant with a controller and record everything.

    plant: starts at rest at its operating point, or at `initial_state` (n,). schedule: when physical parameters really change,
    known to the controller or not; positions and velocities are continuous there. timestep [s]: no step is longer; each interval
    between breakpoints (of schedule, controller and reference) is divided evenly. start, stop [s]: by default from the plan's
    preactuation until it has come to rest, and at least 5 periods of the slowest flexible mode after the manoeuvre. hold:
    "midpoint" holds the feedforward's value at mid-step over the step (error of order timestep^2), "continuous" evaluates the law
    at every stage of RK4 (order timestep^4). progress: called now and then with the share of the run that is done.

    A run that diverges (a state that is not finite, or MuJoCo's warnings about one) stops there; the result holds what was
    recorded, status "diverged" and the cause.

    Raises SimulationError, PlantError for what cannot be simulated as asked.
    """
    _require_fit(plant, controller, hold)
    changes = ordered(schedule)
    nominal = controller.nominal
    end_values = plant.parameter_values
    for change in changes:
        end_values.update(change.parameters)
    period = slowest_flexible_period(plant, end_values)
    start = nominal.start if start is None else float(start)
    if stop is None:
        stop = max(nominal.end, nominal.support[1] + (RESIDUAL_PERIODS * period if np.isfinite(period) else 0.0))
    times = [change.time for change in changes]
    grid = make_grid(start, stop, [*times, *controller.breakpoints, *nominal.breakpoints], timestep)
    x_0 = np.zeros(plant.n_states) if initial_state is None else np.array(initial_state, dtype=float)
    if x_0.shape != (plant.n_states,):
        raise SimulationError(f"initial_state has shape {x_0.shape}, expected ({plant.n_states},): {', '.join(plant.state_names)}")
    initial, later = _parameters_on_grid(plant, changes, grid)
    stepper = MujocoStepper(plant, x_0, initial)
    law = controller.begin(_instants(grid, hold))
    recorded = _run(stepper, law, grid, later, hold == "continuous", progress)
    return make_result(
        name=name,
        plant=plant,
        controller=controller,
        grid=grid,
        recorded=recorded,
        applied=stepper.applied(recorded.commanded),
        initial=initial,
        later=later,
        timestep=timestep,
        hold=hold,
        vibration_period=period,
    )


def _require_fit(plant: Plant, controller: Controller, hold: str) -> None:
    first = controller.nominal.model.systems[0]
    for kind in ("state_names", "input_names", "output_names"):
        planned, real = getattr(first, kind), getattr(plant, kind)
        if planned != real:
            raise SimulationError(
                f"the plan's {kind.replace('_', ' ')} are {list(planned)}, the plant's are {list(real)}; plan for "
                "invtrack.linearize(plant)"
            )
    if not first.operating_point.agrees_with(plant.operating_point):
        raise SimulationError("the plan was made about another operating point than the plant's; linearize this plant")
    if hold not in ("midpoint", "continuous"):
        raise SimulationError(f'hold must be "midpoint" or "continuous", got {hold!r}')
    if hold == "continuous" and not controller.stateless:
        raise SimulationError(
            'hold="continuous" evaluates the law several times per step, so it needs a controller without a state'
        )


def _parameters_on_grid(
    plant: Plant, changes: Iterable[Change], grid: Grid
) -> tuple[dict[str, float], dict[int, dict[str, float]]]:
    """Parameter values at the start, and what changes at which edge of the grid."""
    initial = plant.parameter_values
    later: dict[int, dict[str, float]] = {}
    for change in changes:
        unknown = [name for name in change.parameters if name not in plant.parameters]
        if unknown:
            known = ", ".join(plant.parameters) or "none"
            raise SimulationError(f"{change} names unknown parameters {unknown}; the plant's are: {known}")
        edge = grid.edge_index(change.time)
        if change.time <= grid.edges[0]:
            initial.update(change.parameters)
        elif edge is not None and edge < len(grid.step):
            later.setdefault(edge, {}).update(change.parameters)
    return initial, later


def _instants(grid: Grid, hold: str) -> Instants:
    """Start of each step; or start, middle and end of each, where the law is evaluated at every stage."""
    begin, length = grid.time[:-1], grid.step[grid.interval]
    if hold == "midpoint":
        return Instants(begin, length, grid.middle)
    time = np.column_stack([begin, begin + length / 2, grid.time[1:]]).ravel()
    return Instants(time, np.zeros(len(time)), np.repeat(grid.middle, 3))


@dataclass
class _Arrays:
    x: Array
    qpos: Array
    y: Array
    u: Array


def _run(
    stepper: MujocoStepper, law: Law, grid: Grid, later: dict[int, dict[str, float]], continuous: bool, progress: Progress | None
) -> Recorded:
    plant, total = stepper.plant, grid.n_steps
    p = len(plant.inputs)
    arrays = _Arrays(
        x=np.empty((total + 1, plant.n_states)),
        qpos=np.empty((total + 1, stepper.model.nq)),
        y=np.empty((total + 1, len(plant.outputs))),
        u=np.empty((total, p)),
    )
    done, failed = 0, False
    callback_block = ContinuousInput(stepper, law) if continuous else nullcontext()
    # Until the check at a chunk's end sees it, a diverging run may compute with infinities.
    with mujoco_warnings() as texts, callback_block as callback, np.errstate(all="ignore"):
        for k, step in enumerate(grid.step):
            stepper.enter(float(step), float(grid.edges[k]), later.get(k, {}))
            last = int(grid.first_step[k + 1])
            while done < last and not failed:
                chunk = range(done, min(done + CHECK_EVERY, last))
                if callback is None:
                    _hold_at_midpoint(stepper, law, chunk, arrays)
                else:
                    _evaluate_at_stages(stepper, callback, chunk, arrays)
                done = chunk.stop
                failed = stepper.failed()
                if progress is not None:
                    progress(done / total)
            if failed:
                break
        stepper.read(arrays.x[done], arrays.qpos[done])
        stepper.read_outputs(arrays.y[done])
    return _kept(arrays, done, texts)


def _hold_at_midpoint(stepper: MujocoStepper, law: Law, steps: range, arrays: _Arrays) -> None:
    x, qpos, y, commanded = arrays.x, arrays.qpos, arrays.y, arrays.u
    read, update, step = stepper.read, law.update, stepper.step
    for i in steps:
        state = x[i]
        read(state, qpos[i])
        u = update(i, state)
        commanded[i] = u
        step(u, y[i])


def _evaluate_at_stages(stepper: MujocoStepper, callback: ContinuousInput, steps: range, arrays: _Arrays) -> None:
    for i in steps:
        stepper.read(arrays.x[i], arrays.qpos[i])
        callback.before_step(i)
        stepper.step(stepper.data.ctrl[stepper.plant.input_addresses], arrays.y[i])
        arrays.u[i] = callback.middle


def _kept(arrays: _Arrays, done: int, texts: Sequence[str]) -> Recorded:
    """What was recorded, up to the last state and input within what MuJoCo integrates; its other warnings are passed on."""
    good = np.all(np.abs(arrays.x[: done + 1]) < LARGEST, axis=1)  # NaN compares false
    good[1:] &= np.all(np.abs(arrays.u[:done]) < LARGEST, axis=1)  # MuJoCo replaces such an input by zero
    if good.all():
        for text in texts:
            warnings.warn(f"MuJoCo: {text}", RuntimeWarning, stacklevel=4)
        return Recorded(arrays.x[: done + 1], arrays.qpos[: done + 1], arrays.y[: done + 1], arrays.u[:done], "")
    last = max(int(np.argmin(good)) - 1, 0)
    cause = f"MuJoCo reports: {texts[0]}" if texts else f"a state or input exceeds {LARGEST:.0e}"
    return Recorded(arrays.x[: last + 1], arrays.qpos[: last + 1], arrays.y[: last + 1], arrays.u[:last], cause)
