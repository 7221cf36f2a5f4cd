"""Finding elements of a compiled model by name, and naming them in messages."""

from __future__ import annotations

import re
from collections.abc import Container, Iterable, Sequence

import mujoco
import numpy as np

from invtrack.arrays import Array, Indices, shown
from invtrack.channels import Channels
from invtrack.errors import PlantError
from invtrack.plant.units import control_unit, joint_unit, sensor_unit

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

_FORMS = '"SENSOR", "SENSOR[1]", "joint:NAME", "joint:NAME:velocity", "site:NAME:x" (or y, z)'

_AXES = ("x", "y", "z")


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


def input_channels(model: mujoco.MjModel, names: Sequence[str]) -> tuple[Channels, Addresses]:
    """The controls of the named actuators ("NAME", or "NAME[1]" of an actuator with several), and where they stand in data.ctrl."""
    _require_distinct("input", names)
    actuators = set(element_names(model, "actuator"))
    units, addresses = zip(*(_control(model, name, actuators) for name in names), strict=True)
    return Channels(names, units), np.array(addresses, dtype=np.intp)


def _control(model: mujoco.MjModel, name: str, actuators: Container[str]) -> tuple[str, int]:
    """Unit and address of a control."""
    actuator_name, component = _component(name, actuators)
    actuator = element_id(model, "actuator", actuator_name)
    component = _checked_component("actuator", name, component, int(model.actuator_ctrlnum[actuator]))
    return control_unit(model, actuator), int(model.actuator_ctrladr[actuator]) + component


def control_limits(model: mujoco.MjModel, addresses: Addresses) -> Array:
    """Lowest and highest value (p, 2) that the actuators pass on of the controls at these addresses; infinite where unlimited."""
    limited = model.actuator_ctrllimited[addresses].astype(bool)
    if model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_CLAMPCTRL:
        limited[:] = False
    return np.where(limited[:, None], model.actuator_ctrlrange[addresses], np.array([-np.inf, np.inf]))


def add_output_sensors(spec: mujoco.MjSpec, outputs: Sequence[str]) -> None:
    """Add to the specification the sensors that output expressions ("joint:NAME", "site:NAME:z") stand for.

    Raises PlantError for an output that is neither a sensor nor such an expression, with the names there are.
    """
    _require_distinct("output", outputs)
    sensors = {sensor.name for sensor in spec.sensors}
    for output in outputs:
        sensor, _ = _sensor_of(output, sensors)
        if sensor in sensors:
            continue
        kind, _, target = sensor.partition(":")
        if kind == "joint":
            _add_joint_sensor(spec, output, target)
        else:
            _require_known("site", target, (site.name for site in spec.sites))
            spec.add_sensor(name=sensor, type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=target)
        sensors.add(sensor)


def output_channels(model: mujoco.MjModel, outputs: Sequence[str]) -> tuple[Channels, Addresses]:
    """What the outputs name, and where it stands in data.sensordata, in a model compiled after `add_output_sensors`."""
    sensors = set(element_names(model, "sensor"))
    units, addresses = zip(*(_sensor_value(model, output, sensors) for output in outputs), strict=True)
    return Channels(outputs, units), np.array(addresses, dtype=np.intp)


def _sensor_value(model: mujoco.MjModel, output: str, sensors: Container[str]) -> tuple[str, int]:
    """Unit and address of what an output names."""
    sensor_name, component = _sensor_of(output, sensors)
    sensor = element_id(model, "sensor", sensor_name)
    if model.sensor_type[sensor] == mujoco.mjtSensor.mjSENS_USER:
        raise PlantError(f"output {output!r} is a user sensor, which no model computes; choose a sensor that MuJoCo evaluates")
    if model.sensor_interval[sensor, 0] > 0:
        raise PlantError(f"output {output!r} is sampled at intervals, so it is no function of the state; remove the interval")
    component = _checked_component("sensor", output, component, int(model.sensor_dim[sensor]))
    return sensor_unit(model, sensor), int(model.sensor_adr[sensor]) + component


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
        activations += [(f"{name} activation{suffix}", "1") for suffix in suffixes]
    named = [*positions, *velocities, *activations]
    return Channels([name for name, _ in named], [unit for _, unit in named])


def dropped_states(coordinates: Channels, names: Sequence[str]) -> tuple[str, ...]:
    """The names to drop, in the order of the coordinates. Raises PlantError for unknown names, or where none would be left."""
    if isinstance(names, str):
        raise PlantError(f'expected a list of states to drop such as ["name"], got {shown(names)}')
    known = coordinates.names
    unknown = [name for name in names if name not in known]
    if unknown:
        raise PlantError(f"there is no state {listed(map(repr, unknown))} to drop; the states are: {listed(known)}")
    if set(names) == set(known):
        raise PlantError(f"all states are dropped: {listed(known)}; keep those that the outputs depend on")
    return tuple(name for name in known if name in names)


def _joint_coordinates(model: mujoco.MjModel, joint: int) -> list[tuple[str, str]]:
    name = element_name(model, "joint", joint)
    rotation = [(f"{name}.r{axis}", "rad") for axis in _AXES]
    kind = model.jnt_type[joint]
    if kind == mujoco.mjtJoint.mjJNT_BALL:
        return rotation
    if kind == mujoco.mjtJoint.mjJNT_FREE:
        return [(f"{name}.{axis}", "m") for axis in _AXES] + rotation
    return [(name, joint_unit(model, joint))]


def _sensor_of(output: str, sensors: Container[str]) -> tuple[str, int | None]:
    """The sensor's name and the component that an output stands for; None where the output names no component."""
    name, component = _component(output, sensors)
    if name in sensors:
        return name, component
    kind, _, rest = output.partition(":")
    if kind == "joint" and rest:
        return output, 0
    if kind == "site" and rest.rpartition(":")[2] in _AXES:
        return output.rpartition(":")[0], _AXES.index(output[-1])
    known = listed(sorted(sensors)) if isinstance(sensors, set) else "none"
    raise PlantError(f"no sensor is named {output!r}; there are: {known}. An output is one of {_FORMS}")


def _component(name: str, known: Container[str]) -> tuple[str, int | None]:
    match = _COMPONENT.fullmatch(name)
    if name not in known and match and match["name"] in known:
        return match["name"], int(match["index"])
    return name, None


def _checked_component(kind: str, name: str, component: int | None, size: int) -> int:
    if component is None and size != 1:
        raise PlantError(f"{kind} {name!r} has {size} components; choose one, for instance {f'{name}[0]'!r}")
    if component is not None and component >= size:
        raise PlantError(f"{name!r} is beyond the {size} component(s) of its {kind}; they count from [0] to [{size - 1}]")
    return component or 0


def _add_joint_sensor(spec: mujoco.MjSpec, output: str, target: str) -> None:
    joints = {joint.name: joint for joint in spec.joints if joint.name}
    velocity = target not in joints and target.endswith(":velocity")
    joint = target.removesuffix(":velocity") if velocity else target
    _require_known("joint", joint, joints)
    if joints[joint].type not in (mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE):
        raise PlantError(f"output {output!r} needs a slide or hinge; {joint!r} is a ball or free joint: use a sensor or a site")
    kind = mujoco.mjtSensor.mjSENS_JOINTVEL if velocity else mujoco.mjtSensor.mjSENS_JOINTPOS
    spec.add_sensor(name=output, type=kind, objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)


def _require_known(kind: str, name: str, known: Iterable[str]) -> None:
    known = [entry for entry in known if entry]
    if name not in known:
        raise PlantError(f"the model has no {kind} named {name!r}; there are: {listed(known)}")


def _require_distinct(kind: str, names: Sequence[str]) -> None:
    if isinstance(names, str) or not names or len(set(names)) != len(names):
        raise PlantError(f'expected a list of distinct {kind} names such as ["name"], got {shown(names)}')
