"""A MuJoCo plant that steps: the physics side of the closed loop."""

from __future__ import annotations

from collections.abc import Mapping
from types import TracebackType

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Law
from invtrack.errors import SimulationError
from invtrack.physics.callbacks import mujoco_callbacks
from invtrack.physics.coordinates import configuration_of, split
from invtrack.physics.plant import Plant

Array = NDArray[np.float64]

STAGES_OF_RK4 = (0, 1, 1, 2)
"""At which of a step's three instants (start, middle, end) each of the four stages evaluates the input."""

FAILURES = tuple(getattr(mujoco.mjtWarning, f"mjWARN_BAD{what}") for what in ("CTRL", "QPOS", "QVEL", "QACC"))
"""Warnings after which MuJoCo's state means nothing any more."""


class MujocoStepper:
    """One run of a plant: its own copy of the model, its data, and the state read from them."""

    def __init__(self, plant: Plant, x: Array, parameters: Mapping[str, float]) -> None:
        self.plant = plant
        self.model = plant.model_with(parameters)
        # With automatic reset MuJoCo answers divergence by starting over from qpos0, as if nothing had happened.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        self.data = plant.new_data(self.model)
        x0 = plant.operating_point_in(self.model).x0
        self.data.qpos[:], self.data.qvel[:], self.data.act[:] = configuration_of(self.model, x0, x)
        self._qpos0, self._qvel0, self._act0 = split(self.model, x0)
        self._quaternions = self.model.nq != self.model.nv
        self._inputs, self._outputs = plant.input_addresses, plant.output_addresses
        self._nv = self.model.nv

    def enter(self, timestep: float, time: float, parameters: Mapping[str, float]) -> None:
        """Start an interval: length of its steps [s], its time [s], and parameters that change now (empty: none)."""
        self.model.opt.timestep = timestep
        self.data.time = time
        if parameters:
            self.plant.apply(self.model, parameters)

    def read(self, x: Array, qpos: Array) -> None:
        """Write the state (n,), as deviation from the operating point, and qpos (nq,) into the arrays given."""
        data, nv = self.data, self._nv
        qpos[:] = data.qpos
        if self._quaternions:
            mujoco.mj_differentiatePos(self.model, x[:nv], 1.0, self._qpos0, data.qpos)
        else:
            np.subtract(qpos, self._qpos0, out=x[:nv])
        np.subtract(data.qvel, self._qvel0, out=x[nv : 2 * nv])
        if len(x) > 2 * nv:
            np.subtract(data.act, self._act0, out=x[2 * nv :])

    def step(self, u: Array, y: Array) -> None:
        """Hold the input u (p,) for one step; y (p,) receives the outputs at the step's start, where MuJoCo computes sensors."""
        self.data.ctrl[self._inputs] = u
        mujoco.mj_step(self.model, self.data)
        y[:] = self.data.sensordata[self._outputs]

    def read_outputs(self, y: Array) -> None:
        """Write the outputs (p,) at the present state."""
        mujoco.mj_forward(self.model, self.data)
        y[:] = self.data.sensordata[self._outputs]

    def applied(self, u: Array) -> Array:
        """What the actuators make of commanded inputs (m, p): clamped to ctrlrange where it is limited."""
        limited = self.model.actuator_ctrllimited[self._inputs].astype(bool)
        if self.model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL:
            limited[:] = False
        low, high = self.model.actuator_ctrlrange[self._inputs].T
        return np.clip(u, np.where(limited, low, -np.inf), np.where(limited, high, np.inf))

    def failed(self) -> bool:
        """Whether MuJoCo has warned of a state or input that is not finite or beyond what it integrates."""
        return any(self.data.warning[warning].number for warning in FAILURES)


class ContinuousInput:
    """Evaluates a law at every stage of RK4 instead of holding it over the step; use as a context manager around the run.

    Raises SimulationError for other integrators, which evaluate the input once per step.
    """

    def __init__(self, stepper: MujocoStepper, law: Law) -> None:
        if stepper.model.opt.integrator != mujoco.mjtIntegrator.mjINT_RK4:
            raise SimulationError(
                'hold="continuous" evaluates the input at the stages of RK4, the model uses another integrator; set '
                '<option integrator="RK4"/> or use hold="midpoint"'
            )
        self._law, self._stepper = law, stepper
        n = stepper.plant.n_states
        self._x, self._qpos = np.zeros(n), np.zeros(stepper.model.nq)
        self._inputs = stepper.plant.input_addresses
        self._instant, self._stage = 0, len(STAGES_OF_RK4)
        self.middle = np.zeros(len(self._inputs))
        self._callbacks = mujoco_callbacks(stepper.model, control=self._control)

    def __enter__(self) -> ContinuousInput:
        self._callbacks.__enter__()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._callbacks.__exit__(kind, error, trace)

    def before_step(self, index: int) -> None:
        """Tell which step is about to be taken."""
        self._instant, self._stage = 3 * index, 0

    def _control(self, _model: mujoco.MjModel, data: mujoco.MjData) -> None:
        if self._stage >= len(STAGES_OF_RK4):
            return  # an evaluation outside a step keeps the last input
        self._stepper.read(self._x, self._qpos)
        u = self._law.update(self._instant + STAGES_OF_RK4[self._stage], self._x)
        data.ctrl[self._inputs] = u
        if self._stage == 1:
            self.middle = u
        self._stage += 1
