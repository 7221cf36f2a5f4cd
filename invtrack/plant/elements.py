"""Finding elements of a compiled model by name, naming them in messages, and the channels of controls and states."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence

import mujoco
import numpy as np

from invtrack.arrays import Indices, shown
from invtrack.channels import Channels
from invtrack.errors import PlantError
from invtrack.plant.units import activation_unit, control_unit, joint_unit

Addresses = Indices

OBJECTS = {
    "body": mujoco.mjtObj.mjOBJ_BODY,
    "joint": mujoco.mjtObj.mjOBJ_JOINT,
    "geom": mujoco.mjtObj.mjOBJ_GEOM,
    "site": mujoco.mjtObj.mjOBJ_SITE,
    "tendon": mujoco.mjtObj.mjOBJ_TENDON,
    "actuator": mujoco.mjtObj.mjOBJ_ACTUATOR,
    "sensor": mujoco.mjtObj.mjOBJ_SENSOR,
    "equality": mujoco.mjtObj.mjOBJ_EQUALITY,
    "keyframe": mujoco.mjtObj.mjOBJ_KEY,
}
_COUNTS = {
    "body": "nbody",
    "joint": "njnt",
    "geom": "ngeom",
    "site": "nsite",
    "tendon": "ntendon",
    "actuator": "nactuator",
    "sensor": "nsensor",
    "equality": "neq",
    "keyframe": "nkey",
}

_COMPONENT = re.compile(r"(?P<name>.+)\[(?P<index>\d+)\]")

AXES = ("x", "y", "z")


def find_element(model: mujoco.MjModel, kind: str, name: str) -> int | None:
    """The index of the element of this kind ("body", "joint", ...) that `element_name` calls so; None where there is none."""
    index = int(mujoco.mj_name2id(model, OBJECTS[kind], name))
    if index >= 0:
        return index
    _, _, number = name.partition(f"{kind} ")
    if not (number.isascii() and number.isdigit()):
        return None
    index = int(number)
    return index if index < getattr(model, _COUNTS[kind]) and element_name(model, kind, index) == name else None


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """The index of the element of this kind and name. Raises PlantError with the names there are."""
    index = find_element(model, kind, name)
    if index is None:
        raise PlantError(f"the model has no {kind} named {name!r}; there are: {listed(element_names(model, kind))}")
    return index


def element_name(model: mujoco.MjModel, kind: str, index: int) -> str:
    """The name of an element; where the file gives it none, its kind and index ("joint 2")."""
    return str(mujoco.mj_id2name(model, OBJECTS[kind], index) or f"{kind} {index}")


def element_names(model: mujoco.MjModel, kind: str) -> list[str]:
    """What all elements of a kind are called, in the model's order."""
    return [element_name(model, kind, index) for index in range(getattr(model, _COUNTS[kind]))]


def listed(names: Iterable[str]) -> str:
    """Names in one line of a message, "none" where there are none."""
    return ", ".join(names) or "none"


def split_component(name: str, known: Container[str]) -> tuple[str, int | None]:
    """("NAME", 1) of "NAME[1]" where NAME is known and the whole is not; None for the component of anything else."""
    match = _COMPONENT.fullmatch(name)
    if name not in known and match and match["name"] in known:
        return match["name"], int(match["index"])
    return name, None


def checked_component(kind: str, name: str, component: int | None, size: int) -> int:
    """The component, 0 where an element of one component names none. Raises PlantError for one that is missing or too large."""
    if component is None and size != 1:
        raise PlantError(f"{kind} {name!r} has {size} components; choose one, for instance {f'{name}[0]'!r}")
    if component is not None and component >= size:
        raise PlantError(f"{name!r} is beyond the {size} component(s) of its {kind}; they count from [0] to [{size - 1}]")
    return component or 0


def require_distinct(kind: str, names: Sequence[str]) -> None:
    """Raises PlantError unless these are names, at least one and each once."""
    if isinstance(names, str) or not names or len(set(names)) != len(names):
        raise PlantError(f'expected a list of distinct {kind} names such as ["name"], got {shown(names)}')


def input_channels(model: mujoco.MjModel, names: Sequence[str]) -> tuple[Channels, Addresses]:
    """The controls of the named actuators ("NAME", or "NAME[1]" of an actuator with several), and where they stand in data.ctrl."""
    require_distinct("input", names)
    actuators = set(element_names(model, "actuator"))
    units, addresses = zip(*(_control(model, name, actuators) for name in names), strict=True)
    return Channels(names, units), np.array(addresses, dtype=np.intp)


def _control(model: mujoco.MjModel, name: str, actuators: Container[str]) -> tuple[str, int]:
    """Unit and address of a control."""
    actuator_name, component = split_component(name, actuators)
    actuator = element_id(model, "actuator", actuator_name)
    component = checked_component("actuator", name, component, int(model.actuator_ctrlnum[actuator]))
    return control_unit(model, actuator), int(model.actuator_ctrladr[actuator]) + component


def coordinate_channels(model: mujoco.MjModel) -> Channels:
    """All 2 nv + na: tangent coordinates of joints ("NAME"), their velocities ("NAME velocity"), activations ("NAME activation").

    Free and ball joints have several coordinates: "NAME.x", "NAME.y", "NAME.z" [m] and "NAME.rx", "NAME.ry", "NAME.rz" [rad].
    """
    positions = [named for joint in range(model.njnt) for named in _joint_coordinates(model, joint)]
    velocities = [(f"{name} velocity", f"{unit}/s") for name, unit in positions]
    activations = []
    for actuator in range(model.nactuator):
        name, count = element_name(model, "actuator", actuator), int(model.actuator_actnum[actuator])
        suffixes = [""] if count == 1 else [f"[{i}]" for i in range(count)]
        activations += [(f"{name} activation{suffix}", activation_unit(model, actuator)) for suffix in suffixes]
    named = [*positions, *velocities, *activations]
    return Channels([name for name, _ in named], [unit for _, unit in named])


def joint_components(model: mujoco.MjModel, joint: int) -> tuple[str, ...]:
    """What the degrees of freedom of a free or ball joint are called; none for a slide or hinge, which has one."""
    rotation = tuple(f"r{axis}" for axis in AXES)
    kind = model.jnt_type[joint]
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        return rotation
    return (*AXES, *rotation) if kind == mujoco.mjtJoint.mjJNT_FREE else ()


def scalar_joints(model: mujoco.MjModel, what: str, names: Sequence[str]) -> tuple[str, ...]:
    """The names, each once, if they are those of slide and hinge joints; raises PlantError for others. what: messages call them."""
    if isinstance(names, str):
        raise PlantError(f'expected a list of joints for {what} such as ["name"], got {shown(names)}')
    scalar = [name for i, name in enumerate(element_names(model, "joint")) if not joint_components(model, i)]
    for name in names:
        if name not in scalar:
            raise PlantError(f"{what} names {name!r}, which is no slide or hinge joint of the model; those are: {listed(scalar)}")
    return tuple(dict.fromkeys(names))


def _joint_coordinates(model: mujoco.MjModel, joint: int) -> list[tuple[str, str]]:
    name, components = element_name(model, "joint", joint), joint_components(model, joint)
    if not components:
        return [(name, joint_unit(model, joint))]
    return [(f"{name}.{component}", "m" if component in AXES else "rad") for component in components]


def dropped_states(coordinates: Channels, names: Sequence[str], *, play: Sequence[str]) -> tuple[str, ...]:
    """The names to drop and those of play, in the order of the coordinates.

    Raises PlantError for unknown names, or where none would be left.
    """
    if isinstance(names, str):
        raise PlantError(f'expected a list of states to drop such as ["name"], got {shown(names)}')
    known = coordinates.names
    unknown = [name for name in names if name not in known]
    if unknown:
        raise PlantError(f"there is no state {listed(map(repr, unknown))} to drop; the states are: {listed(known)}")
    dropped = {*names, *play}
    if dropped == set(known):
        raise PlantError(f"all states are dropped: {listed(known)}; keep those that the outputs depend on")
    return tuple(name for name in known if name in dropped)
