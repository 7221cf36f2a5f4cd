"""Outputs of MuJoCo's data while it is being stepped."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from invtrack.arrays import Array
from invtrack.plant.readings import Entry, Reading


class LiveReadings:
    """Readings of data that are being stepped, at each step's start, in memory that a loop reads.

    MuJoCo leaves sensordata at their values at the step's start, and everything else somewhere beyond it: so the others are read
    before the step. Angles go on from their last value, over any number of turns. Where all of them are sensors, `values` is a
    view of sensordata and nothing need be copied.

    values (k,): those of `readings[columns[i]]` stand at i. columns: where each reading stands in `values`.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, readings: Sequence[Reading]) -> None:
        self._model, self._data = model, data
        sensed = [reading.index for reading in readings if isinstance(reading, Entry) and reading.stage == "sensor"]
        addresses = np.array(sensed, dtype=np.intp)
        self._early = [(i, reading) for i, reading in enumerate(readings) if reading.stage != "sensor"]
        self._late, self._addresses = np.flatnonzero([reading.stage == "sensor" for reading in readings]), addresses
        self._stages = {reading.stage for reading in readings}
        self.columns = np.arange(len(readings), dtype=np.intp)
        if self._early:
            self.values: Array = np.zeros(len(readings))
        else:
            first, last = int(addresses.min()), int(addresses.max())
            self.values = data.sensordata[first : last + 1]
            self.columns = addresses - first

    def around(self, step: Callable[[], None]) -> Callable[[], None]:
        """The step, with `values` brought up to its start."""
        if not self._early:
            return step
        prepared, early = self._preparation(), self._read_early

        def stepped() -> None:
            prepared()
            early()
            step()
            self._read_sensors()

        return stepped

    def read(self) -> None:
        """Bring `values` up to data that are up to date (after mj_forward)."""
        if self._early:
            self._read_early()
            self._read_sensors()

    def _read_early(self) -> None:
        for i, reading in self._early:
            value = reading.value(self._data)
            behind = self.values[i] - value
            if reading.period and abs(behind) > reading.period / 2:  # not so for NaN, when a run diverges
                value += reading.period * round(behind / reading.period)
            self.values[i] = value

    def _read_sensors(self) -> None:
        if len(self._late):
            self.values[self._late] = self._data.sensordata[self._addresses]

    def _preparation(self) -> Callable[[], None]:
        """What brings the places, and the tendons where they are read, up to the state."""
        model, data, stages = self._model, self._data, self._stages

        def prepared() -> None:
            if stages & {"position", "tendon"}:
                mujoco.mj_kinematics(model, data)
            if "tendon" in stages:
                mujoco.mj_tendon(model, data)

        return prepared
