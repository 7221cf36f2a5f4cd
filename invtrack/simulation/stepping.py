"""The loops that take the steps of a run, and what they write down."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from invtrack.arrays import Array, Indices
from invtrack.control.protocol import Law
from invtrack.plant.mujoco_warnings import mujoco_warnings
from invtrack.simulation.acting_limits import ActingLimit, Stretches
from invtrack.simulation.grid import Grid
from invtrack.simulation.native.law import Calls, put_law
from invtrack.simulation.native.record import RunMemory
from invtrack.simulation.simulated_plant import SensorChain, SimulatedPlant, Stepper

Progress = Callable[[float], object]

CHUNK = 8192
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
        plant, stepper: the plant, and what takes its steps in this run.
        law, grid: the control law and the N steps.
        update: number of the update in force in each step (N,).
        changes: new values of parameters, by the number of the grid's edge at which they change.
        sensors: what lies between the plant's measurements and the law; None where the law is given the state.
    """

    plant: SimulatedPlant
    stepper: Stepper
    law: Law
    grid: Grid
    update: Indices
    changes: dict[int, dict[str, float]]
    sensors: SensorChain | None

    def go(self, *, at_stages: bool, progress: Progress | None) -> Recorded:
        """Take all steps, or as many as the integration lasts."""
        from invtrack.simulation.native.loop import refresh_all  # loads numba, for which nothing waits before a run

        stepper, total = self.stepper, self.grid.n_steps
        memory = RunMemory()
        calls = Calls(memory)
        n, p, m = len(self.plant.states), len(self.plant.inputs), 0 if self.sensors is None else len(stepper.measurement_columns)
        raw, seen = np.empty((total + 1, stepper.width)), np.empty((total + 1, stepper.n_values))
        u, applied = np.empty((total, p)), np.empty((total, p))
        measured, estimate = np.empty((total, m)), np.empty((total, n if m else 0))
        memory.put(n=n, p=p, width=stepper.width, n_values=stepper.n_values, at_stages=int(at_stages), latest=-1)
        memory.put(raw=raw, seen=seen, commanded=u, measured=measured, estimates=estimate)
        memory.put(first_step=self.grid.first_step, lengths=self.grid.step, edges=self.grid.edges, times=self.grid.time)
        memory.put(update=self.update)
        stepper.bind(memory, calls, self.grid)
        put_law(memory, calls, self.law, stepper.origins, n=n, p=p, m=m)
        if self.sensors is not None:
            self.sensors.bind(memory, stepper.measurement_columns)
        acting: dict[ActingLimit, list[Stretches]] = {}

        def review(first: int, done: int) -> None:
            """See what the actuators passed on of the inputs of steps just taken."""
            applied[first:done], excess = stepper.passed_on(raw[first : done + 1], u[first:done])
            for limit, beyond in zip(stepper.limits, excess.T, strict=True):
                if np.any(beyond):
                    acting.setdefault(limit, []).append(Stretches.of_excess(beyond, first=first))

        # Until the check at a chunk's end sees it, a diverging run may compute with infinities.
        with mujoco_warnings() as texts, np.errstate(all="ignore"):
            with stepper.running(memory, at_stages=at_stages):
                done = self._take_steps(memory, calls, review, progress)
                refresh_all(memory.record)
                seen[done] = memory.array("values")
            x = stepper.deviations(raw[: done + 1])
        y = seen[: done + 1, stepper.output_columns]
        held = (u[:done], applied[:done], measured[:done], estimate[:done])
        spans = {**stepper.constrained(done), **{limit: Stretches.joined(found) for limit, found in acting.items()}}
        recorded = Recorded(x, stepper.positions(raw[: done + 1]), y, *held, spans, "")
        return _kept(recorded, texts)

    def _take_steps(self, memory: RunMemory, calls: Calls, review: Callable[[int, int], None], progress: Progress | None) -> int:
        """In chunks that are reviewed, none of which reaches beyond a change of parameters; returns the number of steps taken."""
        from invtrack.simulation.native.loop import take_steps, write_state

        grid, stepper, done = self.grid, self.stepper, 0
        changing = {int(grid.first_step[edge]): parameters for edge, parameters in self.changes.items()}
        ends = [*sorted(step for step in changing if step > 0), grid.n_steps]
        stepper.begin(float(grid.step[0]), float(grid.edges[0]))
        for end in ends:
            if done in changing:
                stepper.change(changing[done])
            while done < end:
                last = min(done + CHUNK, end)
                if self.sensors is not None:
                    before = self.update[done - 1] if done else -1
                    self.sensors.prepare(memory, int(np.count_nonzero(np.diff(self.update[done:last], prepend=before))))
                take_steps(memory.record, done, last)
                calls.raise_failure()
                write_state(memory.record, last)
                review(done, last)
                done = last
                if stepper.failed():
                    return done
                if progress is not None:
                    progress(done / grid.n_steps)
        return done


def _kept(record: Recorded, texts: Sequence[str]) -> Recorded:
    """What was recorded, up to the last state and input within what MuJoCo integrates; its other warnings are passed on."""
    if all(np.max(np.abs(values), initial=0.0) < LARGEST for values in (record.x, record.u)):  # NaN compares false
        for text in texts:
            warnings.warn(f"MuJoCo: {text}", RuntimeWarning, stacklevel=4)
        return record
    good = np.all(np.abs(record.x) < LARGEST, axis=1)
    good[1:] &= np.all(np.abs(record.u) < LARGEST, axis=1)  # MuJoCo replaces such an input by zero
    cause = f"MuJoCo reports: {texts[0]}" if texts else f"a state or input exceeds {LARGEST:.0e}"
    return record.cut(max(int(np.argmin(good)) - 1, 0), cause)
