"""MJCF files: where those that come with the project are, and how any of them becomes a MuJoCo model."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import mujoco

from invtrack.arrays import shown
from invtrack.errors import PlantError
from invtrack.plant.couplings import callbacks_suspended, require_known_elements
from invtrack.plant.elements import add_output_sensors, element_name, listed


def model_path(name: str) -> Path:
    """The path of the shipped model `models/<name>.xml`.

    An installed wheel carries the models inside the package; an editable checkout has them in `models/` beside it.

    Raises PlantError, with the available names, where there is no such model.
    """
    package = Path(__file__).resolve().parents[1]
    folders = [folder for folder in (package / "models", package.parent / "models") if folder.is_dir()]
    available = {path.stem: path for folder in reversed(folders) for path in folder.glob("*.xml")}
    if not isinstance(name, str) or name not in available:
        raise PlantError(
            f"no shipped model is named {shown(name)}; there are: {', '.join(sorted(available)) or 'none'}."
            " Give Plant.from_xml the path of your own MJCF file instead"
        )
    return available[name]


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
