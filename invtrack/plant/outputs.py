"""What the name of an output or measurement stands for: a sensor, a state, or an expression such as "site:NAME:x"."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco
import numpy as np

from invtrack.channels import Channels
from invtrack.errors import PlantError
from invtrack.plant.configuration import Configuration
from invtrack.plant.elements import (
    AXES,
    checked_component,
    coordinate_channels,
    element_id,
    element_name,
    element_names,
    find_element,
    joint_components,
    listed,
    require_distinct,
    split_component,
)
from invtrack.plant.readings import ANGLES, Attitude, Distance, Entry, Reading, Readings, RotationVector
from invtrack.plant.units import activation_unit, joint_unit, sensor_unit, tendon_unit

FORMS = (
    '"SENSOR", "SENSOR[1]", a state such as "NAME velocity", "joint:NAME", "joint:NAME:velocity" (of a free or ball joint'
    ' "joint:NAME:x", "joint:NAME:rx:velocity"), "activation:ACTUATOR", "body:NAME:x" and "site:NAME:x" (or y, z, yaw, pitch,'
    ' roll), "distance:SITE:SITE", "tendon:NAME"'
)
"""What messages say an output may be."""


def output_readings(model: mujoco.MjModel, outputs: Sequence[str], reference: Configuration) -> Readings:
    """What the outputs read; angles count from the `reference` configuration.

    Raises PlantError for an output that is none of `FORMS`, with the names there are.
    """
    require_distinct("output", outputs)
    resolver = _Resolver(model, reference)
    readings = tuple(resolver.reading(output) for output in outputs)
    return Readings(Channels(outputs, [reading.unit for reading in readings]), readings)


class _Resolver:
    """Finds what names stand for in a model."""

    def __init__(self, model: mujoco.MjModel, reference: Configuration) -> None:
        self.model, self.reference = model, mujoco.MjData(model)
        reference.write(self.reference)
        mujoco.mj_kinematics(model, self.reference)
        self.sensors = set(element_names(model, "sensor"))
        self.expressions = {
            "joint": self._joint,
            "activation": self._activation,
            "body": self._place,
            "site": self._place,
            "distance": self._distance,
            "tendon": self._tendon,
        }

    def reading(self, output: str) -> Reading:
        sensor, component = split_component(output, self.sensors)
        if sensor in self.sensors:
            return self._sensor(output, sensor, component)
        kind, _, rest = output.partition(":")
        if kind in self.expressions and rest:
            return self.expressions[kind](output, kind, rest)
        states = coordinate_channels(self.model).names
        if output in states:
            return self._state(states.index(output))
        raise PlantError(
            f"no sensor or state is named {output!r}; the sensors are: {listed(sorted(self.sensors))}; the states are:"
            f" {listed(states)}. An output is one of {FORMS}"
        )

    def _sensor(self, output: str, name: str, component: int | None) -> Reading:
        model, sensor = self.model, element_id(self.model, "sensor", name)
        if model.sensor_type[sensor] == mujoco.mjtSensor.mjSENS_USER:
            raise PlantError(f"output {output!r} is a user sensor, which no model computes; choose a sensor that MuJoCo evaluates")
        if model.sensor_interval[sensor, 0] > 0:
            raise PlantError(f"output {output!r} is sampled at intervals, so it is no function of the state; remove the interval")
        component = checked_component("sensor", output, component, int(model.sensor_dim[sensor]))
        return Entry("sensordata", int(model.sensor_adr[sensor]) + component, sensor_unit(model, sensor))

    def _joint(self, output: str, kind: str, rest: str) -> Reading:
        joint, suffix = self._element(kind, rest)
        component, _, rate = suffix.rpartition(":") if suffix.endswith("velocity") else (suffix, "", "")
        components = joint_components(self.model, joint)
        if component not in (components or ("",)) or rate not in ("", "velocity"):
            forms = [f"{name}{end}" for end in ("", ":velocity") for name in ([f":{c}" for c in components] or [""])]
            raise self._unknown(output, [f"joint:{element_name(self.model, 'joint', joint)}{form}" for form in forms])
        number = components.index(component) if components else 0
        return self._joint_velocity(joint, number) if rate else self._joint_position(joint, number)

    def _joint_position(self, joint: int, number: int) -> Reading:
        model, address, components = self.model, int(self.model.jnt_qposadr[joint]), joint_components(self.model, joint)
        if not components:
            return Entry("qpos", address, joint_unit(model, joint))
        if components[number] in AXES:
            return Entry("qpos", address + number, "m")
        address += len(components) - 3  # a free joint has its place before its quaternion
        return RotationVector(address, number - len(components) + 3, np.array(self.reference.qpos[address : address + 4]))

    def _joint_velocity(self, joint: int, number: int) -> Reading:
        components = joint_components(self.model, joint)
        unit = ("m" if components[number] in AXES else "rad") if components else joint_unit(self.model, joint)
        return Entry("qvel", int(self.model.jnt_dofadr[joint]) + number, f"{unit}/s")

    def _state(self, index: int) -> Reading:
        """Of a coordinate, by its place among all 2 nv + na."""
        model = self.model
        if index >= 2 * model.nv:
            activation = index - 2 * model.nv
            actuator = next(
                i for i in range(model.nactuator) if 0 <= activation - model.actuator_actadr[i] < model.actuator_actnum[i]
            )
            return Entry("act", activation, activation_unit(model, actuator))
        dof = index % model.nv
        joint = int(model.dof_jntid[dof])
        number = dof - int(model.jnt_dofadr[joint])
        return self._joint_position(joint, number) if index < model.nv else self._joint_velocity(joint, number)

    def _activation(self, output: str, kind: str, rest: str) -> Reading:
        model = self.model
        name, component = split_component(rest, set(element_names(model, "actuator")))
        actuator = element_id(model, "actuator", name)
        count = int(model.actuator_actnum[actuator])
        if not count:
            stateful = [element_name(model, "actuator", i) for i in range(model.nactuator) if model.actuator_actnum[i]]
            raise PlantError(f"output {output!r}: actuator {name!r} has no activation; those that have one are: {listed(stateful)}")
        component = checked_component("activation", output, component, count)
        return Entry("act", int(model.actuator_actadr[actuator]) + component, activation_unit(model, actuator))

    def _place(self, output: str, kind: str, rest: str) -> Reading:
        index, suffix = self._element(kind, rest)
        if suffix in AXES:
            return Entry("xpos" if kind == "body" else "site_xpos", (index, AXES.index(suffix)), "m")
        if suffix not in ANGLES:
            raise self._unknown(output, [f"{kind}:{element_name(self.model, kind, index)}:{c}" for c in (*AXES, *ANGLES)])
        if kind == "body":
            return Attitude("xmat", index, suffix, np.array(self.reference.xmat[index]).reshape(3, 3))
        return Attitude("site_xmat", index, suffix, np.array(self.reference.site_xmat[index]).reshape(3, 3))

    def _distance(self, output: str, kind: str, rest: str) -> Reading:
        parts = rest.split(":")
        for cut in range(1, len(parts)):
            first, second = (find_element(self.model, "site", ":".join(names)) for names in (parts[:cut], parts[cut:]))
            if first is not None and second is not None:
                if first == second:
                    raise PlantError(f"output {output!r} is the distance of a site from itself; name two sites")
                return Distance(first, second)
        sites = listed(element_names(self.model, "site"))
        raise PlantError(f'output {output!r} does not name two sites as "distance:SITE:SITE"; the sites are: {sites}')

    def _tendon(self, output: str, kind: str, rest: str) -> Reading:
        tendon = element_id(self.model, "tendon", rest)
        return Entry("ten_length", tendon, tendon_unit(self.model, tendon))

    def _element(self, kind: str, text: str) -> tuple[int, str]:
        """The element that a text begins with, and what comes behind the colon after its name, which may contain colons itself."""
        parts = text.split(":")
        for cut in range(len(parts), 0, -1):
            index = find_element(self.model, kind, ":".join(parts[:cut]))
            if index is not None:
                return index, ":".join(parts[cut:])
        return element_id(self.model, kind, parts[0]), ""  # raises, with the names there are

    def _unknown(self, output: str, forms: Sequence[str]) -> PlantError:
        return PlantError(f"no output is named {output!r}; of this element there are: {listed(forms)}")
