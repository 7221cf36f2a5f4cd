"""Inputs that are polynomials of time, evaluated inside MuJoCo's pipeline at each stage of a step."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array, Indices
from invtrack.plant.native.controls import controls
from invtrack.plant.native.layout import data_time
from invtrack.plant.native.pointers import callback, floats, integers, matrix, records

_POLYNOMIALS = np.dtype([(name, np.int64) for name in ("time", "ctrl", "size", "inputs", "m", "powers", "count", "length")])
"""Where the time stands; the controls, and how many; which of them are written, and how many; coefficients, how many; duration."""

_polynomials_at = records(_POLYNOMIALS)


@callback("polynomials")
def _write(polynomials: int) -> None:
    own = _polynomials_at(polynomials, 1)[0]
    share = floats(own.time, 1)[0] / floats(own.length, 1)[0]
    powers, ctrl, inputs = matrix(own.powers, own.count, own.m), floats(own.ctrl, own.size), integers(own.inputs, own.m)
    for i in range(own.m):
        value = powers[own.count - 1, i]
        for k in range(own.count - 2, -1, -1):
            value = value * share + powers[k, i]
        ctrl[inputs[i]] = value


@dataclass(frozen=True, eq=False)
class PolynomialInputs:
    """u_i = sum_k powers[k, i] (time / length)^k, in these data from the time 0 on.

    Args:
        data: whose `ctrl` they are written to.
        inputs: where in it (m,).
        count: s, of the powers.
    """

    data: mujoco.MjData
    inputs: Indices
    count: int
    _powers: Array = field(init=False, repr=False)
    _length: Array = field(init=False, repr=False)
    _kept: tuple[NDArray[np.void], Indices] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        """Write the record that the compiled code reads."""
        inputs, record = np.array(self.inputs, dtype=np.int64), np.zeros(1, dtype=_POLYNOMIALS)
        powers, length = np.zeros((self.count, len(inputs))), np.ones(1)
        record["time"] = self.data._address + data_time()
        record["ctrl"], record["size"] = self.data.ctrl.ctypes.data, len(self.data.ctrl)
        record["inputs"], record["m"], record["count"] = inputs.ctypes.data, len(inputs), self.count
        record["powers"], record["length"] = powers.ctypes.data, length.ctypes.data
        for name, value in (("_powers", powers), ("_length", length), ("_kept", (record, inputs))):
            object.__setattr__(self, name, value)

    @contextmanager
    def acting(self) -> Iterator[None]:
        """A block in which MuJoCo, whenever it evaluates these data, has their inputs written."""
        with controls(self.data, _write.address, int(self._kept[0].ctypes.data)):
            yield

    def begin(self, powers: Array, length: float) -> None:
        """Go on with these coefficients (s, m), lowest power first, over a length of time [s], from the time 0 on."""
        self._powers[:], self._length[0], self.data.time = powers, length, 0.0
