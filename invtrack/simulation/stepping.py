"""The loops that take the steps of a run, and what they write down."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from invtrack.control.protocol import Law
from invtrack.physics.callbacks import mujoco_warnings
from invtrack.simulation.grid import Grid
from invtrack.simulation.sensors import SensorChain
from invtrack.simulation.simulated_plant import StageInput, Stepper

Array = NDArray[np.float64]
Progress = Callable[[float], object]

CHECK_EVERY = 128
"""Steps between two looks for divergence (and two reports of progress)."""

LARGEST = 1e10
"""Beyond this (MuJoCo's mjMAXVAL) a state or an input counts as diverged."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a run wrote down over M <= N steps: x (M + 1, n), qpos (M + 1, nq), y (M + 1, p), commanded input u (M, p), what the
    sensors showed at the last update (M, m) and the state estimated from it (M, n), both without columns where the controller knows
    the state; and why the run ended early.
    """

    x: Array
    qpos: Array
    y: Array
    u: Array
    measured: Array
    estimate: Array
    cause: str

    def cut(self, steps: int, cause: str) -> Recorded:
        """The first steps only."""
        nodes = slice(steps + 1)
        held = (self.u[:steps], self.measured[:steps], self.estimate[:steps])
        return Recorded(self.x[nodes], self.qpos[nodes], self.y[nodes], *held, cause)


@dataclass(frozen=True, eq=False)
class Run:
    """One run: stepper, law and grid; update (N,) numbers the update in force in each step; changes: parameters by edge number."""

    stepper: Stepper
    law: Law
    grid: Grid
    update: NDArray[np.intp]
    changes: dict[int, dict[str, float]]
    measures: Literal["state", "sensors"]
    sensors: SensorChain

    def go(self, sizes: tuple[int, int, int], *, at_stages: bool, progress: Progress | None) -> Recorded:
        """Take all steps, or as many as the integration lasts. sizes: numbers of states n, inputs p and measurements m."""
        n, p, m = sizes
        total, known = self.grid.n_steps, self.measures == "state"
        record = Recorded(
            x=np.empty((total + 1, n)),
            qpos=np.empty((total + 1, self.stepper.n_positions)),
            y=np.empty((total + 1, p)),
            u=np.empty((total, p)),
            measured=np.empty((total, 0 if known else m)),
            estimate=np.empty((total, 0 if known else n)),
            cause="",
        )
        ideal = np.empty((total + 1, m))
        # Until the check at a chunk's end sees it, a diverging run may compute with infinities.
        with mujoco_warnings() as texts, np.errstate(all="ignore"):
            if at_stages:
                with self.stepper.stages(self.law) as stage_input:
                    done = self._take_steps(lambda steps: self._at_stages(stage_input, steps, record, ideal), progress)
            elif known:
                done = self._take_steps(lambda steps: self._state_feedback(steps, record, ideal), progress)
            else:
                done = self._take_steps(lambda steps: self._sensor_feedback(steps, record, ideal), progress)
            self.stepper.read(record.x[done], record.qpos[done])
            self.stepper.read_outputs(record.y[done], ideal[done])
        return _kept(record, done, texts)

    def _take_steps(self, take: Callable[[range], None], progress: Progress | None) -> int:
        """Interval by interval, in chunks; returns the number of steps taken."""
        grid, done = self.grid, 0
        for k, step in enumerate(grid.step):
            self.stepper.enter(float(step), float(grid.edges[k]), self.changes.get(k, {}))
            last = int(grid.first_step[k + 1])
            while done < last:
                chunk = range(done, min(done + CHECK_EVERY, last))
                take(chunk)
                done = chunk.stop
                if self.stepper.failed():
                    return done
                if progress is not None:
                    progress(done / grid.n_steps)
        return done

    def _state_feedback(self, steps: range, record: Recorded, ideal: Array) -> None:
        read, step, update = self.stepper.read, self.stepper.step, self.law.update
        x, qpos, y, commanded = record.x, record.qpos, record.y, record.u
        numbers = self.update[steps.start : steps.stop].tolist()
        latest = int(self.update[steps.start - 1]) if steps.start else -1
        u = commanded[steps.start - 1]
        for i, number in zip(steps, numbers, strict=True):
            state = x[i]
            read(state, qpos[i])
            if number != latest:
                u = update(number, state)
                latest = number
            commanded[i] = u
            step(u, y[i], ideal[i])

    def _sensor_feedback(self, steps: range, record: Recorded, ideal: Array) -> None:
        latest = int(self.update[steps.start - 1]) if steps.start else -1
        for i in steps:
            self.stepper.read(record.x[i], record.qpos[i])
            number = int(self.update[i])
            if number != latest:
                self.stepper.sense(ideal[i])
                record.measured[i] = self.sensors.sample(i, self.grid.time, ideal)
                record.u[i] = self.law.update(number, record.measured[i])
                record.estimate[i] = self.law.estimate
                latest = number
            else:
                record.measured[i], record.u[i], record.estimate[i] = (
                    record.measured[i - 1],
                    record.u[i - 1],
                    record.estimate[i - 1],
                )
            self.stepper.step(record.u[i], record.y[i], ideal[i])

    def _at_stages(self, stage_input: StageInput, steps: range, record: Recorded, ideal: Array) -> None:
        for i in steps:
            self.stepper.read(record.x[i], record.qpos[i])
            record.u[i] = stage_input.step(i, record.y[i], ideal[i])


def _kept(record: Recorded, done: int, texts: Sequence[str]) -> Recorded:
    """What was recorded, up to the last state and input within what MuJoCo integrates; its other warnings are passed on."""
    good = np.all(np.abs(record.x[: done + 1]) < LARGEST, axis=1)  # NaN compares false
    good[1:] &= np.all(np.abs(record.u[:done]) < LARGEST, axis=1)  # MuJoCo replaces such an input by zero
    if good.all():
        for text in texts:
            warnings.warn(f"MuJoCo: {text}", RuntimeWarning, stacklevel=4)
        return record.cut(done, "")
    cause = f"MuJoCo reports: {texts[0]}" if texts else f"a state or input exceeds {LARGEST:.0e}"
    return record.cut(max(int(np.argmin(good)) - 1, 0), cause)
