"""SI units of joints, actuators and sensors, as far as the model tells them."""

from __future__ import annotations

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
_UNKNOWN = "1"


def joint_unit(model: mujoco.MjModel, joint: int) -> str:
    """Unit of a scalar joint's position: "m" for a slide, "rad" for a hinge."""
    return "m" if model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_SLIDE else "rad"


def tendon_unit(model: mujoco.MjModel, tendon: int) -> str:
    """Unit of a tendon's length: "m"; of a fixed tendon that of its joints, "1" where they differ."""
    first = int(model.tendon_adr[tendon])
    wraps = range(first, first + int(model.tendon_num[tendon]))
    if any(model.wrap_type[wrap] != mujoco.mjtWrap.mjWRAP_JOINT for wrap in wraps):
        return "m"
    units = {joint_unit(model, int(model.wrap_objid[wrap])) for wrap in wraps}
    return units.pop() if len(units) == 1 else _UNKNOWN


def sensor_unit(model: mujoco.MjModel, sensor: int) -> str:
    """Unit of a sensor's values; "1" where its type does not say."""
    kind = mujoco.mjtSensor(model.sensor_type[sensor]).name.removeprefix("mjSENS_")
    target = int(model.sensor_objid[sensor])
    if kind in _JOINT_SENSORS:
        return joint_unit(model, target) + _JOINT_SENSORS[kind]
    if kind in _JOINT_FORCE_SENSORS:
        return _force_unit(joint_unit(model, target))
    if kind in _TENDON_SENSORS:
        return tendon_unit(model, target) + _TENDON_SENSORS[kind]
    if kind in _TENDON_FORCE_SENSORS:
        return _force_unit(tendon_unit(model, target))
    return _SENSOR_UNITS.get(kind, _UNKNOWN)


def control_unit(model: mujoco.MjModel, actuator: int) -> str:
    """Unit of an actuator's control: that of the force it commands for a motor, with or without a filter; "1" for all others."""
    motor = (
        model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_NONE
        and bool(np.isclose(model.actuator_gainprm[actuator, 0], 1.0))
        and mujoco.mjtDyn(model.actuator_dyntype[actuator])
        in (mujoco.mjtDyn.mjDYN_NONE, mujoco.mjtDyn.mjDYN_FILTER, mujoco.mjtDyn.mjDYN_FILTEREXACT)
    )
    if not motor:
        return _UNKNOWN
    target = int(model.actuator_trnid[actuator, 0])
    transmission = mujoco.mjtTrn(model.actuator_trntype[actuator])
    if transmission == mujoco.mjtTrn.mjTRN_TENDON:
        return _force_unit(tendon_unit(model, target))
    if transmission in (mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtTrn.mjTRN_JOINTINPARENT):
        if model.jnt_type[target] != mujoco.mjtJoint.mjJNT_FREE:
            return _force_unit(joint_unit(model, target))
    elif transmission != mujoco.mjtTrn.mjTRN_SITE:
        return _UNKNOWN
    return _wrench_unit(model.actuator_gear[model.actuator_outadr[actuator]])


def _force_unit(position_unit: str) -> str:
    return {"m": "N", "rad": "N m"}.get(position_unit, _UNKNOWN)


def _wrench_unit(gear: np.ndarray) -> str:
    force, torque = np.any(gear[:3]), np.any(gear[3:])
    if force and torque:
        return _UNKNOWN
    return "N m" if torque else "N"
