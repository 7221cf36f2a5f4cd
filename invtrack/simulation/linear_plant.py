"""A linear model in the place of the mechanism: what theory predicts, through the same closed loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import require_text
from invtrack.arrays import Array, real_numbers
from invtrack.control.protocol import Law
from invtrack.errors import SimulationError
from invtrack.linear.propagation import zero_order_hold
from invtrack.linear.switched import as_switched
from invtrack.simulation.acting_limits import ActingLimit, Stretches, clipped
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

    raw_is_deviation = True

    def __init__(self, plant: LinearPlant, x: Array) -> None:
        self._plant = plant
        self._system = plant.model.systems[0]
        n, m, p = self._system.n_states, self._system.n_inputs, self._system.n_outputs
        measured = len(self._system.measurement.channels)
        self._x = np.array(x)
        self.state: tuple[Array, ...] = (self._x,)
        self.control: Array = np.array(self._system.operating_point.u0)
        self.sensors: Array = np.zeros(p + measured)
        self.output_columns, self.measurement_columns = np.arange(p), np.arange(p, p + measured)
        self.advance: Callable[[], None] = self._advance
        self._low, self._high = plant.input_limits.T
        self._known: dict[tuple[int, float], tuple[Array, Array]] = {}
        self._transition, self._timestep = np.zeros((n, n + m)), 0.0
        self._sensor_rows = np.zeros((p + measured, n + m))
        self._sensors_at_rest = np.zeros(p + measured)

    def enter(self, timestep: float, time: float, parameters: Mapping[str, float]) -> None:
        """Start an interval of steps of one length [s] at `time` [s]."""
        # A little inside the interval: its start may be a switch time, computed in another way.
        k = int(self._plant.model.interval(time + timestep / 2))
        system = self._system = self._plant.model.systems[k]
        if (k, timestep) not in self._known:
            rows = np.block([[system.C, system.D], [system.measurement.C, system.measurement.D]])
            self._known[k, timestep] = np.hstack(zero_order_hold(system.A, system.B, timestep)), rows
        self._timestep = timestep
        self._transition, self._sensor_rows = self._known[k, timestep]
        self._sensors_at_rest = np.concatenate([system.operating_point.y0, system.measurement.y0])

    def refresh(self) -> None:
        """Bring `sensors` up to the present state and input."""
        self._sense(np.concatenate([self._x - self._system.rest, self._deviation(self.control)]))

    def _advance(self) -> None:
        rest = self._system.rest
        together = np.concatenate([self._x - rest, self._deviation(self.control)])
        self._sense(together)
        self._x[:] = rest + self._transition @ together

    def _deviation(self, u: Array) -> Array:
        return np.asarray(np.clip(u, self._low, self._high) - self._system.operating_point.u0)

    def _sense(self, together: Array) -> None:
        self.sensors[:] = self._sensors_at_rest + self._sensor_rows @ together

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

    def constrained(self) -> Mapping[ActingLimit, Stretches]:
        """Nothing else limits a linear plant."""
        return {}

    def positions(self, raw: Array) -> Array:
        """No columns: there is no geometry."""
        return np.zeros((len(raw), 0))

    @contextmanager
    def stages(self, law: Law) -> Iterator[LinearStageInput]:
        """A block in which the law is evaluated at every stage."""
        yield LinearStageInput(self, law)

    def failed(self) -> bool:
        """Whether the state is not finite."""
        return not bool(np.all(np.isfinite(self._x)))

    def runge_kutta(self, index: int, law: Law) -> Array:
        """One step of RK4 with the law evaluated at each stage; returns the input at mid-step."""
        system, h, x = self._system, self._timestep, self._x.copy()
        rates: list[Array] = []
        inputs: list[Array] = []
        for instant, share in ((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0)):
            state = x + share * h * rates[-1] if rates else x
            inputs.append(law.update(3 * index + instant, state))
            rates.append(system.A @ (state - system.rest) + system.B @ self._deviation(inputs[-1]))
        self.control[:] = inputs[0]
        self.refresh()
        self._x[:] = x + h / 6 * (rates[0] + 2 * rates[1] + 2 * rates[2] + rates[3])
        return inputs[1]


class LinearStageInput:
    """Steps of RK4 of a linear plant under one law."""

    def __init__(self, stepper: LinearStepper, law: Law) -> None:
        self._stepper, self._law = stepper, law

    def step(self, index: int) -> Array:
        """Take step number `index`; returns the input (p,) at its middle."""
        return self._stepper.runge_kutta(index, self._law)
