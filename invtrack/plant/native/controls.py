"""Controls that are computed inside MuJoCo's pipeline, in each evaluation of the dynamics: its control callback, compiled."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco
import numpy as np

from invtrack.plant.native.pointers import call, callback, integers, registered, symbol
from invtrack.plant.native.slots import CONTROL

_table = symbol("invtrack_control_slots", CONTROL.address)


@callback("model", "data")
def _control(model: int, data: int) -> None:
    found = registered(_table(), data)
    if found != 0:
        pair = integers(found, 2)
        call(pair[0], (pair[1],))


CONTROL.serve(_control)


@contextmanager
def controls(data: mujoco.MjData, function: int, argument: int = 0) -> Iterator[None]:
    """A block in which MuJoCo, whenever it evaluates these data, has their controls written by a C function.

    Args:
        data: whose `ctrl` the function writes.
        function: the address of a C function (int64) -> void, such as that of an `invtrack.plant.native.pointers.callback`.
        argument: what it is called with.

    Raises PlantError as `invtrack.plant.native.slots.CallbackSlots.block` does.
    """
    pair = np.array([function, argument], dtype=np.int64)
    with CONTROL.block(data._address, int(pair.ctypes.data)):
        yield
