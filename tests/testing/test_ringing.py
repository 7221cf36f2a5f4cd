"""What rings, on signals whose frequencies, damping and amplitudes are known in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import invtrack
from invtrack.channels import Channels
from invtrack.results.result import Signal
from invtrack.testing import nearest_mode, oscillation
from tests.synthetic_runs import MANOEUVRE, TwoModes, two_mode_run


def run_with(error: np.ndarray, time: np.ndarray) -> invtrack.RunResult:
    """A run from the end of the manoeuvre on whose output is off by `error`, "tip" by the same and "base" by -0.5 of it."""
    run = two_mode_run()
    output = Signal(error[:, None], Channels(("y",), ("m",)))
    states = Channels(("tip", "base", "tip velocity"), ("m", "m", "m/s"))
    state = Signal(np.column_stack([error, -0.5 * error, np.gradient(error, time)]), states)
    zero = Signal(np.zeros_like(output.values), output.channels)
    at_rest = replace(state, values=np.zeros_like(state.values))
    return replace(run, time=time, output=output, reference=zero, planned_output=zero, state=state, state_reference=at_rest)


def decaying(time: np.ndarray, *, frequency: float, damping: float, amplitude: float, phase: float = 0.3) -> np.ndarray:
    """amplitude exp(-damping |s| t) cos(2 pi frequency t + phase), t from the end of the manoeuvre."""
    t, w_d = time - MANOEUVRE[1], 2 * np.pi * frequency
    return amplitude * np.exp(-damping / np.sqrt(1 - damping**2) * w_d * t) * np.cos(w_d * t + phase)


@pytest.mark.parametrize("frequency", [0.3, 3.0, 30.0, 120.0])
@pytest.mark.parametrize("damping", [0.0, 0.002, 0.05, 0.3])
def test_a_damped_sinusoid_is_read_off(frequency: float, damping: float) -> None:
    time = MANOEUVRE[1] + 1e-3 * np.arange(20_001)
    found = oscillation(run_with(decaying(time, frequency=frequency, damping=damping, amplitude=2e-3), time), "y")
    assert found is not None
    assert found.frequency == pytest.approx(frequency, rel=1e-6)
    assert found.damping == pytest.approx(damping, abs=1e-6)
    assert found.amplitude == pytest.approx(2e-3, rel=1e-5)
    assert found.share == pytest.approx(1.0, rel=0.05)
    assert dict(found.states) == pytest.approx({"tip [m]": 2e-3, "base [m]": 1e-3}, rel=1e-5)


def test_a_growing_one_has_negative_damping() -> None:
    time = MANOEUVRE[1] + 2e-3 * np.arange(5001)
    found = oscillation(run_with(decaying(time, frequency=1.2, damping=-0.01, amplitude=1e-6), time), "y")
    assert found is not None
    assert (found.frequency, found.damping) == (pytest.approx(1.2, rel=1e-6), pytest.approx(-0.01, rel=1e-4))


@pytest.mark.parametrize("unit", [1e-200, 1e-9, 1.0, 1e9, 1e200])
def test_the_stronger_of_two_counts_beside_an_offset_a_drift_and_noise(unit: float) -> None:
    time = MANOEUVRE[1] + 2e-3 * np.arange(15_001)
    strong = decaying(time, frequency=0.8, damping=0.01, amplitude=1.0)
    weak = decaying(time, frequency=7.0, damping=0.001, amplitude=0.1)
    drift = 0.3 + 0.5 * np.exp(-(time - time[0]) / 3)
    noise = 1e-3 * np.random.default_rng(0).standard_normal(len(time))
    found = oscillation(run_with(unit * (strong + weak + drift + noise), time), "y")
    assert found is not None
    assert found.frequency == pytest.approx(0.8, rel=1e-2)
    assert found.damping == pytest.approx(0.01, abs=2e-3)
    assert found.amplitude == pytest.approx(unit, rel=0.02)


def test_it_is_found_under_a_drift_ten_times_its_size() -> None:
    time = MANOEUVRE[1] + 2e-3 * np.arange(5001)
    error = decaying(time, frequency=1.6, damping=0.01, amplitude=0.1) + np.exp(-(time - time[0]) / 2)
    found = oscillation(run_with(error, time), "y")
    assert found is not None
    assert found.frequency == pytest.approx(1.6, rel=1e-3)
    assert 0.05 < found.share < 0.4


@pytest.mark.parametrize("timestep", [1e-3, 1e-2])
def test_the_modes_of_a_whole_run_count_from_the_end_of_its_manoeuvre(timestep: float) -> None:
    run = two_mode_run(modes=TwoModes(slow=1e-3, fast=3e-3), timestep=timestep)
    found = oscillation(run, "tip_position")
    assert found is not None
    assert (found.start, found.frequency) == (4.0, pytest.approx(1.5, rel=1e-3))
    assert found.amplitude == pytest.approx(3e-3, rel=1e-2)
    assert [name for name, _ in found.states] == ["tip [m]", "base [m]", "tip_velocity [m/s]"]


def test_from_a_later_start_on_the_amplitude_is_that_of_then() -> None:
    time = MANOEUVRE[1] + 1e-3 * np.arange(10_001)
    run = run_with(decaying(time, frequency=2.0, damping=0.05, amplitude=1.0), time)
    found = oscillation(run, "y", start=MANOEUVRE[1] + 2.0)
    assert found is not None
    rate = 0.05 / np.sqrt(1 - 0.05**2) * 2 * np.pi * 2.0
    assert found.amplitude == pytest.approx(np.exp(-2.0 * rate), rel=1e-4)


def test_where_the_plan_itself_rings_the_states_are_those_that_ring() -> None:
    time = MANOEUVRE[1] + 1e-3 * np.arange(10_001)
    run = run_with(decaying(time, frequency=2.0, damping=0.01, amplitude=1.0), time)
    found = oscillation(replace(run, planned_output=run.output, state_reference=run.state), "y")
    assert found is not None
    assert dict(found.states) == pytest.approx({"tip [m]": 1.0, "base [m]": 0.5}, rel=2e-2)


@pytest.mark.parametrize("shape", ["nothing", "offset", "decay", "ramp", "a few samples"])
def test_what_does_not_oscillate_does_not_ring(shape: str) -> None:
    time = MANOEUVRE[1] + 1e-3 * np.arange(30 if shape == "a few samples" else 4001)
    t = time - time[0]
    error = {"nothing": 0 * t, "offset": 0 * t + 1, "decay": np.exp(-t), "ramp": t, "a few samples": np.sin(100 * t)}[shape]
    assert oscillation(run_with(error, time), "y") is None


def test_a_mode_of_the_model_has_its_textbook_values() -> None:
    """Masses of 1 and 0.5 kg on a spring of 40 N/m and 0.05 N s/m: w^2 = 40 (1 + 2), 2 zeta w = 0.05 (1 + 2)."""
    A = [[0, 0, 1, 0], [0, 0, 0, 1], [0, 40, 0, 0.05], [0, -120, 0, -0.15]]
    states = Channels(("base", "flex", "base velocity", "flex velocity"), ("m", "m", "m/s", "m/s"))
    mode = nearest_mode(invtrack.StateSpace(A, [[0], [0], [1], [-1]], [[1, 0, 0, 0]], states=states), 5.0)
    assert mode is not None
    w, zeta = np.sqrt(120), 0.15 / 2 / np.sqrt(120)
    assert mode.frequency == pytest.approx(w * np.sqrt(1 - zeta**2) / (2 * np.pi), rel=1e-9)
    assert mode.damping == pytest.approx(zeta, rel=1e-9)
    assert mode.states == ("flex [m]", "base [m]")
    assert nearest_mode(invtrack.StateSpace([[0, 1], [0, 0]], [[0], [1]], [[1, 0]]), 1.0) is None
