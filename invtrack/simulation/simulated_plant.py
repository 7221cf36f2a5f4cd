"""What a plant is to the closed loop: its channels, and a stepper for one run."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from invtrack.channels import Channels
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


@dataclass(frozen=True, eq=False)
class SimulatedPlant:
    """Channels, limits and steppers of a plant.

    parameters: names and units of the physical parameters that may change during a run; parameter_values: what they are as the
    plant is; parameter_bodies: for those that belong to one body, its name. input_limits (p, 2): lowest and highest value of each
    input that the actuator passes on. breakpoints: times [s] at which the plant changes by itself. stepper: makes a stepper that
    starts at the state x (n,) with parameter values. binary: the compiled MuJoCo model with parameter values, for the 3-D scene;
    empty where there is none.
    """

    name: str
    integrator: str
    states: Channels
    inputs: Channels
    outputs: Channels
    measurements: Channels
    operating_point: OperatingPoint
    input_limits: Array
    stepper: Callable[[Array, Mapping[str, float]], Stepper]
    binary: Callable[[Mapping[str, float]], bytes] = lambda parameters: b""
    parameters: Channels = field(default_factory=Channels)
    parameter_values: Mapping[str, float] = field(default_factory=dict)
    parameter_bodies: Mapping[str, str] = field(default_factory=dict)
    breakpoints: Array = field(default_factory=lambda: np.zeros(0))
