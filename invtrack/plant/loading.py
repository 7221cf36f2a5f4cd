"""Where a mechanism comes from: an MJCF file or text, or what MuJoCo has made of one; and the files that come with the project."""

from __future__ import annotations

import copy
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np

from invtrack.arrays import shown
from invtrack.errors import PlantError
from invtrack.plant.couplings import require_known_elements
from invtrack.plant.elements import element_name, listed
from invtrack.plant.native.slots import python_callbacks_suspended

Source: TypeAlias = str | Path | mujoco.MjSpec | mujoco.MjModel
"""The path of an MJCF file, MJCF text, a specification, or a compiled model."""

DENSE = mujoco.mjtJacobian.mjJAC_DENSE
"""The constraint Jacobian of every model, whatever its file says. With a sparse one MuJoCo 4.0.0's Newton solver returns
accelerations that are off by their own size where dry friction meets equality constraints; with a dense one they are right."""

LONGEST_NAME = 256
"""Characters of a path that a message repeats."""

_EXPECTED = "the path of an MJCF file, MJCF text, a mujoco.MjSpec or a mujoco.MjModel"


@dataclass(frozen=True, eq=False)
class LoadedModel:
    """A compiled model and where it comes from.

    model: compiled. spec: what it was compiled from; None where only the compiled model was given. description: what messages call
    the source.
    """

    model: mujoco.MjModel
    spec: mujoco.MjSpec | None
    description: str


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


def load_model(source: Source) -> LoadedModel:
    """The model that a source describes, with a dense constraint Jacobian. What is given is copied, not kept.

    Raises PlantError for what does not compile, and for models whose state is more than (qpos, qvel, act).
    """
    if isinstance(source, mujoco.MjModel):
        loaded = LoadedModel(copy.copy(source), None, "the MjModel")
    else:
        spec, description = _specification(source)
        require_known_elements(spec)
        model = compile_spec(spec, description)
        spec.option.jacobian = DENSE
        _fix_what_the_compiler_chose(spec, model)
        loaded = LoadedModel(model, spec, description)
    _refuse_hidden_state(loaded.model)
    loaded.model.opt.jacobian = DENSE
    return loaded


def compile_spec(spec: mujoco.MjSpec, description: str) -> mujoco.MjModel:
    """The model that a specification describes."""
    try:
        with python_callbacks_suspended():
            return spec.compile()
    except ValueError as error:
        raise PlantError(f"{description} does not compile: {error}") from error


def model_name(model: mujoco.MjModel) -> str:
    """The name of a model in its file."""
    return bytes(model.names).partition(b"\0")[0].decode()


def _specification(source: Source) -> tuple[mujoco.MjSpec, str]:
    """A specification of its own, and what messages call it."""
    if isinstance(source, mujoco.MjSpec):
        return source.copy(), "the MjSpec"
    if isinstance(source, str) and source.lstrip().startswith("<"):
        try:
            return mujoco.MjSpec.from_string(source), "the MJCF text"
        except ValueError as error:
            raise PlantError(f"the MJCF text cannot be read: {error}") from error
    if not isinstance(source, (str, Path)) or not Path(source).name:
        raise PlantError(f"expected {_EXPECTED}, got {shown(source)}")
    if not _is_file(source):
        named = str(source) if len(str(source)) < LONGEST_NAME else shown(source)
        raise PlantError(
            f"there is no file {named}; give {_EXPECTED} (text begins with '<'), or invtrack.model_path(name) of a shipped model"
        )
    try:
        return mujoco.MjSpec.from_file(str(source)), str(source)
    except ValueError as error:
        raise PlantError(f"{source} cannot be read as MJCF: {error}") from error


def _is_file(path: str | Path) -> bool:
    try:
        return Path(path).is_file()
    except OSError:  # a name longer than file systems know, say
        return False


def _fix_what_the_compiler_chose(spec: mujoco.MjSpec, model: mujoco.MjModel) -> None:
    """Put into the specification what the compiler derived from other quantities, which later changes of those are to leave alone:
    rest lengths of tendons, dampings of servos from a damping ratio, length ranges of muscles, springs and dampers of joints from a
    time constant.
    """
    for tendon in spec.tendons:
        if tendon.springlength[0] < 0:
            tendon.springlength = model.tendon_lengthspring[tendon.id]
    for actuator in spec.actuators:
        if actuator.biastype == mujoco.mjtBias.mjBIAS_AFFINE and actuator.biasprm[2] > 0:
            actuator.biasprm[2] = model.actuator_biasprm[actuator.id, 2]
        if not np.any(actuator.lengthrange):
            actuator.lengthrange = model.actuator_lengthrange[actuator.id]
    for joint in spec.joints:
        if joint.springdamper[0] > 0 and joint.springdamper[1] > 0:
            joint.springdamper = (0.0, 0.0)
            joint.stiffness[0] = model.jnt_stiffness[joint.id]
            joint.damping[0] = model.dof_damping[model.jnt_dofadr[joint.id]]


def _refuse_hidden_state(model: mujoco.MjModel) -> None:
    """Refuse models whose state is more than (qpos, qvel, act), and models that measure nothing."""
    late = [element_name(model, "sensor", i) for i in range(model.nsensor) if model.sensor_historyadr[i] >= 0]
    if late:
        raise PlantError(
            f"sensors {listed(late)} have delays or history buffers, with which outputs would be those of an earlier time; take"
            " them out of the file, and state delays with the run:"
            ' invtrack.simulate(..., sensors={"NAME": invtrack.Sensor(delay=0.01)})'
        )
    plastic = getattr(model, "nplastic", 0)  # MuJoCo has plastic springs since 4.0
    if model.npluginstate or plastic:
        raise PlantError("plugins with state and plastic springs are no part of the state (qpos, qvel, act); remove them")
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_SENSOR:
        raise PlantError("the model disables sensors, so it has no outputs; remove <flag sensor='disable'/>")
