"""What an output or measurement reads from MuJoCo's data: sensors, states, places and attitudes, distances, lengths of tendons.

Places are world coordinates [m] of a body's frame or a site. Yaw, pitch and roll [rad] say how a body or site has turned from its
orientation R0 at a reference configuration, in the convention of vehicles (ZYX, about the axes that turn with it):

    R = R0 Rz(yaw) Ry(pitch) Rx(roll),    -pi < yaw, roll <= pi,    -pi/2 <= pitch <= pi/2.

All three are 0 at the reference, smooth around it as long as |pitch| < pi/2 (a run follows yaw and roll over any number of turns),
and to first order the components about z, y, x of the rotation vector in the frame at the reference. The components rx, ry, rz of a
ball or free joint's rotation are that rotation vector itself, smooth up to half a turn.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, Protocol

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.channels import Channels
from invtrack.errors import PlantError

Stage = Literal["state", "position", "tendon", "sensor"]
"""What MuJoCo has to compute before a reading is up to date: nothing; mj_kinematics; mj_tendon after that; all of mj_forward."""

ANGLES = ("yaw", "pitch", "roll")

NEAREST = 1e-6
"""A reading this near (in radians, or relative to the mechanism's extent) to where it is not smooth has no derivative there."""

_STAGES: dict[str, Stage] = {
    "qpos": "state",
    "qvel": "state",
    "act": "state",
    "xpos": "position",
    "site_xpos": "position",
    "ten_length": "tendon",
    "sensordata": "sensor",
}


class Reading(Protocol):
    """One number read from MuJoCo's data. stage: what has to be up to date. unit: of the value. period: what it is only known up to
    a multiple of, 0 where it is known; a run follows it from one step to the next.
    """

    @property
    def stage(self) -> Stage: ...

    @property
    def unit(self) -> str: ...

    @property
    def period(self) -> float: ...

    def value(self, data: mujoco.MjData) -> float: ...

    def kink(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        """Why the reading has no derivative at the configuration of `data`; empty where it has one."""
        ...


@dataclass(frozen=True)
class Entry:
    """An entry of one of MuJoCo's arrays."""

    array: str
    index: int | tuple[int, int]
    unit: str
    period: float = 0.0

    @property
    def stage(self) -> Stage:
        return _STAGES[self.array]

    def value(self, data: mujoco.MjData) -> float:
        return float(getattr(data, self.array)[self.index])

    def kink(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        return ""


@dataclass(frozen=True, eq=False)
class Attitude:
    """Yaw, pitch or roll of a body ("xmat") or site ("site_xmat") from its orientation R0 (3, 3) at the reference configuration."""

    array: Literal["xmat", "site_xmat"]
    index: int
    angle: str
    R0: Array
    stage: Stage = "position"
    unit: str = "rad"

    @property
    def period(self) -> float:
        return 0.0 if self.angle == "pitch" else 2 * math.pi

    def value(self, data: mujoco.MjData) -> float:
        R = self._turn(data)
        if self.angle == "yaw":
            return math.atan2(R[1, 0], R[0, 0])
        if self.angle == "roll":
            return math.atan2(R[2, 1], R[2, 2])
        return math.atan2(-R[2, 0], math.hypot(R[0, 0], R[1, 0]))

    def kink(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        R = self._turn(data)
        if math.hypot(R[0, 0], R[1, 0]) < NEAREST:
            return "has pitched by a quarter turn from the reference configuration, where yaw, pitch and roll are not smooth"
        if self.angle != "pitch" and math.pi - abs(self.value(data)) < NEAREST:
            return "has turned by half a turn from the reference configuration, where the angle jumps by a full turn"
        return ""

    def _turn(self, data: mujoco.MjData) -> Array:
        return np.asarray(self.R0.T @ getattr(data, self.array)[self.index].reshape(3, 3))


@dataclass(frozen=True, eq=False)
class RotationVector:
    """A component of the rotation vector that leads a ball or free joint from its quaternion at the reference configuration.

    address: of the joint's quaternion in qpos. q0 (4,): that quaternion at the reference configuration.
    """

    address: int
    component: int
    q0: Array
    stage: Stage = "state"
    unit: str = "rad"
    period: float = 0.0

    def value(self, data: mujoco.MjData) -> float:
        return float(self._vector(data)[self.component])

    def kink(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        if math.pi - float(np.linalg.norm(self._vector(data))) < NEAREST:
            return "has turned by half a turn from the reference configuration, where the rotation vector changes sign"
        return ""

    def _vector(self, data: mujoco.MjData) -> Array:
        vector = np.empty(3)
        mujoco.mju_subQuat(vector, data.qpos[self.address : self.address + 4], self.q0)
        return vector


@dataclass(frozen=True)
class Distance:
    """The distance [m] between two sites."""

    first: int
    second: int
    stage: Stage = "position"
    unit: str = "m"
    period: float = 0.0

    def value(self, data: mujoco.MjData) -> float:
        return math.dist(data.site_xpos[self.first], data.site_xpos[self.second])

    def kink(self, model: mujoco.MjModel, data: mujoco.MjData) -> str:
        if self.value(data) <= NEAREST * float(model.stat.extent):
            return "is 0, where a distance has a kink"
        return ""


@dataclass(frozen=True, eq=False)
class Readings:
    """Named readings, in their order."""

    channels: Channels
    readings: tuple[Reading, ...]

    def values(self, data: mujoco.MjData) -> Array:
        """Their values (k,) from data that are up to date (after mj_forward)."""
        return np.array([reading.value(data) for reading in self.readings])

    def require_smooth(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        """Raises PlantError, with the reason, for readings that have no derivative at the configuration of `data`."""
        for name, reading in zip(self.channels.names, self.readings, strict=True):
            reason = reading.kink(model, data)
            if reason:
                raise PlantError(
                    f"output {name!r} {reason}, so it has no linear model there; choose another output or operating point"
                    " (the reference configuration is Plant.from_xml's keyframe, or without one the model's qpos0)"
                )
