"""Runs that are known in closed form: two vibration modes of stated amplitude, an input that grows exponentially before t = 0."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from invtrack.channels import Channels
from invtrack.results.result import Event, RunResult, Signal

Array = NDArray[np.float64]

MANOEUVRE = (0.0, 4.0)
JUMP = 1.5
SLEW = 2.0
GROWTH_RATE = 2.0  # of the input before the manoeuvre, exp(GROWTH_RATE t)
PEAK_INPUT = 40.0
VIBRATION_PERIOD = 2.0


@dataclass(frozen=True)
class TwoModes:
    """y - y_d = slow * sin(pi t) + fast * sin(3 pi t) over the whole run."""

    slow: float = 1e-3
    fast: float = 0.0

    def error(self, time: Array) -> Array:
        return self.slow * np.sin(np.pi * time) + self.fast * np.sin(3 * np.pi * time)


def grid(start: float, end: float, *, timestep: float) -> Array:
    """Times that meet the jump and both ends of the manoeuvre, each interval divided evenly."""
    corners = sorted({start, end, *(t for t in (*MANOEUVRE, JUMP) if start < t < end)})
    parts = [np.linspace(a, b, int(np.ceil((b - a) / timestep)) + 1)[:-1] for a, b in pairwise(corners)]
    return np.concatenate([*parts, [end]])


def slew(time: Array) -> Array:
    """A smooth slew from 0 to SLEW over the manoeuvre."""
    phase = np.clip((time - MANOEUVRE[0]) / (MANOEUVRE[1] - MANOEUVRE[0]), 0, 1)
    return SLEW * (phase - np.sin(2 * np.pi * phase) / (2 * np.pi))


def input_force(time: Array) -> Array:
    """exp(GROWTH_RATE t) before the manoeuvre, a bump that reaches PEAK_INPUT at its middle, an exponential decay after it."""
    start, end = MANOEUVRE
    bump = 1 + (PEAK_INPUT - 1) * np.sin(np.pi * (time - start) / (end - start)) ** 2
    before, after = np.exp(GROWTH_RATE * np.minimum(time - start, 0)), np.exp(-np.maximum(time - end, 0))
    return np.where(time < start, before, np.where(time > end, after, bump))


def two_mode_run(
    name: str = "exact",
    *,
    modes: TwoModes | None = None,
    start: float = -6.0,
    end: float = 16.0,
    timestep: float = 0.01,
    tip_masses: tuple[float, float] = (0.0, 100.0),
) -> RunResult:
    """A completed run of a tip (the output) and a base, whose tip mass changes at JUMP."""
    time = grid(start, end, timestep=timestep)
    middle = (time[:-1] + time[1:]) / 2
    y_d, force = slew(time), input_force(middle)
    error = (modes or TwoModes()).error(time)
    base = slew(time + 0.4)
    wanted = np.column_stack([y_d, base, np.gradient(y_d, time), np.gradient(base, time)])
    deviation = np.column_stack([error, -0.5 * error, np.gradient(error, time), np.zeros_like(error)])
    states = Channels(("tip", "base", "tip_velocity", "base_velocity"), ("m", "m", "m/s", "m/s"))
    tip, base_force = Channels(("tip_position",), ("m",)), Channels(("base_force",), ("N",))
    mass = np.where(middle < JUMP, *tip_masses)[:, None]
    output, planned = Signal((y_d + error)[:, None], tip), Signal(y_d[:, None], tip)
    return RunResult(
        name=name,
        model="two_mode",
        time=time,
        state=Signal(wanted + deviation, states),
        state_reference=Signal(wanted, states),
        output=output,
        reference=planned,
        planned_output=planned,
        commanded=Signal(force[:, None], base_force),
        applied=Signal(force[:, None], base_force),
        parameters=Signal(mass, Channels(("tip_mass",), ("kg",))),
        manoeuvre=MANOEUVRE,
        rest_inputs=np.zeros((2, 1)),
        timestep=timestep,
        evaluate="held",
        integrator="RK4",
        vibration_period=VIBRATION_PERIOD,
        events=(Event(0.0, "manoeuvre", "start"), Event(JUMP, "parameter", "tip_mass = 100 kg"), Event(4.0, "manoeuvre", "end")),
    )


def diverged(result: RunResult, *, at: float, amplitude: float = 1e200) -> RunResult:
    """The same run, its output and input at `amplitude` from the time `at` on and not finite one step later, where it stops."""
    stop = int(np.searchsorted(result.time, at)) + 1
    output, applied = result.output.values[: stop + 1].copy(), result.applied.values[:stop].copy()
    output[-2], output[-1], applied[-1] = amplitude, np.inf, amplitude

    def cut(signal: Signal, count: int) -> Signal:
        return replace(signal, values=signal.values[:count])

    return replace(
        result,
        time=result.time[: stop + 1],
        state=cut(result.state, stop + 1),
        state_reference=cut(result.state_reference, stop + 1),
        output=replace(result.output, values=output),
        reference=cut(result.reference, stop + 1),
        planned_output=cut(result.planned_output, stop + 1),
        commanded=cut(result.commanded, stop),
        applied=replace(result.applied, values=applied),
        parameters=cut(result.parameters, stop),
        status="diverged",
        message=f"state is not finite at t = {result.time[stop]:.6g} s",
    )
