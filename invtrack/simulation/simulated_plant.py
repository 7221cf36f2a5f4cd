"""What a plant is to the closed loop: names and units, and a stepper for one run."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import AbstractContextManager
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Law
from invtrack.lti.state_space import OperatingPoint

Array = NDArray[np.float64]


class Stepper(Protocol):
    """One run of a plant. Arrays named in the arguments are written to."""

    @property
    def n_positions(self) -> int:
        """Length of qpos; 0 for a plant without geometry."""
        ...

    def enter(self, timestep: float, time: float, parameters: Mapping[str, float]) -> None:
        """Start an interval: length of its steps [s], its time [s], parameters that change now (empty: none)."""
        ...

    def read(self, x: Array, qpos: Array) -> None:
        """Write the state (n,), as deviation from the operating point, and qpos."""
        ...

    def sense(self, y_m: Array) -> None:
        """Write what ideal sensors measure at the present state (m,)."""
        ...

    def step(self, u: Array, y: Array, y_m: Array) -> None:
        """Hold the input u (p,) for one step; write outputs (p,) and measurements (m,) at the step's start."""
        ...

    def read_outputs(self, y: Array, y_m: Array) -> None:
        """Write outputs and measurements at the present state."""
        ...

    def stages(self, law: Law) -> AbstractContextManager[StageInput]:
        """A block in which the law is evaluated at every stage of the integrator instead of being held."""
        ...

    def failed(self) -> bool:
        """Whether the integration has broken down."""
        ...


class StageInput(Protocol):
    """Steps with the input evaluated anew at each stage; instants 3 i, 3 i + 1, 3 i + 2 are step i's start, middle and end."""

    def step(self, index: int, y: Array, y_m: Array) -> Array:
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
