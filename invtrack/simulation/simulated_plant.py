"""What a plant is to the closed loop: names and units, and a stepper for one run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Law
from invtrack.linear.state_space import OperatingPoint

Array = NDArray[np.float64]


class Stepper(Protocol):
    """One run of a plant, as live memory that the loop reads and writes and a function that takes a step.

    state: the arrays that together, in their order, are the plant's raw state. control (p,): the input that the next step holds.
    sensors: after advance() the sensor values at the step's start, of which output_columns (p,) are the outputs and
    measurement_columns (m,) the measurements. advance: takes one step.
    """

    state: tuple[Array, ...]
    control: Array
    sensors: Array
    output_columns: NDArray[np.intp]
    measurement_columns: NDArray[np.intp]
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


class SimulatedPlant(Protocol):
    """Names, units, limits and steppers of a plant; names and units of each kind are of the same length."""

    @property
    def name(self) -> str: ...
    @property
    def integrator(self) -> str: ...
    @property
    def state_names(self) -> tuple[str, ...]: ...
    @property
    def state_units(self) -> tuple[str, ...]: ...
    @property
    def input_names(self) -> tuple[str, ...]: ...
    @property
    def input_units(self) -> tuple[str, ...]: ...
    @property
    def output_names(self) -> tuple[str, ...]: ...
    @property
    def output_units(self) -> tuple[str, ...]: ...
    @property
    def measurement_names(self) -> tuple[str, ...]: ...
    @property
    def measurement_units(self) -> tuple[str, ...]: ...
    @property
    def parameter_units(self) -> Mapping[str, str]: ...
    @property
    def parameter_values(self) -> dict[str, float]: ...
    @property
    def parameter_bodies(self) -> Mapping[str, str]: ...
    @property
    def operating_point(self) -> OperatingPoint: ...

    @property
    def input_limits(self) -> Array:
        """Lowest and highest value of each input that the actuator passes on (p, 2)."""
        ...

    @property
    def breakpoints(self) -> Array:
        """Times [s] at which the plant changes by itself."""
        ...

    def vibration_period(self, parameters: Mapping[str, float]) -> float:
        """Period [s] of the slowest flexible mode at the end of a run; NaN where there is none."""
        ...

    def stepper(self, x: Array, parameters: Mapping[str, float]) -> Stepper:
        """A stepper that starts at the state x (n,)."""
        ...

    def binary(self, parameters: Mapping[str, float]) -> bytes:
        """The compiled MuJoCo model for the 3-D scene; empty where there is none."""
        ...
