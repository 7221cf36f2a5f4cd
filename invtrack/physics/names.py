"""Finding elements of a compiled model by name, and naming them in messages."""

from __future__ import annotations

from collections.abc import Iterable

import mujoco

from invtrack.errors import PlantError

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


def element_id(model: mujoco.MjModel, kind: str, name: str) -> int:
    """The index of the element of this kind ("body", "joint", ...) and name. Raises PlantError with the names there are."""
    index = int(mujoco.mj_name2id(model, OBJECTS[kind], name))
    if index < 0:
        raise PlantError(f"the model has no {kind} named {name!r}; there are: {listed(element_names(model, kind))}")
    return index


def element_name(model: mujoco.MjModel, kind: str, index: int) -> str:
    """The name of an element; where it has none, its kind and index ("joint 2")."""
    return str(mujoco.mj_id2name(model, OBJECTS[kind], index) or f"{kind} {index}")


def element_names(model: mujoco.MjModel, kind: str) -> list[str]:
    """The names of all elements of a kind, in the model's order."""
    names = (mujoco.mj_id2name(model, OBJECTS[kind], i) for i in range(getattr(model, _COUNTS[kind])))
    return [name for name in names if name]


def listed(names: Iterable[str]) -> str:
    """Names in one line of a message, "none" where there are none."""
    return ", ".join(names) or "none"
