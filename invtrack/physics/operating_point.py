"""The configuration about which a plant is used: where it stands, how it moves, and what its actuators hold."""

from __future__ import annotations

from dataclasses import dataclass, fields

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from invtrack.errors import PlantError
from invtrack.physics.names import element_id

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Configuration:
    """qpos (nq,), qvel (nv,), act (na,), ctrl (nu,) and the poses of mocap bodies, in MuJoCo's own coordinates."""

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
            mujoco.mj_resetDataKeyframe(model, data, element_id(model, "keyframe", keyframe))
        return cls(**{field.name: np.array(getattr(data, field.name)) for field in fields(cls)}).normalized(model)

    def replaced(self, model: mujoco.MjModel, **arrays: ArrayLike | None) -> Configuration:
        """A copy with some arrays replaced (None keeps what is there). Raises PlantError for wrong sizes or non-finite entries."""
        values = {field.name: getattr(self, field.name) for field in fields(self)}
        for name, value in arrays.items():
            if value is None:
                continue
            array = np.array(value, dtype=float)
            if array.shape != values[name].shape or not np.all(np.isfinite(array)):
                raise PlantError(f"{name} must hold {values[name].size} finite numbers, got {value!r}")
            values[name] = array
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
