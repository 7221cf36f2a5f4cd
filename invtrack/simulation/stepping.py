"""The loops that take the steps of a run, and what they write down."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.control.protocol import AffineLaw, Law
from invtrack.plant.couplings import mujoco_warnings
from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.grid import Grid
from invtrack.simulation.simulated_plant import SensorChain, StageInput, Stepper

Progress = Callable[[float], object]
Parts = list[tuple[Array, Array]]  # columns of the record, each with the live array that is written there

CHECK_EVERY = 512
"""Steps between two looks for divergence (and two reports of progress)."""

LARGEST = 1e10
"""Beyond this (MuJoCo's mjMAXVAL) a state or an input counts as diverged."""


@dataclass(frozen=True, eq=False)
class Recorded:
    """What a run wrote down over M <= N steps.

    Args:
        x, qpos, y: states (M + 1, n), positions (M + 1, nq) and outputs (M + 1, p).
        u, applied: commanded input and what is left of it after the actuators' limits (M, p).
        measured, estimate: what the sensors showed at the latest update (M, m), and the state estimated from it (M, n); both
            without columns where the controller knows the state.
        acting: the steps in which limits acted.
        cause: why the run ended early; empty where it did not.
    """

    x: Array
    qpos: Array
    y: Array
    u: Array
    applied: Array
    measured: Array
    estimate: Array
    acting: dict[ActingLimit, Stretches]
    cause: str

    def cut(self, steps: int, cause: str) -> Recorded:
        """The first steps only."""
        nodes = slice(steps + 1)
        held = (self.u[:steps], self.applied[:steps], self.measured[:steps], self.estimate[:steps])
        acting = {limit: spans.until(steps) for limit, spans in self.acting.items()}
        return Recorded(self.x[nodes], self.qpos[nodes], self.y[nodes], *held, acting, cause)


@dataclass(frozen=True, eq=False)
class Run:
    """One run of a plant under a law, ready to go.

    Args:
        stepper, law, grid: the plant, the control law and the N steps.
        update: number of the update in force in each step (N,).
        changes: new values of parameters, by the number of the grid's edge at which they change.
        measures: what the law's updates are given, the state or what the sensors show.
        sensors: what lies between the plant's measurements and the law.
    """

    stepper: Stepper
    law: Law
    grid: Grid
    update: Indices
    changes: dict[int, dict[str, float]]
    measures: Literal["state", "sensors"]
    sensors: SensorChain

    def go(self, *, at_stages: bool, progress: Progress | None) -> Recorded:
        """Take all steps, or as many as the integration lasts."""
        total, stepper = self.grid.n_steps, self.stepper
        width, p = sum(part.size for part in stepper.state), stepper.control.size
        rows = np.empty((total + 1, width + p))  # room for an affine law's offsets beside the raw states
        raw = rows[:, :width]
        seen = np.empty((total + 1, stepper.sensors.size))
        u, applied = np.empty((total, p)), np.empty((total, p))
        acting: dict[ActingLimit, list[Stretches]] = {}
        parts = self._parts(raw)
        with_sensors = self.measures == "sensors"
        measured = np.empty((total, stepper.measurement_columns.size if with_sensors else 0))
        estimate = np.empty((total, stepper.deviations(raw[:1]).shape[1] if with_sensors else 0))

        def review(steps: range) -> None:
            """See, chunk by chunk, what the actuators passed on of the inputs of steps just taken."""
            rows = slice(steps.start, steps.stop)
            applied[rows], excess = stepper.passed_on(raw[rows], u[rows])
            for limit, beyond in zip(stepper.limits, excess.T, strict=True):
                if np.any(beyond):
                    acting.setdefault(limit, []).append(Stretches.of_excess(beyond, first=steps.start))

        # Until the check at a chunk's end sees it, a diverging run may compute with infinities.
        with mujoco_warnings() as texts, np.errstate(all="ignore"):
            if at_stages:
                with stepper.stages(self.law) as stage_input:
                    done = self._take_steps(lambda steps: self._at_stages(stage_input, steps, parts, seen, u), review, progress)
            elif with_sensors:
                done = self._take_steps(
                    lambda steps: self._sensor_feedback(steps, parts, seen, u, measured, estimate), review, progress
                )
            elif isinstance(self.law, AffineLaw) and len(self.law.offset) == total and stepper.raw_is_deviation:
                rows[:-1, width:] = self.law.offset
                law = self.law
                done = self._take_steps(lambda steps: self._affine_feedback(law, steps, rows, parts, seen, u), review, progress)
            else:
                done = self._take_steps(lambda steps: self._state_feedback(steps, raw, parts, seen, u), review, progress)
            for target, part in parts:
                target[done] = part
            stepper.refresh()
            seen[done] = stepper.sensors
            x = stepper.deviations(raw[: done + 1])
        y = seen[: done + 1, stepper.output_columns]
        held = (u[:done], applied[:done], measured[:done], estimate[:done])
        spans = {**stepper.constrained(), **{limit: Stretches.joined(found) for limit, found in acting.items()}}
        recorded = Recorded(x, stepper.positions(raw[: done + 1]), y, *held, spans, "")
        return _kept(recorded, texts)

    def _take_steps(self, take: Callable[[range], None], review: Callable[[range], None], progress: Progress | None) -> int:
        """Interval by interval, in chunks that are reviewed; returns the number of steps taken."""
        grid, done = self.grid, 0
        for k, step in enumerate(grid.step):
            self.stepper.enter(float(step), float(grid.edges[k]), self.changes.get(k, {}))
            last = int(grid.first_step[k + 1])
            while done < last:
                chunk = range(done, min(done + CHECK_EVERY, last))
                take(chunk)
                review(chunk)
                done = chunk.stop
                if self.stepper.failed():
                    return done
                if progress is not None:
                    progress(done / grid.n_steps)
        return done

    def _parts(self, raw: Array) -> Parts:
        """Columns of the raw record, each with the live array that is written there."""
        ends = np.cumsum([0, *(part.size for part in self.stepper.state)])
        return [(raw[:, a:b], part) for a, b, part in zip(ends[:-1], ends[1:], self.stepper.state, strict=True)]

    def _affine_feedback(self, law: AffineLaw, steps: range, rows: Array, parts: Parts, seen: Array, commanded: Array) -> None:
        """The loop that sets the speed of a simulation: rows are [x, offset], and the gain is one and the same over a chunk."""
        control, sensors, advance = self.stepper.control, self.stepper.sensors, self.stepper.advance
        input_of = law.row_gain(steps.start).dot
        for i in steps:
            for target, part in parts:
                target[i] = part
            u = input_of(rows[i])
            commanded[i] = u
            control[:] = u
            advance()
            seen[i] = sensors

    def _state_feedback(self, steps: range, raw: Array, parts: Parts, seen: Array, commanded: Array) -> None:
        stepper, update = self.stepper, self.law.update
        control, sensors, advance = stepper.control, stepper.sensors, stepper.advance
        deviations = None if stepper.raw_is_deviation else stepper.deviations
        latest = int(self.update[steps.start - 1]) if steps.start else -1
        u = commanded[steps.start - 1]
        for i, number in zip(steps, self.update[steps.start : steps.stop].tolist(), strict=True):
            for target, part in parts:
                target[i] = part
            if number != latest:
                u = update(number, raw[i] if deviations is None else deviations(raw[i : i + 1])[0])
                latest = number
            commanded[i] = u
            control[:] = u
            advance()
            seen[i] = sensors

    def _sensor_feedback(self, steps: range, parts: Parts, seen: Array, commanded: Array, measured: Array, estimate: Array) -> None:
        stepper, columns = self.stepper, self.stepper.measurement_columns
        latest = int(self.update[steps.start - 1]) if steps.start else -1
        for i, number in zip(steps, self.update[steps.start : steps.stop].tolist(), strict=True):
            for target, part in parts:
                target[i] = part
            if number != latest:
                stepper.refresh()
                seen[i] = stepper.sensors
                measured[i] = self.sensors.sample(i, self.grid.time, seen, columns)
                commanded[i] = self.law.update(number, measured[i])
                estimate[i] = self.law.estimate
                latest = number
            else:
                commanded[i], measured[i], estimate[i] = commanded[i - 1], measured[i - 1], estimate[i - 1]
            stepper.control[:] = commanded[i]
            stepper.advance()
            seen[i] = stepper.sensors

    def _at_stages(self, stage_input: StageInput, steps: range, parts: Parts, seen: Array, commanded: Array) -> None:
        sensors = self.stepper.sensors
        for i in steps:
            for target, part in parts:
                target[i] = part
            commanded[i] = stage_input.step(i)
            seen[i] = sensors


def _kept(record: Recorded, texts: Sequence[str]) -> Recorded:
    """What was recorded, up to the last state and input within what MuJoCo integrates; its other warnings are passed on."""
    good = np.all(np.abs(record.x) < LARGEST, axis=1)  # NaN compares false
    good[1:] &= np.all(np.abs(record.u) < LARGEST, axis=1)  # MuJoCo replaces such an input by zero
    if good.all():
        for text in texts:
            warnings.warn(f"MuJoCo: {text}", RuntimeWarning, stacklevel=4)
        return record
    cause = f"MuJoCo reports: {texts[0]}" if texts else f"a state or input exceeds {LARGEST:.0e}"
    return record.cut(max(int(np.argmin(good)) - 1, 0), cause)
