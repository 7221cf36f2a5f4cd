"""The physics side of the closed loop: a MuJoCo plant that steps."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.errors import SimulationError
from invtrack.plans.plan import Difference
from invtrack.plant.actuator_delays import actuator_delays, fill_histories
from invtrack.plant.configuration import configuration_of
from invtrack.plant.dynamics import PlantMechanism
from invtrack.plant.native.layout import data_count, data_time, model_timestep
from invtrack.plant.native.libmujoco import address_of
from invtrack.plant.plant import Plant
from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.active_constraints import ActiveConstraints, ConstraintWatch
from invtrack.simulation.actuation import Actuation
from invtrack.simulation.grid import Grid
from invtrack.simulation.native.law import Calls
from invtrack.simulation.native.record import STAGES, RunMemory
from invtrack.simulation.planned_limits import limits_along
from invtrack.simulation.simulated_plant import SimulatedPlant

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
    model = plant.model_with(parameters)
    content = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


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
        self._x0 = plant.configuration.x0
        data.qpos[:], data.qvel[:], data.act[:] = configuration_of(self.model, self._x0, plant.coordinates_of(x))
        self._readings = [*plant.output_readings.readings, *plant.measurement_readings.readings]
        self.output_columns, self.measurement_columns = np.split(np.arange(len(self._readings)), [len(plant.outputs)])
        constraints = ActiveConstraints(self.model)
        self._watch = ConstraintWatch(constraints, data) if constraints.possible else None
        self._actuation = Actuation(plant, self.model)
        self._kept = slice(None) if not plant.dropped else plant.state_addresses
        self._raw_is_deviation = self.model.nq == self.model.nv and not np.any(self._x0) and not plant.dropped

    @property
    def width(self) -> int:
        """Length of a raw state: nq + nv + na."""
        return len(self._x0)

    @property
    def n_values(self) -> int:
        """Number of outputs and measurements together."""
        return len(self._readings)

    def bind(self, memory: RunMemory, calls: Calls, grid: Grid) -> None:
        """Put the plant into the record of a run."""
        from invtrack.plant.native.readings import readings_of  # loads numba, for which nothing waits before a run

        model, data, plant = self.model, self.data, self.plant
        stages = [reading.stage for reading in self._readings]
        early, late = ([i for i, stage in enumerate(stages) if (stage == "sensor") is side] for side in (False, True))
        places, tendons = bool({"position", "tendon"} & set(stages)), "tendon" in stages
        memory.put(
            model=model._address,
            data=data._address,
            step=address_of("mj_step"),
            forward=address_of("mj_forward"),
            kinematics=address_of("mj_kinematics") if places else 0,
            tendon=address_of("mj_tendon") if tendons else 0,
            differentiate=address_of("mj_differentiatePos") if model.nq != model.nv else 0,
            integrate=address_of("mj_integratePos") if model.nq != model.nv else 0,
            timestep=model._address + model_timestep(),
            time=data._address + data_time(),
            **{name: int(getattr(model, name)) for name in ("nq", "nv", "na")},
            **{name: getattr(data, name) for name in ("qpos", "qvel", "act", "ctrl")},
            coordinates=np.zeros(2 * model.nv + model.na),
            placed=np.zeros(model.nq),
            values=np.zeros(self.n_values),
        )
        memory.copy(inputs=plant.input_addresses, x0=self._x0, kept=plant.state_addresses)
        for name, which in (("early", early), ("late", late)):
            table, referred = readings_of(data, [self._readings[i] for i in which], which)
            memory.put(**{name: table})
            memory.put(**{f"n_{name}": len(table)})
            memory.keep(**{f"{name}_references": referred})
        if self._watch is not None:
            watch = self._watch

            def note(step: int) -> None:
                watch.note(step)
                memory.put(watching=int(watch.acting))

            contacts, limits = (data._address + data_count(name) for name in ("ncon", "nl"))
            memory.put(note=calls.address_of("note", note), contacts=contacts, limits=limits)

    @contextmanager
    def running(self, memory: RunMemory, *, at_stages: bool) -> Iterator[None]:
        """A block in which steps may be taken: with the plant's couplings, and where asked for with the law at every stage of RK4.

        Raises SimulationError for stages of other integrators.
        """
        if at_stages and self.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            raise SimulationError(
                'evaluate="stages" evaluates the input at the stages of RK4, the model uses another integrator; set '
                '<option integrator="RK4"/> or use evaluate="held"'
            )
        from invtrack.plant.native.controls import controls
        from invtrack.simulation.native.loop import control_at_stage

        memory.put(stage=STAGES)
        with self.plant.forces(self.model):
            if not at_stages:
                yield
                return
            with controls(self.data, control_at_stage.address, int(memory.record.ctypes.data)):
                yield

    def begin(self, timestep: float, time: float) -> None:
        """Start the run at a time [s], with steps of a length [s]."""
        self.model.opt.timestep, self.data.time = timestep, time
        fill_histories(self.model, self.data, time)

    def change(self, parameters: Mapping[str, float]) -> None:
        """Give parameters new values."""
        self.plant.apply(self.model, parameters)
        self._actuation = Actuation(self.plant, self.model)

    def deviations(self, raw: Array) -> Array:
        """States (k, n), as deviations from the operating point, of raw states (k, nq + nv + na)."""
        if self._raw_is_deviation:
            return raw
        nq, nv = self.model.nq, self.model.nv
        if nq == nv:
            return np.asarray((raw - self._x0)[:, self._kept])
        from invtrack.simulation.native.loop import differences

        displacement = np.empty((len(raw), nv))
        # Copies: writable arrays that lie in one piece are the one kind that is compiled for.
        x0, rows = self._x0.copy(), np.ascontiguousarray(raw)
        differences(address_of("mj_differentiatePos"), self.model._address, x0, rows, displacement)
        return np.hstack([displacement, raw[:, nq:] - self._x0[nq:]])[:, self._kept]

    def origins(self, x: Array, difference: Difference) -> Array | None:
        """(qpos, qvel, act) of states x (k, n), for the difference of this mechanism or of one with the same coordinates."""
        owner = getattr(difference, "__self__", None)
        if not isinstance(owner, PlantMechanism) or difference != owner.state_difference:
            return None
        other, plant = owner.plant, self.plant
        same = (
            np.array_equal(other.model.jnt_type, self.model.jnt_type)
            and np.array_equal(other.configuration.x0, self._x0)
            and np.array_equal(other.state_addresses, plant.state_addresses)
        )
        if not same or self.model.nq == self.model.nv:
            return None
        nq, nv = self.model.nq, self.model.nv
        coordinates = np.zeros((len(x), len(plant.coordinates)))
        coordinates[:, plant.state_addresses] = x
        result = np.tile(self._x0, (len(x), 1))
        result[:, nq:] += coordinates[:, nv:]
        for qpos, displacement in zip(result[:, :nq], coordinates[:, :nv], strict=True):
            mujoco.mj_integratePos(self.model, qpos, displacement, 1.0)
        return result

    def positions(self, raw: Array) -> Array:
        """qpos (k, nq) of raw states (k, nq + nv + na)."""
        return raw[:, : self.model.nq]

    def passed_on(self, raw: Array, u: Array) -> tuple[Array, Array]:
        """What the actuators make of inputs; see `invtrack.simulation.actuation`."""
        return self._actuation.passed_on(raw[:-1], u, after=raw[1:])

    @property
    def limits(self) -> Sequence[ActingLimit]:
        """Those of the actuators."""
        return self._actuation.limits

    def constrained(self, steps: int) -> Mapping[ActingLimit, Stretches]:
        """When ranges of joints and tendons, and contacts, acted in so many steps."""
        return {} if self._watch is None else self._watch.stretches(steps)

    def failed(self) -> bool:
        """Whether MuJoCo has warned of a state or input that is not finite or beyond what it integrates."""
        return any(self.data.warning[warning].number for warning in FAILURES)
