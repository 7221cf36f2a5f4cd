"""Readings of MuJoCo's data by compiled code: the same numbers as those of `invtrack.plant.readings`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from invtrack.plant.native.libmujoco import address_of
from invtrack.plant.native.pointers import address_in, call, compiled, floats
from invtrack.plant.readings import Attitude, Distance, Entry, Reading, RotationVector

READING = np.dtype(
    [(name, np.int64) for name in ("kind", "first", "second", "component", "column", "turn")] + [("period", np.float64)]
)
"""One reading: its kind, the addresses of what it reads and of what it compares that with, and where its value goes."""

_ENTRY, _DISTANCE, _ROTATION, _YAW, _PITCH, _ROLL = range(6)


@compiled
def value_of(reading: Any) -> float:
    """The reading's value now."""
    if reading.kind == _ENTRY:
        return floats(reading.first, 1)[0]  # type: ignore[no-any-return]
    if reading.kind == _DISTANCE:
        a, b = floats(reading.first, 3), floats(reading.second, 3)
        return math.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
    if reading.kind == _ROTATION:
        vector = np.empty(3)
        call(reading.turn, (address_in(vector), reading.first, reading.second))
        return vector[reading.component]  # type: ignore[no-any-return]
    now, reference = floats(reading.first, 9), floats(reading.second, 9)
    # Indices are variables: `_turned` is compiled once, not for each pair of constants.
    row, column, beside, there = 1, 0, 0, 0
    if reading.kind == _ROLL:
        row, column, beside, there = 2, 1, 2, 2
    elif reading.kind == _PITCH:
        row = 2
    sine, cosine = _turned(reference, now, row, column), _turned(reference, now, beside, there)
    if reading.kind == _PITCH:
        return math.atan2(-sine, math.hypot(cosine, _turned(reference, now, row - 1, column)))
    return math.atan2(sine, cosine)


@compiled
def _turned(reference: Any, now: Any, i: int, j: int) -> float:
    """Entry (i, j) of R0' R."""
    return reference[i] * now[j] + reference[3 + i] * now[3 + j] + reference[6 + i] * now[6 + j]  # type: ignore[no-any-return]


@compiled
def read(readings: Any, values: Any) -> None:
    """Bring `values` up to date; angles go on from their last value, over any number of turns."""
    for i in range(readings.shape[0]):
        reading = readings[i]
        value = value_of(reading)
        if reading.period > 0.0:
            behind = values[reading.column] - value
            if abs(behind) > reading.period / 2 and math.isfinite(behind):
                value += reading.period * round(behind / reading.period)
        values[reading.column] = value


def readings_of(
    data: mujoco.MjData, readings: Sequence[Reading], columns: Sequence[int]
) -> tuple[NDArray[np.void], list[NDArray[np.float64]]]:
    """The readings (k,) of one MjData as records, with their columns among the values, and what they refer to, to be kept alive."""
    table = np.zeros(len(readings), dtype=READING)
    kept: list[NDArray[np.float64]] = []
    for row, reading, column in zip(table, readings, columns, strict=True):
        row["column"], row["period"] = column, reading.period
        if isinstance(reading, Entry):
            array = getattr(data, reading.array)
            row["kind"] = _ENTRY
            row["first"] = array.ctypes.data + array.itemsize * int(np.ravel_multi_index(np.atleast_1d(reading.index), array.shape))
        elif isinstance(reading, Distance):
            row["kind"] = _DISTANCE
            row["first"], row["second"] = (data.site_xpos[site].ctypes.data for site in (reading.first, reading.second))
        elif isinstance(reading, RotationVector):
            reference = np.array(reading.q0, dtype=float)
            kept.append(reference)
            row["kind"], row["component"], row["turn"] = _ROTATION, reading.component, address_of("mju_subQuat")
            row["first"], row["second"] = data.qpos[reading.address :].ctypes.data, reference.ctypes.data
        elif isinstance(reading, Attitude):
            reference = np.ascontiguousarray(reading.R0, dtype=float)
            kept.append(reference)
            row["kind"] = {"yaw": _YAW, "pitch": _PITCH, "roll": _ROLL}[reading.angle]
            row["first"], row["second"] = getattr(data, reading.array)[reading.index].ctypes.data, reference.ctypes.data
        else:
            raise TypeError(f"no compiled reading for {type(reading).__name__}")
    return table, kept
