"""The physics side of the closed loop: a MuJoCo plant that steps."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.control.protocol import Law
from invtrack.errors import SimulationError
from invtrack.plant.actuator_delays import actuator_delays, fill_histories
from invtrack.plant.configuration import configuration_of
from invtrack.plant.couplings import mujoco_callbacks
from invtrack.plant.plant import Plant
from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.active_constraints import ActiveConstraints, ConstraintWatch
from invtrack.simulation.actuation import Actuation
from invtrack.simulation.live_readings import LiveReadings
from invtrack.simulation.planned_limits import limits_along
from invtrack.simulation.simulated_plant import SimulatedPlant

STAGES_OF_RK4 = (0, 1, 1, 2)
"""At which of a step's three instants (start, middle, end) each of the four stages evaluates the input."""

DELAY_ROUNDING = 1e-9
"""Share of an actuator's delay within which a control counts as old enough."""

FAILURES = tuple(getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}") for what in ("CTRL", "QPOS", "QVEL", "QACC"))
"""Warnings after which MuJoCo's state means nothing any more."""


def mujoco_plant(plant: Plant) -> SimulatedPlant:
    """What a MuJoCo plant is to the closed loop; each run has its own copy of the model."""
    return SimulatedPlant(
        name=plant.name,
        integrator=mujoco.mjtIntegrator(plant.model.opt.integrator).name.removeprefix("mjINT_"),
        states=plant.states,
        inputs=plant.inputs,
        outputs=plant.outputs,
        measurements=plant.measurements,
        operating_point=plant.operating_point,
        rest=np.zeros(plant.n_states),
        input_limits=plant.input_limits,
        stepper=partial(MujocoStepper, plant),
        beyond=partial(limits_along, plant),
        binary=partial(_binary, plant),
        parameters=plant.parameter_channels,
        parameter_values=plant.parameter_values,
        parameter_bodies=plant.parameter_bodies,
        delays=actuator_delays(plant.model),
    )


def _binary(plant: Plant, parameters: Mapping[str, float]) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.mjb"
        mujoco.mj_saveModel(plant.model_with(parameters), str(path))
        return path.read_bytes()


class MujocoStepper:
    """One run of a plant: its own copy of the model, and its data."""

    def __init__(self, plant: Plant, x: Array, parameters: Mapping[str, float]) -> None:
        self.plant = plant
        self.model = plant.model_with(parameters)
        # With automatic reset MuJoCo answers divergence by starting over from qpos0, as if nothing had happened.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # Which of two controls acts where a delay is a whole number of steps is not left to the rounding of times.
        self.model.actuator_delay *= 1 - DELAY_ROUNDING
        self.data = data = plant.new_data(self.model)
        self._x0 = plant.operating_point_in(self.model).x0
        data.qpos[:], data.qvel[:], data.act[:] = configuration_of(self.model, self._x0, plant.coordinates_of(x))
        self.state: tuple[Array, ...] = (data.qpos, data.qvel, data.act) if self.model.na else (data.qpos, data.qvel)
        outputs, measurements = (readings.readings for readings in (plant.output_readings, plant.measurement_readings))
        self._live = live = LiveReadings(self.model, data, [*outputs, *measurements])
        self.sensors: Array = live.values
        self.output_columns, self.measurement_columns = np.split(live.columns, [len(outputs)])
        self._entered = False
        self._forward = self._with_forces(mujoco.mj_forward)
        self.control, self.advance = self._control_and_step(plant.input_addresses)
        self._watch = ConstraintWatch(ActiveConstraints(self.model), data)
        self.advance = self._watch.around(self.advance)
        self._actuation = Actuation(plant, self.model)
        self._kept = slice(None) if not plant.dropped else plant.state_addresses
        self.raw_is_deviation = self.model.nq == self.model.nv and not np.any(self._x0) and not plant.dropped

    def _control_and_step(self, inputs: Indices) -> tuple[Array, Callable[[], None]]:
        """Where the input is written, and the function that takes a step."""
        ctrl, step = self.data.ctrl, self._live.around(self._with_forces(mujoco.mj_step))
        if np.array_equal(inputs, np.arange(inputs[0], inputs[0] + len(inputs))):
            return ctrl[inputs[0] : inputs[-1] + 1], step
        scattered = np.array(ctrl[inputs])

        def scatter_and_step() -> None:
            ctrl[inputs] = scattered
            step()

        return scattered, scatter_and_step

    def _with_forces(self, function: Callable[[mujoco.MjModel, mujoco.MjData], None]) -> Callable[[], None]:
        """A call of one of MuJoCo's functions, with the plant's couplings in force as long as it runs."""
        plain = partial(function, self.model, self.data)
        if not self.plant.couplings:
            return plain

        def coupled() -> None:
            with self.plant.forces(self.model):
                plain()

        return coupled

    def enter(self, timestep: float, time: float, parameters: Mapping[str, float]) -> None:
        """Start an interval: length of its steps [s], its time [s], and parameters that change now."""
        self.model.opt.timestep = timestep
        self.data.time = time
        if not self._entered:
            fill_histories(self.model, self.data, time)
            self._entered = True
        if parameters:
            self.plant.apply(self.model, parameters)
            self._actuation = Actuation(self.plant, self.model)

    def refresh(self) -> None:
        """Bring `sensors` up to the present state: after mj_step they are one step old."""
        self._forward()
        self._live.read()

    def deviations(self, raw: Array) -> Array:
        """States (k, n), as deviations from the operating point, of raw states (k, nq + nv + na)."""
        nq, nv = self.model.nq, self.model.nv
        if nq == nv:
            return np.asarray((raw - self._x0)[:, self._kept])
        result = np.empty((len(raw), 2 * nv + self.model.na))
        for row, out in zip(raw, result, strict=True):
            mujoco.mj_differentiatePos(self.model, out[:nv], 1.0, self._x0[:nq], row[:nq])
        result[:, nv:] = raw[:, nq:] - self._x0[nq:]
        return np.asarray(result[:, self._kept])

    def positions(self, raw: Array) -> Array:
        """qpos (k, nq) of raw states (k, nq + nv + na)."""
        return raw[:, : self.model.nq]

    def passed_on(self, raw: Array, u: Array) -> tuple[Array, Array]:
        """What the actuators make of inputs; see `invtrack.simulation.actuation`."""
        return self._actuation.passed_on(raw, u, after=np.vstack([raw[1:], np.concatenate(self.state)]))

    @property
    def limits(self) -> Sequence[ActingLimit]:
        """Those of the actuators."""
        return self._actuation.limits

    def constrained(self) -> Mapping[ActingLimit, Stretches]:
        """When ranges of joints and tendons, and contacts, acted."""
        return self._watch.stretches()

    @contextmanager
    def stages(self, law: Law) -> Iterator[RungeKuttaInput]:
        """A block in which the law is evaluated at every stage of RK4. Raises SimulationError for other integrators."""
        if self.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            raise SimulationError(
                'evaluate="stages" evaluates the input at the stages of RK4, the model uses another integrator; set '
                '<option integrator="RK4"/> or use evaluate="held"'
            )
        stage_input = RungeKuttaInput(self, law)
        with mujoco_callbacks(self.model, control=stage_input.control):
            yield stage_input

    def failed(self) -> bool:
        """Whether MuJoCo has warned of a state or input that is not finite or beyond what it integrates."""
        return any(self.data.warning[warning].number for warning in FAILURES)


class RungeKuttaInput:
    """Writes the control of each stage of a step, from inside MuJoCo's control callback."""

    def __init__(self, stepper: MujocoStepper, law: Law) -> None:
        self._law, self._stepper = law, stepper
        self._inputs = stepper.plant.input_addresses
        self._index, self._stage = 0, len(STAGES_OF_RK4)
        self._middle = np.zeros(len(self._inputs))

    def step(self, index: int) -> Array:
        """Take step number `index`; returns the input (p,) at its middle."""
        self._index, self._stage = index, 0
        self._stepper.advance()
        return self._middle

    def control(self, _model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """MuJoCo's control callback: one call in each stage."""
        if self._stage >= len(STAGES_OF_RK4):
            return  # an evaluation outside a step keeps the last input
        x = np.concatenate(self._stepper.state)
        if not self._stepper.raw_is_deviation:
            x = self._stepper.deviations(x[np.newaxis])[0]
        u = self._law.update(3 * self._index + STAGES_OF_RK4[self._stage], x)
        data.ctrl[self._inputs] = u
        if self._stage == 1:
            self._middle = u
        self._stage += 1
