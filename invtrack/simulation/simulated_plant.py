"""What a plant is to the closed loop: its channels, a stepper for one run, and the sensors in between."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from invtrack.arguments import instance
from invtrack.arrays import Array, Indices, require_not_negative, whole_number
from invtrack.channels import Channels
from invtrack.control.protocol import Law
from invtrack.errors import SimulationError
from invtrack.linear.state_space import OperatingPoint
from invtrack.plans.plan import Plan
from invtrack.plant.actuator_delays import ActuatorDelay
from invtrack.simulation.acting_limits import ActingLimit, Stretches


class Stepper(Protocol):
    """One run of a plant, as live memory that the loop reads and writes and a function that takes a step.

    state: the arrays that together, in their order, are the plant's raw state. control (p,): the input that the next step holds.
    sensors: after advance() the sensor values at the step's start, of which output_columns (p,) are the outputs and
    measurement_columns (m,) the measurements. advance: takes one step.
    """

    state: tuple[Array, ...]
    control: Array
    sensors: Array
    output_columns: Indices
    measurement_columns: Indices
    advance: Callable[[], None]

    def enter(self, timestep: float, time: float, parameters: Mapping[str, float]) -> None:
        """Start an interval: length of its steps [s], its time [s], parameters that change now (empty: none)."""
        ...

    def refresh(self) -> None:
        """Bring `sensors` up to the present state."""
        ...

    def deviations(self, raw: Array) -> Array:
        """States (k, n), as deviations from the operating point, of raw states (k, r)."""
        ...

    @property
    def raw_is_deviation(self) -> bool:
        """Whether a raw state is already the deviation, so that nothing need be computed."""
        ...

    def positions(self, raw: Array) -> Array:
        """qpos (k, nq) of raw states (k, r); without columns for a plant without geometry."""
        ...

    def passed_on(self, raw: Array, u: Array) -> tuple[Array, Array]:
        """What is applied of inputs u (k, p) in steps that begin at raw states (k, r), and the excess over each limit (k, L).

        The steps are the latest, all of the present interval; the columns of the excess are those of `limits`.
        """
        ...

    @property
    def limits(self) -> Sequence[ActingLimit]:
        """The limits of actuators that may act, in the order of the columns of an excess, the inputs' first."""
        ...

    def constrained(self) -> Mapping[ActingLimit, Stretches]:
        """When other limits and contacts acted, in the steps taken so far."""
        ...

    def stages(self, law: Law) -> AbstractContextManager[StageInput]:
        """A block in which the law is evaluated at every stage of the integrator instead of being held."""
        ...

    def failed(self) -> bool:
        """Whether the integration has broken down."""
        ...


class StageInput(Protocol):
    """Steps with the input evaluated anew at each stage; instants 3 i, 3 i + 1, 3 i + 2 are step i's start, middle and end."""

    def step(self, index: int) -> Array:
        """Take step number `index`; returns the input (p,) at its middle."""
        ...


@dataclass(frozen=True, eq=False)
class SimulatedPlant:
    """Channels, limits and steppers of a plant.

    Args:
        name: of the plant.
        integrator: what its steps are computed with.
        states, inputs, outputs, measurements: their `Channels`.
        operating_point: what states are deviations from.
        rest: the state in which it is at rest before anything changes (n,).
        input_limits: lowest and highest value of each input that the actuator passes on (p, 2).
        stepper: makes a stepper that starts at a state x (n,) with given parameter values.
        beyond: limits that a plan goes beyond, those of the inputs aside: each with the time [s] at which it first does, and by
            how much at most.
        binary: makes the compiled MuJoCo model with given parameter values, for the 3-D scene; empty where there is none.
        parameters: names and units of the physical parameters that may change during a run.
        parameter_values: the plant's own values of these.
        parameter_bodies: for those that belong to one body, its name.
        breakpoints: times at which the plant changes by itself [s].
        delays: of actuators that act later than they are told to.
    """

    name: str
    integrator: str
    states: Channels
    inputs: Channels
    outputs: Channels
    measurements: Channels
    operating_point: OperatingPoint
    rest: Array
    input_limits: Array
    stepper: Callable[[Array, Mapping[str, float]], Stepper]
    beyond: Callable[[Plan], Sequence[tuple[ActingLimit, float, float]]] = lambda plan: ()
    binary: Callable[[Mapping[str, float]], bytes] = lambda parameters: b""
    parameters: Channels = field(default_factory=Channels)
    parameter_values: Mapping[str, float] = field(default_factory=dict)
    parameter_bodies: Mapping[str, str] = field(default_factory=dict)
    breakpoints: Array = field(default_factory=lambda: np.zeros(0))
    delays: tuple[ActuatorDelay, ...] = ()


@dataclass(frozen=True)
class Sensor:
    """Imperfections of one measurement: noise, its standard deviation; quantization, the size of a digit; both in the measurement's
    unit; delay [s]. Zero: none.

    Raises SimulationError for negative values.
    """

    noise: float = 0.0
    quantization: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require_not_negative(f"a sensor's {name}", value, error=SimulationError)


class SensorChain:
    """All measurements of one run: ideal values in, what the controller sees out. Seeded: the same run gives the same noise."""

    def __init__(self, names: Sequence[str], sensors: Mapping[str, Sensor], seed: int) -> None:
        for name, sensor in sensors.items():
            instance(f"the sensor of {name!r}", sensor, Sensor, expected="an invtrack.Sensor", error=SimulationError)
        unknown = [name for name in sensors if name not in names]
        if unknown:
            raise SimulationError(f"sensors are given for {unknown}; the plant's measurements are: {', '.join(names)}")
        chosen = [sensors.get(name, Sensor()) for name in names]
        self._noise = np.array([sensor.noise for sensor in chosen])
        self._digit = np.array([sensor.quantization for sensor in chosen])
        self._delay = np.array([sensor.delay for sensor in chosen])
        self._noisy, self._digital, self._late = bool(np.any(self._noise)), bool(np.any(self._digit)), bool(np.any(self._delay))
        self._random = np.random.default_rng(whole_number("seed", seed, error=SimulationError))

    def sample(self, index: int, time: Array, ideal: Array, columns: Indices) -> Array:
        """What the sensors show at time[index] (m,), from ideal values (N, k) up to and including row `index`, in m columns.

        A delayed sensor shows an earlier value, interpolated between steps; before the run began, the first.
        """
        shown = self._delayed(index, time, ideal, columns) if self._late else ideal[index, columns]
        if self._noisy:
            shown += self._noise * self._random.standard_normal(len(shown))
        if self._digital:
            digital = self._digit > 0
            shown[digital] = np.rint(shown[digital] / self._digit[digital]) * self._digit[digital]
        return shown

    def _delayed(self, index: int, time: Array, ideal: Array, columns: Indices) -> Array:
        if index == 0:
            return np.asarray(ideal[0, columns])
        instants = time[index] - self._delay
        after = np.clip(np.searchsorted(time[: index + 1], instants), 1, index)
        span = time[after] - time[after - 1]
        share = np.clip((instants - time[after - 1]) / span, 0.0, 1.0)
        return np.asarray(ideal[after - 1, columns] * (1 - share) + ideal[after, columns] * share)
