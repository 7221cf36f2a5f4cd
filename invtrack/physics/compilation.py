"""From an MJCF file to a compiled model, with MuJoCo's complaints as readable errors."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import mujoco

from invtrack.errors import PlantError
from invtrack.physics.callbacks import callbacks_suspended
from invtrack.physics.channels import add_output_sensors
from invtrack.physics.coupling import require_known_elements
from invtrack.physics.names import element_name, listed


def load_model(path: Path, *, sensors: Iterable[Sequence[str]]) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    """The specification in an MJCF file, with the sensors that these lists of outputs stand for, and the model that it describes.

    Raises PlantError for what does not compile, and for models whose state is more than (qpos, qvel, act).
    """
    spec = _load_spec(path)
    for outputs in sensors:
        add_output_sensors(spec, outputs)
    require_known_elements(spec)
    model = compile_spec(spec, str(path))
    _refuse_hidden_state(model)
    return spec, model


def _load_spec(path: Path) -> mujoco.MjSpec:
    """The specification in an MJCF file."""
    if not path.is_file():
        raise PlantError(f"there is no file {path}; give the path of an MJCF file, or invtrack.model_path(name) of a shipped model")
    try:
        return mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise PlantError(f"{path} is not valid MJCF: {error}") from error


def compile_spec(spec: mujoco.MjSpec, description: str) -> mujoco.MjModel:
    """The model that a specification describes."""
    try:
        with callbacks_suspended():
            return spec.compile()
    except ValueError as error:
        raise PlantError(f"{description} does not compile: {error}") from error


def _refuse_hidden_state(model: mujoco.MjModel) -> None:
    """Refuse models whose state is more than (qpos, qvel, act), and models that measure nothing."""
    histories = [element_name(model, "actuator", i) for i in range(model.nactuator) if model.actuator_historyadr[i] >= 0]
    histories += [element_name(model, "sensor", i) for i in range(model.nsensor) if model.sensor_historyadr[i] >= 0]
    if histories:
        raise PlantError(f"{listed(histories)}: delays and history buffers are no part of the state (qpos, qvel, act); remove them")
    plastic = getattr(model, "nplastic", 0)  # MuJoCo has plastic springs since 4.0
    if model.npluginstate or plastic:
        raise PlantError("plugins with state and plastic springs are no part of the state (qpos, qvel, act); remove them")
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR:
        raise PlantError("the model disables sensors, so it has no outputs; remove <flag sensor='disable'/>")
