"""Physical quantities of a mechanism's elements: what each is in a compiled model, and in the specification of one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from invtrack.errors import PlantError
from invtrack.plant.elements import element_name, joint_components
from invtrack.plant.units import gear_size, joint_unit, servo_gain_unit, servo_kind, tendon_unit, unit_of

TRIANGLE_TOLERANCE = 1e-9
"""Share of a principal moment of inertia by which it may exceed the sum of the other two."""


@dataclass(frozen=True)
class Quantity:
    """An entry of one of the arrays of a compiled model, and what it is in an element of a specification.

    Args:
        array: the array's name in MjModel.
        attribute: its name in the element of a specification.
        unit: (model, element's index, component) -> unit.
        rows: (model, element's index) -> where the element stands in the array.
        size: number of components, named "[0]", "[1]", ...
        default: the component that the name alone stands for; None: where there are several, one has to be chosen.
        lowest: least value that makes sense.
    """

    array: str
    attribute: str
    unit: Callable[[mujoco.MjModel, int, int], str]
    rows: Callable[[mujoco.MjModel, int], Any] = lambda model, index: index
    size: int = 1
    default: int | None = 0
    lowest: float = 0.0

    def read(self, model: mujoco.MjModel, index: int, component: int) -> float:
        return float(np.ravel(getattr(model, self.array)[self._where(model, index, component)])[0])

    def write(self, model: mujoco.MjModel, index: int, component: int, value: float, reference: mujoco.MjModel) -> None:
        getattr(model, self.array)[self._where(model, index, component)] = value

    def write_spec(self, element: Any, component: int, value: float, reference: mujoco.MjModel) -> None:
        if np.ndim(getattr(element, self.attribute)):
            getattr(element, self.attribute)[component] = value
        else:
            setattr(element, self.attribute, value)

    def require_meaning(self, model: mujoco.MjModel, index: int) -> None:
        """Raises PlantError where this element has no such quantity."""

    def check(self, model: mujoco.MjModel, index: int) -> None:
        """Raises PlantError where what was written leaves no mechanism."""

    def components(self, model: mujoco.MjModel, index: int) -> int:
        """How many components it has in this element."""
        return self.size

    def _where(self, model: mujoco.MjModel, index: int, component: int) -> Any:
        rows = self.rows(model, index)
        return (rows, component) if getattr(model, self.array).ndim > 1 else rows


class _Inertial(Quantity):
    """What a specification states together with the body's other inertial properties, or leaves to its geoms."""

    def write_spec(self, element: Any, component: int, value: float, reference: mujoco.MjModel) -> None:
        compiler, name = element.compiler, element_name(reference, "body", element.id)
        if compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE or compiler.settotalmass > 0:
            raise PlantError(
                f"cannot compile the {self.attribute} of body {name!r}: the compiler options inertiafromgeom or settotalmass"
                " overwrite it; remove them from the file"
            )
        if not element.explicitinertial or not np.isnan(element.fullinertia[0]):
            element.explicitinertial = True
            element.mass, element.inertia = reference.body_mass[element.id], reference.body_inertia[element.id]
            element.ipos, element.iquat = reference.body_ipos[element.id], reference.body_iquat[element.id]
            element.fullinertia = np.r_[np.nan, np.zeros(5)]  # NaN: not given, so that the diagonal one counts
        super().write_spec(element, component, value, reference)


class _Mass(_Inertial):
    """A body's mass, its inertia staying: what is added is a point mass at its centre of mass."""

    def check(self, model: mujoco.MjModel, index: int) -> None:
        rigid = model.body_weldid == model.body_weldid[index]
        if model.body_weldid[index] != 0 and np.sum(model.body_mass[rigid]) <= mujoco.mjMINVAL:
            raise PlantError(
                f"a mass of {model.body_mass[index]} kg for body {element_name(model, 'body', index)!r} leaves a moving body"
                " without mass, so its acceleration is undefined; give a positive mass, or weld the body to one that has mass"
            )


class _ScaledMass(_Mass):
    """A body's mass, its inertia growing in proportion: the same shape of another density."""

    def write(self, model: mujoco.MjModel, index: int, component: int, value: float, reference: mujoco.MjModel) -> None:
        super().write(model, index, component, value, reference)
        model.body_inertia[index] = self._inertia(reference, index, value)

    def write_spec(self, element: Any, component: int, value: float, reference: mujoco.MjModel) -> None:
        super().write_spec(element, component, value, reference)
        element.inertia = self._inertia(reference, element.id, value)

    def require_meaning(self, model: mujoco.MjModel, index: int) -> None:
        if model.body_mass[index] <= mujoco.mjMINVAL:
            name, mass = element_name(model, "body", index), model.body_mass[index]
            raise PlantError(
                f"the inertia of body {name!r} cannot scale with its mass because its mass in the file is {mass} kg;"
                f' give it a mass and an inertia there, or use "body:{name}:mass", which leaves the inertia as it is'
            )

    @staticmethod
    def _inertia(reference: mujoco.MjModel, index: int, value: float) -> np.ndarray:
        return np.array(reference.body_inertia[index] * (value / reference.body_mass[index]))


class _PrincipalInertia(_Inertial):
    """A principal moment of inertia about the body's centre of mass."""

    def check(self, model: mujoco.MjModel, index: int) -> None:
        moments = np.sort(model.body_inertia[index])
        if moments[2] > (1 + TRIANGLE_TOLERANCE) * (moments[0] + moments[1]):
            raise PlantError(
                f"body {element_name(model, 'body', index)!r} cannot have the principal moments of inertia"
                f" {model.body_inertia[index].tolist()} kg m^2: none may exceed the sum of the other two; change them together"
            )
        rigid = model.body_weldid == model.body_weldid[index]
        if model.body_weldid[index] != 0 and np.any(np.sum(model.body_inertia[rigid], axis=0) <= mujoco.mjMINVAL):
            raise PlantError(
                f"body {element_name(model, 'body', index)!r} moves, so each of its principal moments of inertia must be positive"
            )


class _ScalarJointPosition(Quantity):
    """A position of a slide or hinge, which a specification states in degrees where its file does."""

    def write_spec(self, element: Any, component: int, value: float, reference: mujoco.MjModel) -> None:
        degrees = element.type == mujoco.mjtJoint.mjJNT_HINGE and element.compiler.degree
        super().write_spec(element, component, math.degrees(value) if degrees else value, reference)

    def require_meaning(self, model: mujoco.MjModel, index: int) -> None:
        if joint_components(model, index):
            raise PlantError(
                f"joint {element_name(model, 'joint', index)!r} is a ball or free joint, whose spring has no {self.attribute}"
            )


class _Gear(Quantity):
    """The gear of an actuator: one number, or as many as its joint or site has directions."""

    def components(self, model: mujoco.MjModel, index: int) -> int:
        return gear_size(model, index)


class _ServoGain(Quantity):
    """A gain of a servo, which multiplies the control less what is measured, and so stands in MuJoCo's gain and bias.

    A position servo's kp is its gain and minus its bias per length, its kv minus that per velocity; a velocity servo's kv is its
    gain and minus its bias per velocity.
    """

    def read(self, model: mujoco.MjModel, index: int, component: int) -> float:
        return -float(model.actuator_biasprm[index, self._slot])

    def write(self, model: mujoco.MjModel, index: int, component: int, value: float, reference: mujoco.MjModel) -> None:
        model.actuator_biasprm[index, self._slot] = -value
        if self._gains(reference, index):
            model.actuator_gainprm[index, 0] = value

    def write_spec(self, element: Any, component: int, value: float, reference: mujoco.MjModel) -> None:
        element.biasprm[self._slot] = -value
        if self._gains(reference, element.id):
            element.gainprm[0] = value

    def require_meaning(self, model: mujoco.MjModel, index: int) -> None:
        kind = servo_kind(model, index)
        if kind is None or (self.attribute == "kp" and kind == "velocity"):
            name = element_name(model, "actuator", index)
            wanted = "position servo" if self.attribute == "kp" else "position or velocity servo"
            raise PlantError(f'actuator {name!r} is no {wanted}, so it has no {self.attribute}; its gain is "actuator:{name}:gain"')

    @property
    def _slot(self) -> int:
        return {"kp": 1, "kv": 2}[self.attribute]

    def _gains(self, reference: mujoco.MjModel, index: int) -> bool:
        """Whether the control is multiplied by it, too."""
        return servo_kind(reference, index) == {"kp": "position", "kv": "velocity"}[self.attribute]


def _of_joint(attribute: str) -> Callable[[mujoco.MjModel, int, int], str]:
    def unit(model: mujoco.MjModel, joint: int, component: int) -> str:
        free = model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE  # its six directions have no unit in common
        return "" if free else unit_of(attribute, joint_unit(model, joint))

    return unit


def _of_tendon(attribute: str) -> Callable[[mujoco.MjModel, int, int], str]:
    return lambda model, tendon, component: unit_of(attribute, tendon_unit(model, tendon))


def _always(*units: str) -> Callable[[mujoco.MjModel, int, int], str]:
    """The unit of each component, or of all of them."""
    return lambda model, index, component: units[component] if len(units) > 1 else units[0]


def _degrees_of_freedom(model: mujoco.MjModel, joint: int) -> np.ndarray:
    return np.flatnonzero(model.dof_jntid == joint)


def _joint_position(model: mujoco.MjModel, joint: int) -> int:
    return int(model.jnt_qposadr[joint])


def _output(model: mujoco.MjModel, actuator: int) -> int:
    return int(model.actuator_outadr[actuator])


def _in_each_direction(attribute: str) -> Quantity:
    """An attribute of a joint that is the same for all its degrees of freedom."""
    return Quantity(f"dof_{attribute}", attribute, _of_joint(attribute), _degrees_of_freedom)


def _tendon_quantity(attribute: str) -> Quantity:
    return Quantity(f"tendon_{attribute}", attribute, _of_tendon(attribute))


QUANTITIES: Mapping[str, Mapping[str, Quantity]] = {
    "body": {
        "mass": _Mass("body_mass", "mass", _always("kg")),
        "mass:scaled": _ScaledMass("body_mass", "mass", _always("kg")),
        "inertia": _PrincipalInertia("body_inertia", "inertia", _always("kg m^2"), size=3, default=None),
    },
    "joint": {
        "stiffness": Quantity("jnt_stiffness", "stiffness", _of_joint("stiffness")),
        "damping": _in_each_direction("damping"),
        "frictionloss": _in_each_direction("frictionloss"),
        "armature": _in_each_direction("armature"),
        "springref": _ScalarJointPosition("qpos_spring", "springref", _of_joint("springref"), _joint_position, lowest=-math.inf),
    },
    "tendon": {attribute: _tendon_quantity(attribute) for attribute in ("stiffness", "damping", "frictionloss", "armature")},
    "actuator": {
        "gear": _Gear("actuator_gear", "gear", _always("1"), _output, size=6, default=None, lowest=-math.inf),
        "gain": Quantity("actuator_gainprm", "gainprm", _always(""), size=3, lowest=-math.inf),
        "bias": Quantity("actuator_biasprm", "biasprm", _always(""), size=3, default=None, lowest=-math.inf),
        "kp": _ServoGain("actuator_biasprm", "kp", lambda model, index, component: servo_gain_unit(model, index, "stiffness")),
        "kv": _ServoGain("actuator_biasprm", "kv", lambda model, index, component: servo_gain_unit(model, index, "damping")),
    },
    "geom": {"friction": Quantity("geom_friction", "friction", _always("1", "m", "m"), size=3)},
}
"""What may be a parameter, by kind of element and name."""
