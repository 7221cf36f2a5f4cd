"""A linear model in the place of the mechanism: what theory predicts, through the same closed loop."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike, NDArray

from invtrack.control.protocol import Law
from invtrack.errors import SimulationError
from invtrack.lti.modes import slowest_flexible_period
from invtrack.lti.state_space import OperatingPoint
from invtrack.lti.switched import as_switched

Array = NDArray[np.float64]


class LinearPlant:
    """A StateSpace or SwitchedSystem that can be simulated like a MuJoCo plant.

    model: what the plant really is, with its own switch times, which may differ from those of the plan. input_limits (p, 2): what
    the actuators pass on; unlimited unless stated. units: of states, inputs and outputs by name, "1" unless stated; those of a
    MuJoCo plant are taken over by `like=plant`.

    Raises SimulationError for limits that do not fit.
    """

    integrator = "exact"

    def __init__(
        self,
        model: Any,
        *,
        input_limits: ArrayLike | None = None,
        units: Mapping[str, str] | None = None,
        like: Any = None,
        name: str = "linear model",
    ) -> None:
        self.model = as_switched(model)
        first = self.model.systems[0]
        self.name = name
        self.state_names, self.input_names, self.output_names = first.state_names, first.input_names, first.output_names
        self.measurement_names = first.measurement.names
        known = dict(units or {})
        if like is not None:
            for kind in ("state", "input", "output", "measurement"):
                known |= dict(zip(getattr(like, f"{kind}_names"), getattr(like, f"{kind}_units"), strict=True))
            input_limits = like.input_limits if input_limits is None else input_limits
        self.state_units, self.input_units = _units(self.state_names, known), _units(self.input_names, known)
        self.output_units, self.measurement_units = _units(self.output_names, known), _units(self.measurement_names, known)
        limits = np.array([[-np.inf, np.inf]] * first.n_channels if input_limits is None else input_limits, dtype=float)
        if limits.shape != (first.n_channels, 2) or np.any(limits[:, 0] > limits[:, 1]):
            raise SimulationError(f"input_limits must be ({first.n_channels}, 2), lowest before highest, got {limits.tolist()}")
        self.input_limits: Array = limits
        self.parameter_units: dict[str, str] = {}
        self.parameter_bodies: dict[str, str] = {}

    @property
    def parameter_values(self) -> dict[str, float]:
        """None: the models are given as they are."""
        return {}

    @property
    def operating_point(self) -> OperatingPoint:
        """That of the models."""
        return self.model.systems[0].operating_point

    @property
    def breakpoints(self) -> Array:
        """The model's switch times [s]."""
        return self.model.switch_times

    def vibration_period(self, parameters: Mapping[str, float]) -> float:
        """Period [s] of the slowest flexible mode of the last interval; NaN where there is none."""
        return slowest_flexible_period(self.model.systems[-1].A)

    def stepper(self, x: Array, parameters: Mapping[str, float]) -> LinearStepper:
        """A stepper that starts at x (n,)."""
        return LinearStepper(self, x)

    def binary(self, parameters: Mapping[str, float]) -> bytes:
        """Empty: there is no geometry."""
        return b""


class LinearStepper:
    """Exact steps with a held input, x <- A_d x + B_d u; with an input evaluated at every stage, steps of RK4."""

    n_positions = 0

    def __init__(self, plant: LinearPlant, x: Array) -> None:
        self._plant, self._x = plant, np.array(x)
        self._system = plant.model.systems[0]
        self._low, self._high = plant.input_limits.T
        self._transitions: dict[tuple[int, float], Array] = {}
        self._transition = np.zeros((0, 0))
        self._timestep = 0.0

    def enter(self, timestep: float, time: float, parameters: Mapping[str, float]) -> None:
        """Start an interval of steps of one length [s] at `time` [s]."""
        # A little inside the interval: its start may be a switch time, computed in another way.
        k = int(self._plant.model.interval(time + timestep / 2))
        self._system, self._timestep = self._plant.model.systems[k], timestep
        if (k, timestep) not in self._transitions:
            n, p = self._system.n_states, self._system.n_channels
            block = np.block([[self._system.A, self._system.B], [np.zeros((p, n + p))]])
            self._transitions[k, timestep] = scipy.linalg.expm(block * timestep)[:n]
        self._transition = self._transitions[k, timestep]

    def read(self, x: Array, qpos: Array) -> None:
        """Write the state (n,)."""
        x[:] = self._x

    def sense(self, y_m: Array) -> None:
        """Write the measurements; one that depends on the input at once takes it as at the operating point."""
        y_m[:] = self._system.measurement.y0 + self._system.measurement.C @ self._x

    def step(self, u: Array, y: Array, y_m: Array) -> None:
        """Hold the input u (p,) for one step; outputs and measurements are those at its start."""
        deviation = np.clip(u, self._low, self._high) - self._system.operating_point.u0
        self._write(deviation, y, y_m)
        self._x = self._transition @ np.concatenate([self._x, deviation])

    def read_outputs(self, y: Array, y_m: Array) -> None:
        """Write outputs and measurements at the present state."""
        self._write(np.zeros(self._system.n_channels), y, y_m)

    def _write(self, deviation: Array, y: Array, y_m: Array) -> None:
        system = self._system
        y[:] = system.operating_point.y0 + system.C @ self._x + system.D @ deviation
        y_m[:] = system.measurement.y0 + system.measurement.C @ self._x + system.measurement.D @ deviation

    @contextmanager
    def stages(self, law: Law) -> Iterator[LinearStageInput]:
        """A block in which the law is evaluated at every stage."""
        yield LinearStageInput(self, law)

    def failed(self) -> bool:
        """Whether the state is not finite."""
        return not bool(np.all(np.isfinite(self._x)))

    def runge_kutta(self, index: int, law: Law, y: Array, y_m: Array) -> Array:
        """One step of RK4 with the law evaluated at each stage; returns the input at mid-step."""
        system, h, x = self._system, self._timestep, self._x
        rates: list[Array] = []
        middle = np.zeros(system.n_channels)
        for stage, (instant, share) in enumerate(((0, 0.0), (1, 0.5), (1, 0.5), (2, 1.0))):
            state = x + share * h * rates[-1] if rates else x
            u = law.update(3 * index + instant, state)
            deviation = np.clip(u, self._low, self._high) - system.operating_point.u0
            if stage == 0:
                self._write(deviation, y, y_m)
            if stage == 1:
                middle = u
            rates.append(system.A @ state + system.B @ deviation)
        self._x = x + h / 6 * (rates[0] + 2 * rates[1] + 2 * rates[2] + rates[3])
        return middle


class LinearStageInput:
    """Steps of RK4 of a linear plant under one law."""

    def __init__(self, stepper: LinearStepper, law: Law) -> None:
        self._stepper, self._law = stepper, law

    def step(self, index: int, y: Array, y_m: Array) -> Array:
        """Take step number `index`; returns the input (p,) at its middle."""
        return self._stepper.runge_kutta(index, self._law, y, y_m)


def _units(names: Sequence[str], known: Mapping[str, str]) -> tuple[str, ...]:
    return tuple(known.get(name, "1") for name in names)
