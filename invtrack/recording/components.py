"""Names of the components of sensors that measure vectors and rotations: "gyro.x" in place of "gyro[0]"."""

from __future__ import annotations

import mujoco

_KINDS = mujoco.mjtSensor
ROTATIONS = (_KINDS.mjSENS_BALLQUAT, _KINDS.mjSENS_FRAMEQUAT)
OTHERS = (_KINDS.mjSENS_USER, _KINDS.mjSENS_PLUGIN, _KINDS.mjSENS_CONTACT, _KINDS.mjSENS_TACTILE, _KINDS.mjSENS_GEOMFROMTO)
"""Sensors whose values are not, or not only, the components of one vector, whatever their number."""


def component_names(model: mujoco.MjModel) -> dict[str, str]:
    """By the names "NAME[1]" of channels, those of the components: x y z of vectors, w x y z of rotations."""
    names: dict[str, str] = {}
    for sensor in range(model.nsensor):
        kind, name = mujoco.mjtSensor(model.sensor_type[sensor]), str(model.sensor(sensor).name)
        axes = "wxyz" if kind in ROTATIONS else "xyz" if model.sensor_dim[sensor] == 3 and kind not in OTHERS else ""
        names |= {f"{name}[{number}]": f"{name}.{axis}" for number, axis in enumerate(axes)}
    return names
