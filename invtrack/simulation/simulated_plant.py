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
from invtrack.errors import SimulationError
from invtrack.linear.state_space import OperatingPoint
from invtrack.plans.plan import Difference, Plan
from invtrack.plant.actuator_delays import ActuatorDelay
from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.grid import Grid
from invtrack.simulation.native.law import Calls
from invtrack.simulation.native.record import RunMemory


class Stepper(Protocol):
    """One run of a plant: it puts its memory into the record on which the compiled loop works.

    output_columns (p,) and measurement_columns (m,): where both stand among the values that are seen at each step's start.
    """

    output_columns: Indices
    measurement_columns: Indices

    @property
    def width(self) -> int:
        """Length of a raw state."""
        ...

    @property
    def n_values(self) -> int:
        """Number of values that are seen at each step's start."""
        ...

    def bind(self, memory: RunMemory, calls: Calls, grid: Grid) -> None:
        """Put the plant into the record of a run on this grid."""
        ...

    def running(self, memory: RunMemory, *, at_stages: bool) -> AbstractContextManager[None]:
        """A block in which steps may be taken, with the law evaluated at every stage of the integrator or held."""
        ...

    def begin(self, timestep: float, time: float) -> None:
        """Start the run at a time [s], with steps of a length [s]."""
        ...

    def change(self, parameters: Mapping[str, float]) -> None:
        """Give parameters new values."""
        ...

    def deviations(self, raw: Array) -> Array:
        """States (k, n), as deviations from the operating point, of raw states (k, r)."""
        ...

    def origins(self, x: Array, difference: Difference) -> Array | None:
        """Raw states (k, r) of states x (k, n), where the compiled loop measures from them as this difference does; else None."""
        ...

    def positions(self, raw: Array) -> Array:
        """qpos (k, nq) of raw states (k, r); without columns for a plant without geometry."""
        ...

    def passed_on(self, raw: Array, u: Array) -> tuple[Array, Array]:
        """What is applied of inputs u (k, p) in steps between raw states (k + 1, r), and the excess over each limit (k, L).

        The parameters have not changed since; the columns of the excess are those of `limits`.
        """
        ...

    @property
    def limits(self) -> Sequence[ActingLimit]:
        """The limits of actuators that may act, in the order of the columns of an excess, the inputs' first."""
        ...

    def constrained(self, steps: int) -> Mapping[ActingLimit, Stretches]:
        """When other limits and contacts acted, in the steps taken so far."""
        ...

    def failed(self) -> bool:
        """Whether the integration has broken down."""
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
        self._noise = np.array([sensor.noise for sensor in chosen], dtype=float)
        self._digit = np.array([sensor.quantization for sensor in chosen], dtype=float)
        self._delay = np.array([sensor.delay for sensor in chosen], dtype=float)
        self._random = np.random.default_rng(whole_number("seed", seed, error=SimulationError))

    def bind(self, memory: RunMemory, columns: Indices) -> None:
        """Put the sensors into the record of a run, whose measurements (m,) stand in these columns of what is seen."""
        memory.put(from_sensors=1, noise=self._noise, digit=self._digit, delay=self._delay)
        memory.copy(columns=columns, late_from=np.zeros(len(columns), dtype=np.int64))

    def prepare(self, memory: RunMemory, updates: int) -> None:
        """Draw the noise of the next updates."""
        size = updates, len(self._noise)
        memory.put(random=self._random.standard_normal(size) if np.any(self._noise) else np.zeros(size))
