"""Metrics of runs whose error and input are known in closed form."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.results.metrics import (
    max_error,
    metrics,
    peak_commanded_input,
    peak_input,
    preactuation_time,
    residual_vibration,
    rms_error,
    state_vibration,
)
from invtrack.results.result import RunResult, Signal
from invtrack.studies.folder import RunFolder
from tests.synthetic_runs import GROWTH_RATE, MANOEUVRE, PEAK_INPUT, TwoModes, diverged, two_mode_run

SINE = TwoModes(slow=1e-3)


def test_a_sine_has_its_textbook_values() -> None:
    # 22 s are 11 periods: rms is amplitude / sqrt(2), peak-to-peak twice the amplitude.
    run = two_mode_run(modes=SINE, timestep=1e-3)
    assert max_error(run) == pytest.approx(1e-3, rel=1e-5)
    assert rms_error(run) == pytest.approx(1e-3 / np.sqrt(2), rel=1e-5)
    assert residual_vibration(run) == pytest.approx(2e-3, rel=1e-5)


def test_two_modes_add_their_powers() -> None:
    run = two_mode_run(modes=TwoModes(slow=3e-3, fast=4e-3), timestep=1e-3)
    assert rms_error(run) == pytest.approx(5e-3 / np.sqrt(2), rel=1e-4)


def test_rms_weighs_by_time_and_not_by_samples() -> None:
    coarse = two_mode_run(modes=SINE, timestep=0.02)
    fine = two_mode_run(modes=SINE, timestep=0.001)
    # Fine steps where the error is 1, coarse ones where it is 0: the mean over samples would be dominated by the fine part.
    late = coarse.time[coarse.time > 8.0]
    time = np.concatenate([fine.time[fine.time <= 8.0], late])
    constant = np.where(time <= 8.0, 1.0, 0.0)[:, None]
    zero = Signal(np.zeros_like(constant), Channels(("y",), ("m",)))
    run = replace(fine, time=time, output=Signal(constant, Channels(("y",), ("m",))), reference=zero)
    assert rms_error(run) == pytest.approx(np.sqrt(14 / 22), rel=1e-3)


@settings(max_examples=30, deadline=None)
@given(scale=st.floats(1e-12, 1e12), shift=st.floats(-50, 50))
def test_units_scale_and_time_shifts_change_nothing_else(scale: float, shift: float) -> None:
    run = two_mode_run(modes=SINE, timestep=0.05)
    moved = replace(
        run,
        time=run.time + shift,
        manoeuvre=(run.manoeuvre[0] + shift, run.manoeuvre[1] + shift),
        output=replace(run.output, values=scale * run.output.values),
        reference=replace(run.reference, values=scale * run.reference.values),
        applied=replace(run.applied, values=scale * run.applied.values),
    )
    assert preactuation_time(moved) == pytest.approx(preactuation_time(run), abs=1e-9)
    for metric in (max_error, rms_error, residual_vibration):
        # y - y_d carries the rounding of y, which is 2000 times larger.
        assert metric(moved) == pytest.approx(scale * metric(run), rel=1e-11)
    assert peak_input(moved) == pytest.approx(scale * peak_input(run), rel=1e-12)


def test_preactuation_time_of_an_exponential() -> None:
    # exp(a t) crosses 1 % of the peak at t = log(0.01 peak) / a.
    run = two_mode_run(timestep=1e-3)
    assert preactuation_time(run) == pytest.approx(-np.log(0.01 * PEAK_INPUT) / GROWTH_RATE, abs=2e-3)
    assert preactuation_time(run, level=1e-4) == pytest.approx(-np.log(1e-4 * PEAK_INPUT) / GROWTH_RATE, abs=2e-3)


def test_preactuation_time_counts_from_the_last_quiet_moment() -> None:
    run = two_mode_run(timestep=0.01)
    early_burst = run.applied.values + 10.0 * (run.time[:-1, None] < -4)
    assert preactuation_time(replace(run, applied=replace(run.applied, values=early_burst))) == preactuation_time(run)


def test_preactuation_time_at_its_limits() -> None:
    run = two_mode_run(timestep=0.01)
    zero = replace(run, applied=replace(run.applied, values=np.zeros_like(run.applied.values)))
    always = replace(run, applied=replace(run.applied, values=np.ones_like(run.applied.values)))
    causal = replace(run, applied=replace(run.applied, values=(run.time[:-1, None] >= MANOEUVRE[0]).astype(float)))
    assert preactuation_time(zero) == 0
    assert preactuation_time(always) == pytest.approx(MANOEUVRE[0] - run.time[0])
    assert preactuation_time(causal) == 0
    assert preactuation_time(two_mode_run(start=0.0)) == 0
    with pytest.raises(InvtrackError, match=r"level, .* must lie between 0 and 1, got 2"):
        preactuation_time(run, level=2)


def test_applied_and_commanded_inputs_are_told_apart() -> None:
    run = two_mode_run()
    clipped = replace(run, applied=replace(run.applied, values=np.clip(run.applied.values, -25.0, 25.0)))
    assert peak_input(clipped) == 25
    assert peak_commanded_input(clipped) == pytest.approx(PEAK_INPUT, rel=1e-4)


def test_the_worst_output_counts() -> None:
    run = two_mode_run(modes=SINE, timestep=0.01)
    outputs = Channels(("y1", "y2"), ("m", "m"))
    reference = Signal(np.repeat(run.reference.values, 2, axis=1), outputs)
    run2 = replace(run, output=Signal(reference.values + run.error * [1.0, -3.0], outputs), reference=reference)
    for metric in (max_error, rms_error, residual_vibration):
        assert metric(run2) == pytest.approx(3 * metric(run), rel=1e-9)


def test_a_constant_offset_is_no_vibration() -> None:
    run = two_mode_run(modes=TwoModes(slow=0.0))
    offset = replace(run, output=replace(run.output, values=run.output.values + 0.25))
    assert residual_vibration(offset) == pytest.approx(0, abs=1e-15)
    assert max_error(offset) == pytest.approx(0.25)
    assert max_error(replace(offset, planned_output=offset.output), wanted="planned_output") == 0


def test_the_window_ends_where_it_says() -> None:
    # 5 periods of 2 s after 4 s: 14 s. A later burst is outside, and a run that ends there but for rounding is long enough.
    run = two_mode_run(modes=SINE, timestep=0.01, end=16)
    burst = replace(run, output=replace(run.output, values=run.output.values + (run.time[:, None] > 14.4)))
    assert residual_vibration(burst) == residual_vibration(run)
    assert residual_vibration(burst, periods=6) > 1
    short = two_mode_run(modes=SINE, timestep=0.01, end=14 * (1 - 1e-13))
    assert residual_vibration(short) == pytest.approx(2e-3, rel=1e-4)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        ({}, {"periods": 7}, r"ends at t = 16 s, .* simulate until 18 s"),
        ({"vibration_period": float("nan")}, {}, r"no flexible mode .* duration="),
        ({}, {"periods": 0}, "expected a positive, finite length"),
        ({}, {"duration": float("nan")}, "expected a positive, finite length"),
    ],
)
def test_windows_that_cannot_be_had_are_refused(change: dict[str, Any], options: dict[str, float], message: str) -> None:
    run = replace(two_mode_run(), **change)
    with pytest.raises(InvtrackError, match=message):
        residual_vibration(run, **options)
    with pytest.raises(InvtrackError, match=message):
        state_vibration(run, ["tip"], **options)


def test_a_stated_duration_needs_no_flexible_mode() -> None:
    run = replace(two_mode_run(modes=SINE), vibration_period=float("nan"))
    assert residual_vibration(run, duration=4.0) == pytest.approx(2e-3, rel=1e-3)


def test_state_vibration_is_relative_to_the_reference() -> None:
    run = two_mode_run(modes=SINE, timestep=1e-3)
    assert state_vibration(run, ["base", "tip"]) == {"base": pytest.approx(1e-3, rel=1e-4), "tip": pytest.approx(2e-3, rel=1e-4)}
    unreferenced = replace(run, state_reference=replace(run.state_reference, values=np.full_like(run.state.values, np.nan)))
    # After the manoeuvre the reference is constant, so leaving it out changes nothing.
    assert state_vibration(unreferenced, ["tip"])["tip"] == pytest.approx(2e-3, rel=1e-4)
    with pytest.raises(InvtrackError, match="no state named elbow; there are: tip, base"):
        state_vibration(run, ["elbow"])


def test_a_diverged_run_keeps_its_finite_values() -> None:
    run = diverged(two_mode_run(modes=SINE), at=5.0, amplitude=1e200)
    values = metrics(run)
    assert values["residual_vibration"] is None
    assert values["max_error"] == pytest.approx(1e200)
    assert values["peak_input"] == pytest.approx(1e200)
    numbers = [value for value in values.values() if value is not None]
    assert len(numbers) == 5
    assert np.all(np.isfinite(numbers))
    with pytest.raises(InvtrackError, match="diverged"):
        residual_vibration(run)


def test_a_completed_run_must_be_finite() -> None:
    run: RunResult = replace(diverged(two_mode_run(), at=5.0), status="completed")
    with pytest.raises(InvtrackError, match="was completed, but is not finite at t = 5"):
        metrics(run)


def test_the_summary_holds_all_metrics_by_name(tmp_path: Path) -> None:
    run = two_mode_run()
    folder = RunFolder(tmp_path)
    folder.keep(cases={run.name: metrics(run)})
    folder.finish("complete")
    case = json.loads((tmp_path / "summary.json").read_text())["cases"]["exact"]
    assert set(case) == {
        "max_error", "rms_error", "residual_vibration", "peak_input", "peak_commanded_input", "preactuation_time",
    }  # fmt: skip
