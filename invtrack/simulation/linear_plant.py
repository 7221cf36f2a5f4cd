"""A linear model in the place of the mechanism: what theory predicts, through the same closed loop."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import require_text
from invtrack.arrays import Array, real_numbers
from invtrack.control.protocol import numbered
from invtrack.errors import SimulationError
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.switched import as_switched
from invtrack.plans.plan import Difference
from invtrack.simulation.acting_limits import ActingLimit, Stretches, clipped
from invtrack.simulation.grid import Grid
from invtrack.simulation.native.law import Calls
from invtrack.simulation.native.record import STAGES, RunMemory
from invtrack.simulation.simulated_plant import SimulatedPlant


class LinearPlant:
    """A StateSpace or SwitchedSystem that can be simulated like a MuJoCo plant.

    model: what the plant really is, with its own switch times, which may differ from those of the plan; its channels are the
    plant's. input_limits (m, 2): what the actuators pass on; those that the model states unless others
    are given.

    Raises SimulationError for limits that do not fit.
    """

    def __init__(self, model: Any, *, input_limits: ArrayLike | None = None, name: str = "linear model") -> None:
        self.model = as_switched(model)
        self.name = require_text("name", name, error=SimulationError)
        m = self.model.n_inputs
        given = self.model.input_limits if input_limits is None else input_limits
        limits = real_numbers("input_limits", given, error=SimulationError)
        if limits.shape != (m, 2) or not np.all(limits[:, 0] <= limits[:, 1]):
            raise SimulationError(f"input_limits must be ({m}, 2), lowest before highest, got {limits.tolist()}")
        self.input_limits: Array = limits


def linear_plant(plant: LinearPlant) -> SimulatedPlant:
    """What a linear plant is to the closed loop: it has no parameters, for it switches by itself."""
    model = plant.model
    return SimulatedPlant(
        name=plant.name,
        integrator="exact",
        states=model.states,
        inputs=model.inputs,
        outputs=model.outputs,
        measurements=model.measurements,
        operating_point=model.operating_point,
        rest=model.rest_states[0],
        input_limits=plant.input_limits,
        stepper=lambda x, parameters: LinearStepper(plant, x),
        breakpoints=model.switch_times,
    )


class LinearStepper:
    """Exact steps with a held input, x - rest <- A_d (x - rest) + B_d (u - u0), or RK4 with the input evaluated at every stage."""

    def __init__(self, plant: LinearPlant, x: Array) -> None:
        self._plant = plant
        first = plant.model.systems[0]
        self._x = np.array(x, dtype=float)
        p, self.n_values = first.n_outputs, first.n_outputs + len(first.measurement.channels)
        self.output_columns, self.measurement_columns = np.arange(p), np.arange(p, self.n_values)

    @property
    def width(self) -> int:
        """Length of a raw state: that of the state."""
        return len(self._x)

    def bind(self, memory: RunMemory, calls: Calls, grid: Grid) -> None:
        """Put the plant into the record of a run."""
        model = self._plant.model
        n, m = model.n_states, model.n_inputs
        low, high = self._plant.input_limits.T
        cases, case = numbered(zip(model.numbers[model.interval(grid.middles)].tolist(), grid.alike.tolist(), strict=True))
        systems = [model.distinct[number] for number, _ in cases]
        rows = [np.block([[s.C, s.D], [s.measurement.C, s.measurement.D]]) for s in systems]
        steps = [np.hstack(zero_order_hold(system.A, system.B, h)) for system, (_, h) in zip(systems, cases, strict=True)]
        memory.put(linear=1, qpos=self._x, values=np.zeros(self.n_values), together=np.zeros(n + m), rates=np.zeros((STAGES, n)))
        memory.copy(
            ctrl=model.systems[0].operating_point.u0,
            inputs=np.arange(m),
            case=case,
            transitions=np.stack(steps),
            sensor_rows=np.stack(rows),
            rests=np.stack([system.rest for system in systems]),
            u0=np.stack([system.operating_point.u0 for system in systems]),
            y0=np.stack([np.concatenate([system.operating_point.y0, system.measurement.y0]) for system in systems]),
            A=np.stack([system.A for system in systems]),
            B=np.stack([system.B for system in systems]),
            low=low,
            high=high,
        )

    def running(self, memory: RunMemory, *, at_stages: bool) -> AbstractContextManager[None]:
        """Steps may be taken at any time."""
        return nullcontext()

    def begin(self, timestep: float, time: float) -> None:
        """There is nothing to prepare."""

    def change(self, parameters: Mapping[str, float]) -> None:
        """A linear plant has no parameters: it switches by itself."""

    def deviations(self, raw: Array) -> Array:
        """The raw states themselves."""
        return raw

    def passed_on(self, raw: Array, u: Array) -> tuple[Array, Array]:
        """The inputs within their limits, and how far they were beyond."""
        return clipped(u, self._plant.input_limits)

    @property
    def limits(self) -> Sequence[ActingLimit]:
        """Those of the inputs."""
        inputs = self._plant.model.inputs
        return [ActingLimit(f"limit of {name}", unit) for name, unit in zip(inputs.names, inputs.units, strict=True)]

    def constrained(self, steps: int) -> Mapping[ActingLimit, Stretches]:
        """Nothing else limits a linear plant."""
        return {}

    def origins(self, x: Array, difference: Difference) -> Array | None:
        """None: a linear plant's loop takes plain differences."""
        return None

    def positions(self, raw: Array) -> Array:
        """No columns: there is no geometry."""
        return np.zeros((len(raw), 0))

    def failed(self) -> bool:
        """Whether the state is not finite."""
        return not bool(np.all(np.isfinite(self._x)))
