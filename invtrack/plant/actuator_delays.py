"""Delays of actuators: which there are, and the buffers of past controls in which MuJoCo keeps them."""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np

from invtrack.plant.elements import element_name


@dataclass(frozen=True)
class ActuatorDelay:
    """How late an actuator acts.

    actuator: its name. delay: by which it acts later than it is told to [s]. samples: how many past controls MuJoCo keeps for it,
    one for each step.
    """

    actuator: str
    delay: float
    samples: int


def actuator_delays(model: mujoco.MjModel) -> tuple[ActuatorDelay, ...]:
    """The delays of a model's actuators."""
    return tuple(
        ActuatorDelay(element_name(model, "actuator", i), float(model.actuator_delay[i]), int(model.actuator_history[i, 0]))
        for i in np.flatnonzero(model.actuator_delay > 0).tolist()
    )


def fill_histories(model: mujoco.MjModel, data: mujoco.MjData, time: float) -> None:
    """Fill the buffers as if the controls in `data` had been held until `time` [s]; without buffers nothing happens."""
    for i in np.flatnonzero(model.actuator_historyadr >= 0).tolist():
        first, count = int(model.actuator_ctrladr[i]), int(model.actuator_ctrlnum[i])
        samples = int(model.actuator_history[i, 0])
        times = time - model.opt.timestep * np.arange(samples, 0, -1.0)
        mujoco.mj_initCtrlHistory(model, data, i, times, np.tile(data.ctrl[first : first + count], (samples, 1)))
