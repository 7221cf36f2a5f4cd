"""Between MuJoCo's coordinates (qpos, qvel, act) and the state x of a linear model about an operating point.

The state lives in the tangent space of the operating point x0 = (qpos0, qvel0, act0):

    x = (qpos - qpos0, qvel - qvel0, act - act0),    n = 2 nv + na,

where the first difference is the velocity (nv,) that leads from qpos0 to qpos in one unit of time. For slides and hinges that is
the plain difference; for the quaternion of a ball or free joint it is the rotation vector [rad] in the body's frame at qpos0.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from invtrack.arguments import by_name, require_text
from invtrack.arrays import Array, real_numbers, shown
from invtrack.errors import PlantError
from invtrack.plant.elements import element_id


def state_of(model: mujoco.MjModel, x0: Array, qpos: ArrayLike, qvel: ArrayLike, act: ArrayLike = ()) -> Array:
    """The state x (2 nv + na,) of a configuration, as deviation from the operating point.

    Rotations of ball and free joints are exact up to half a turn from x0; beyond it the shorter way round is taken.

    Args:
        model: the MuJoCo model.
        x0: the operating point (nq + nv + na,).
        qpos, qvel, act: the configuration, (nq,), (nv,) and (na,).

    Raises PlantError where a length does not fit the model.
    """
    qpos0, qvel0, act0 = split(model, x0)
    qpos, qvel, act = (
        _vector(name, value, size)
        for name, value, size in (("qpos", qpos, model.nq), ("qvel", qvel, model.nv), ("act", act, model.na))
    )
    displacement = np.zeros(model.nv)
    mujoco.mj_differentiatePos(model, displacement, 1.0, qpos0, qpos)
    return np.concatenate([displacement, qvel - qvel0, act - act0])


def configuration_of(model: mujoco.MjModel, x0: Array, x: ArrayLike) -> tuple[Array, Array, Array]:
    """The configuration (qpos (nq,), qvel (nv,), act (na,)) of the state x (2 nv + na,): the inverse of `state_of`.

    Raises PlantError where a length does not fit the model.
    """
    qpos, qvel0, act0 = split(model, x0)
    x = _vector("x", x, 2 * model.nv + model.na)
    mujoco.mj_integratePos(model, qpos, x[: model.nv], 1.0)
    return qpos, qvel0 + x[model.nv : 2 * model.nv], act0 + x[2 * model.nv :]


def split(model: mujoco.MjModel, x0: ArrayLike) -> tuple[Array, Array, Array]:
    """Copies of the parts (qpos (nq,), qvel (nv,), act (na,)) of an operating point's x0."""
    x0 = _vector("x0 = (qpos, qvel, act)", x0, model.nq + model.nv + model.na)
    qpos, qvel, act = np.split(x0, [model.nq, model.nq + model.nv])
    return qpos.copy(), qvel.copy(), act.copy()


def tangent_units(model: mujoco.MjModel) -> list[str]:
    """Unit, "m" or "rad", of each of the nv degrees of freedom, whatever units the user calls them by."""
    units = []
    for joint in model.jnt_type:
        if joint == mujoco.mjtJoint.mjJNT_FREE:
            units += ["m"] * 3 + ["rad"] * 3
        elif joint == mujoco.mjtJoint.mjJNT_BALL:
            units += ["rad"] * 3
        else:
            units += ["m" if joint == mujoco.mjtJoint.mjJNT_SLIDE else "rad"]
    return units


def _vector(name: str, value: ArrayLike, size: int) -> Array:
    vector = real_numbers(name, value, error=PlantError)
    if vector.shape != (size,):
        raise PlantError(f"{name} has shape {vector.shape}, expected ({size},)")
    return vector


@dataclass(frozen=True, eq=False)
class Configuration:
    """An operating point in MuJoCo's own coordinates.

    Args:
        qpos, qvel, act, ctrl: positions (nq,), velocities (nv,), activations (na,) and controls (nu,).
        mocap_pos, mocap_quat: poses of the mocap bodies, (nmocap, 3) and (nmocap, 4).
    """

    qpos: Array
    qvel: Array
    act: Array
    ctrl: Array
    mocap_pos: Array
    mocap_quat: Array

    def __post_init__(self) -> None:
        for field in fields(self):
            getattr(self, field.name).setflags(write=False)

    @classmethod
    def of_model(cls, model: mujoco.MjModel, keyframe: str | None = None) -> Configuration:
        """The configuration of a named keyframe, or without one the file's: qpos0, at rest, all controls 0."""
        data = mujoco.MjData(model)
        if keyframe is not None:
            require_text("keyframe", keyframe, error=PlantError)
            mujoco.mj_resetDataKeyframe(model, data, element_id(model, "keyframe", keyframe))
        return cls(**{field.name: np.array(getattr(data, field.name)) for field in fields(cls)}).normalized(model)

    def replaced(self, model: mujoco.MjModel, **arrays: ArrayLike | Mapping[str, ArrayLike] | None) -> Configuration:
        """A copy with some arrays replaced (None keeps what is there), whole or by the names of joints and actuators.

        Raises PlantError for wrong sizes, entries that are not finite, and unknown names.
        """
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in arrays.items():
            if isinstance(value, Mapping):
                values[name] = _with_entries(model, name, values[name], value)
            elif value is not None:
                values[name] = _finite(name, value, values[name].shape)
        return Configuration(**values).normalized(model)

    def normalized(self, model: mujoco.MjModel) -> Configuration:
        """The same configuration with quaternions of length 1."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        qpos = np.array(self.qpos)
        mujoco.mj_normalizeQuat(model, qpos)
        return Configuration(**{**values, "qpos": qpos})

    def write(self, data: mujoco.MjData) -> None:
        """Put the configuration into MuJoCo's data."""
        for field in fields(self):
            getattr(data, field.name)[:] = getattr(self, field.name)

    @property
    def x0(self) -> Array:
        """(qpos, qvel, act) as one vector (nq + nv + na,), the x0 of an operating point."""
        return np.concatenate([self.qpos, self.qvel, self.act])


def _with_entries(model: mujoco.MjModel, name: str, present: Array, entries: Mapping[str, ArrayLike]) -> Array:
    """The array with the entries of named joints (qpos, qvel) or actuators (act, ctrl) replaced."""
    kind = "joint" if name in ("qpos", "qvel") else "actuator"
    entries = by_name(name, entries, expected=f"values by the names of {kind}s", error=PlantError)
    result = np.array(present)
    for element, value in entries.items():
        where = _entries_of(model, name, element_id(model, kind, element))
        shape = (where.stop - where.start,)
        number = real_numbers(f"{name} of {kind} {element!r}", value, error=PlantError)
        result[where] = _finite(f"{name} of {kind} {element!r}", number[np.newaxis] if number.ndim == 0 else number, shape)
    return result


def _entries_of(model: mujoco.MjModel, name: str, index: int) -> slice:
    """Where the entries of a joint or actuator stand."""
    if name in ("qpos", "qvel"):
        first, n = (model.jnt_qposadr, model.nq) if name == "qpos" else (model.jnt_dofadr, model.nv)
        return slice(int(first[index]), int(first[index + 1]) if index + 1 < model.njnt else int(n))
    if name == "act":
        first, count = int(model.actuator_actadr[index]), int(model.actuator_actnum[index])
        return slice(max(first, 0), max(first, 0) + count)
    first, count = int(model.actuator_ctrladr[index]), int(model.actuator_ctrlnum[index])
    return slice(first, first + count)


def _finite(name: str, value: ArrayLike, shape: tuple[int, ...]) -> Array:
    array = real_numbers(name, value, error=PlantError)
    if array.shape != shape or not np.all(np.isfinite(array)):
        raise PlantError(f"{name} must hold {math.prod(shape)} finite numbers, got {shown(value)}")
    return array
