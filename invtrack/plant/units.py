"""SI units of joints, tendons, actuators and sensors, as far as the model tells them.

A unit may carry a number: a motor with gear 10 on a slide has the unit "x10 N", so that a control of 3 is 30 N at the joint.
"" stands for a unit that the model does not tell, "1" for a plain number.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np

_SENSOR_UNITS = {
    "ACCELEROMETER": "m/s^2",
    "VELOCIMETER": "m/s",
    "GYRO": "rad/s",
    "FORCE": "N",
    "TORQUE": "N m",
    "TOUCH": "N",
    "MAGNETOMETER": "T",
    "RANGEFINDER": "m",
    "BALLANGVEL": "rad/s",
    "FRAMEPOS": "m",
    "FRAMELINVEL": "m/s",
    "FRAMEANGVEL": "rad/s",
    "FRAMELINACC": "m/s^2",
    "FRAMEANGACC": "rad/s^2",
    "SUBTREECOM": "m",
    "SUBTREELINVEL": "m/s",
    "SUBTREEANGMOM": "kg m^2/s",
    "GEOMDIST": "m",
    "GEOMFROMTO": "m",
    "E_POTENTIAL": "J",
    "E_KINETIC": "J",
    "CLOCK": "s",
}
_JOINT_SENSORS = {"JOINTPOS": "", "JOINTLIMITPOS": "", "JOINTVEL": "/s", "JOINTLIMITVEL": "/s"}
_JOINT_FORCE_SENSORS = ("JOINTACTFRC", "JOINTLIMITFRC")
_TENDON_SENSORS = {"TENDONPOS": "", "TENDONLIMITPOS": "", "TENDONVEL": "/s", "TENDONLIMITVEL": "/s"}
_TENDON_FORCE_SENSORS = ("TENDONACTFRC", "TENDONLIMITFRC")
_UNKNOWN = ""
_ATTRIBUTES = {
    "stiffness": {"m": "N/m", "rad": "N m/rad"},
    "damping": {"m": "N s/m", "rad": "N m s/rad"},
    "frictionloss": {"m": "N", "rad": "N m"},
    "armature": {"m": "kg", "rad": "kg m^2"},
    "springref": {"m": "m", "rad": "rad"},
}
_MUSCLE = "1"
_DIMENSIONLESS = ("BALLQUAT", "FRAMEQUAT", "FRAMEXAXIS", "FRAMEYAXIS", "FRAMEZAXIS", "GEOMNORMAL")
_FILTERS = (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """Unit of a scalar joint's position: "m" for a slide, "rad" for a hinge."""
    return "m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"


def tendon_unit(model: mujoco.MjModel, tendon: int) -> str:
    """Unit of a tendon's length: "m"; of a fixed tendon that of its joints, "" where they differ."""
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    if any(model.wrap_type[wrap] != mujoco.mjtWrap.mjWRAP_JOINT for wrap in wraps):
        return "m"
    units = {joint_unit(model, int(model.wrap_objid[wrap])) for wrap in wraps}
    return units.pop() if len(units) == 1 else _UNKNOWN


def sensor_unit(model: mujoco.MjModel, sensor: int) -> str:
    """Unit of a sensor's values; "" where its type does not say."""
    kind = mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_")
    target = int(model.sensor_objid[sensor])
    if kind in _JOINT_SENSORS:
        return joint_unit(model, target) + _JOINT_SENSORS[kind]
    if kind in _JOINT_FORCE_SENSORS:
        return _force_unit(joint_unit(model, target))
    if kind in _TENDON_SENSORS:
        return _over_time(tendon_unit(model, target), _TENDON_SENSORS[kind])
    if kind in _TENDON_FORCE_SENSORS:
        return _force_unit(tendon_unit(model, target))
    if kind in ("ACTUATORPOS", "ACTUATORVEL"):
        return _over_time(_transmission(model, target).position_unit, "/s" if kind == "ACTUATORVEL" else "")
    if kind == "ACTUATORFRC":
        return _transmission(model, target).force_unit()
    return "1" if kind in _DIMENSIONLESS else _SENSOR_UNITS.get(kind, _UNKNOWN)


def control_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Unit of an actuator's control: of what it commands at the joint, tendon or site, that is with gain and gear.

    Motors, with or without a filter, and whatever else has a constant gain command a force or torque ("N"; with gear times gain 10:
    "x10 N"; a rotor, whose torque is along its thrust, the thrust). Servos command what they hold: a position servo with gear 10,
    whose actuator length is ten times the joint's position, "x0.1 rad", a velocity servo "x0.1 rad/s". An integrator before either
    commands its rate. A muscle's excitation is a plain number; of others the model does not tell ("").
    """
    dynamics = mujoco.mjtDyn(model.actuator_dyntype[actuator])
    unit = activation_unit(model, actuator)
    if dynamics == mujoco.mjtDyn.mjDYN_INTEGRATOR:
        return _over_time(unit, "/s")
    return unit if dynamics in (*_FILTERS, mujoco.mjtDyn.mjDYN_MUSCLE) else _UNKNOWN


def activation_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Unit of what the gain multiplies: an actuator's activation, or without dynamics its control."""
    if model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_MUSCLE:
        return _MUSCLE
    gain, servo, transmission = constant_gain(model, actuator), servo_kind(model, actuator), _transmission(model, actuator)
    if gain is None or _affine_bias(model, actuator) is None:
        return _UNKNOWN
    if transmission.length and servo is not None:
        return _over_time(transmission.position_unit, "/s" if servo == "velocity" else "")
    return transmission.force_unit(gain)


def servo_kind(model: mujoco.MjModel, actuator: int) -> Literal["position", "velocity"] | None:
    """What the actuator's force compares its activation with, its length or the velocity of it; None where it is no servo."""
    gain, bias = constant_gain(model, actuator), _affine_bias(model, actuator)
    if gain is None or bias is None:
        return None
    if bias[1] and math.isclose(gain, -bias[1], rel_tol=1e-9):
        return "position"
    return "velocity" if not bias[1] and bias[2] and math.isclose(gain, -bias[2], rel_tol=1e-9) else None


def servo_gain_unit(model: mujoco.MjModel, actuator: int, what: Literal["stiffness", "damping"]) -> str:
    """Unit of a servo's gain kp ("stiffness") or kv ("damping"), as the mechanism feels it: with gear 10 on a slide "x100 N/m"."""
    transmission = _transmission(model, actuator)
    return _multiple(transmission.gear**2, unit_of(what, transmission.length))


def unit_of(attribute: str, position_unit: str) -> str:
    """Unit of an attribute of a joint, tendon or servo ("stiffness", "damping", ...), by the unit of its position."""
    return _ATTRIBUTES[attribute].get(position_unit, _UNKNOWN)


def gear_size(model: mujoco.MjModel, actuator: int) -> int:
    """How many entries of an actuator's gear count: 1, or 3 and 6 on ball and free joints and at sites."""
    kind, target = mujoco.mjtTrn(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        sizes = {mujoco.mjtJoint.mjJNT_BALL: 3, mujoco.mjtJoint.mjJNT_FREE: 6}
        return sizes.get(mujoco.mjtJoint(model.jnt_type[target]), 1)
    return 6 if kind == mujoco.mjtTrn.mjTRN_SITE else 1


def constant_gain(model: mujoco.MjModel, actuator: int) -> float | None:
    """Force per activation; None where it depends on the state."""
    kind, (constant, *slopes) = model.actuator_gaintype[actuator], model.actuator_gainprm[actuator, :3]
    fixed = kind == mujoco.mjtGain.mjGAIN_FIXED or (kind == mujoco.mjtGain.mjGAIN_AFFINE and not np.any(slopes))
    return float(constant) if fixed else None


def _affine_bias(model: mujoco.MjModel, actuator: int) -> np.ndarray | None:
    """Force at rest, per length and per velocity of the actuator (3,); None where it is no such function."""
    kind = model.actuator_biastype[actuator]
    if kind == mujoco.mjtBias.mjBIAS_NONE:
        return np.zeros(3)
    return np.array(model.actuator_biasprm[actuator, :3]) if kind == mujoco.mjtBias.mjBIAS_AFFINE else None


@dataclass(frozen=True)
class _Transmission:
    """What an actuator's force f and length l are at the mechanism: gear f in `force`, l / gear in `length` ("" without length)."""

    gear: float
    force: str
    length: str

    def force_unit(self, gain: float = 1.0) -> str:
        """Unit of f / gain."""
        return _multiple(self.gear * abs(gain), self.force)

    @property
    def position_unit(self) -> str:
        """Unit of l."""
        return _multiple(1 / self.gear, self.length) if self.gear else _UNKNOWN


def _transmission(model: mujoco.MjModel, actuator: int) -> _Transmission:
    gear = model.actuator_gear[model.actuator_outadr[actuator]]
    target, reference = (int(index) for index in model.actuator_trnid[actuator])
    kind = mujoco.mjtTrn(model.actuator_trntype[actuator])
    if kind in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        joint = model.jnt_type[target]
        if joint == mujoco.mjtJoint.mjJNT_FREE:
            return _wrench(gear, has_length=False)
        size = np.linalg.norm(gear[:3]) if joint == mujoco.mjtJoint.mjJNT_BALL else abs(gear[0])
        return _along(float(size), joint_unit(model, target))
    if kind == mujoco.mjtTrn.mjTRN_TENDON:
        return _along(float(abs(gear[0])), tendon_unit(model, target))
    if kind == mujoco.mjtTrn.mjTRN_SLIDERCRANK:
        return _along(float(abs(gear[0])), "m")
    if kind == mujoco.mjtTrn.mjTRN_SITE:
        return _wrench(gear, has_length=reference >= 0)
    return _Transmission(0.0, _UNKNOWN, _UNKNOWN)


def _along(gear: float, position_unit: str) -> _Transmission:
    return _Transmission(gear, _force_unit(position_unit), position_unit)


def _wrench(gear: np.ndarray, *, has_length: bool) -> _Transmission:
    """Of a gear with three components of force and three of torque: of both only where they lie along one line, as a rotor's do."""
    force, torque = float(np.linalg.norm(gear[:3])), float(np.linalg.norm(gear[3:]))
    if force and torque:
        parallel = np.linalg.norm(np.cross(gear[:3], gear[3:])) <= 1e-9 * force * torque
        return _Transmission(force, "N" if parallel else _UNKNOWN, _UNKNOWN)
    along = _along(force, "m") if force else _along(torque, "rad")
    return along if has_length else _Transmission(along.gear, along.force, _UNKNOWN)


def _force_unit(position_unit: str) -> str:
    return {"m": "N", "rad": "N m"}.get(position_unit, _UNKNOWN)


def _over_time(unit: str, per: str) -> str:
    return unit and unit + per


def _multiple(number: float, unit: str) -> str:
    """The unit that is so many of another: "x10 N"."""
    if not unit or not 0 < number < math.inf:
        return _UNKNOWN
    return unit if math.isclose(number, 1.0, rel_tol=1e-9) else f"x{number:.6g} {unit}"
