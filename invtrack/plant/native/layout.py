"""Where fields stand in MuJoCo's structs, found by looking for values that are known to be there.

The structs differ between versions, and the package `mujoco` hands out arrays and numbers but not where they are kept. So data are
given values that stand nowhere else, and the memory of the struct is searched for them.
"""

from __future__ import annotations

import ctypes
from functools import cache

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.errors import PlantError

_BLOCK = 1 << 12
"""Words that are searched at a time."""

_NEIGHBOURS = 64
"""So many words, fewer than there are in mjData after what is looked for, are searched for a later field with the same pointer."""

_STRUCT_WORDS = 1 << 17
"""A struct of MuJoCo that has not shown what it must hold within so many words is not what this module takes it for."""

_MARK = 1.2345e-77
"""A time that nothing else has."""

_SCENE = (
    '<mujoco><worldbody><geom type="plane" size="9 9 1"/>'
    + "".join(
        f'<body pos="{2 * i} 0 0.09"><joint type="slide" axis="0 0 1"/><geom size="0.1"/></body>'
        f'<body pos="{2 * i} 4 4"><joint type="slide" axis="1 0 0" limited="true" range="0 1"/><geom size="0.1"/></body>'
        for i in range(5)
    )
    + "</worldbody></mujoco>"
)


@cache
def data_pointer(name: str) -> int:
    """Offset [bytes] in mjData of the pointer to one of its arrays, such as "qvel"."""
    _, data = _scene()
    return _offset_of_pointer(data._address, getattr(data, name).ctypes.data, f"mjData.{name}")


@cache
def data_time() -> int:
    """Offset [bytes] in mjData of the time."""
    _, data = _scene()
    data.time = _MARK
    return _offset_of_mark(data._address, data_pointer("qpos"), "mjData.time")


@cache
def model_timestep() -> int:
    """Offset [bytes] in mjModel of the length of a time step."""
    model, _ = _scene()
    model.opt.timestep = _MARK
    end = _offset_of_pointer(model._address, model.qpos0.ctypes.data, "mjModel.qpos0")
    return _offset_of_mark(model._address, end, "mjModel.opt.timestep")


@cache
def data_count(name: str) -> int:
    """Offset [bytes] in mjData of one of its counts of constraints, "ncon" or "nl"."""
    model, data = _scene()
    end = data_pointer("qpos")
    memory = np.ctypeslib.as_array((ctypes.c_int32 * (end // 4)).from_address(data._address))
    alike = np.ones(len(memory), dtype=bool)
    for contacts, limits in ((5, 4), (2, 1), (3, 0), (1, 3)):  # what is largest so far, which mjData keeps too, does not follow
        data.qpos[0::2] = np.where(np.arange(5) < contacts, 0.0, 1.0)
        data.qpos[1::2] = np.where(np.arange(5) < limits, -0.1, 0.5)
        mujoco.mj_forward(model, data)
        alike &= memory == getattr(data, name)
    return 4 * _only(np.flatnonzero(alike), f"mjData.{name}")


def _scene() -> tuple[mujoco.MjModel, mujoco.MjData]:
    model = mujoco.MjModel.from_xml_string(_SCENE)
    return model, mujoco.MjData(model)


def _offset_of_pointer(struct: int, target: int, what: str) -> int:
    for block in range(0, _STRUCT_WORDS, _BLOCK):  # block by block: nothing is read far beyond what is looked for
        found = np.flatnonzero(_words(struct + 8 * block, _BLOCK) == target)
        if len(found):
            # Arrays without entries have the address of the one that comes after them, in the struct too.
            first = block + int(found[0])
            return 8 * (first + int(np.flatnonzero(_words(struct + 8 * first, _NEIGHBOURS) == target)[-1]))
    raise _unknown(what)


def _words(address: int, count: int) -> NDArray[np.int64]:
    return np.ctypeslib.as_array((ctypes.c_int64 * count).from_address(address))


def _offset_of_mark(struct: int, end: int, what: str) -> int:
    words = np.ctypeslib.as_array((ctypes.c_double * (end // 8)).from_address(struct))
    return 8 * _only(np.flatnonzero(words == _MARK), what)


def _only(found: NDArray[np.intp], what: str) -> int:
    if len(found) != 1:
        raise _unknown(what)
    return int(found[0])


def _unknown(what: str) -> PlantError:
    return PlantError(
        f"{what} was not found in the memory of MuJoCo {mujoco.__version__}, whose structs are laid out in a way that invtrack "
        "does not know; use another version of mujoco"
    )
