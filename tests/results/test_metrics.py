"""Metrics of runs whose error and input are known in closed form."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.channels import Channels
from invtrack.errors import InvtrackError
from invtrack.results import (
    max_error,
    metrics,
    peak_commanded_input,
    peak_input,
    peak_input_above_rest,
    postactuation_time,
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


def applying(run: RunResult, u: np.ndarray, rest: tuple[float, float] = (0.0, 0.0)) -> RunResult:
    """The run with other inputs (N,), and the plan's rests before and after the manoeuvre."""
    applied = replace(run.applied, values=u[:, None])
    return replace(run, applied=applied, commanded=applied, rest_inputs=np.array(rest)[:, None])


def test_an_input_that_returns_to_rest_for_a_while_acts_from_its_first_time_on() -> None:
    run = two_mode_run(timestep=0.01)
    begins = run.time[:-1]
    burst = run.applied.values[:, 0] + 10.0 * ((begins >= -5) & (begins < -4))
    assert preactuation_time(applying(run, burst)) == pytest.approx(5.0, abs=0.011)


@pytest.mark.parametrize("frequency", [1.0, 6.0, 40.0])
@pytest.mark.parametrize("level", [0.01, 0.1])
def test_the_envelope_counts_not_a_passage_through_rest(frequency: float, level: float) -> None:
    """e^t cos(w t) before and e^-t' cos(w t') after the manoeuvre, 1 within: the tips lie on e^t, half a turn apart at most."""
    run = two_mode_run(start=-8.0, end=16.0, timestep=1e-3)
    t = (run.time[:-1] + run.time[1:]) / 2
    away = np.maximum(np.maximum(MANOEUVRE[0] - t, t - MANOEUVRE[1]), 0.0)
    swinging = applying(run, np.exp(-away) * np.cos(frequency * away))
    envelope, half_a_turn = -np.log(level), np.pi / frequency
    for time in (preactuation_time(swinging, level=level), postactuation_time(swinging, level=level)):
        assert envelope - half_a_turn < time < envelope + 2e-3


@settings(max_examples=30, deadline=None)
@given(before=st.floats(-1e3, 1e3), after=st.floats(-1e3, 1e3))
def test_inputs_count_from_rest_whatever_it_takes_to_hold(before: float, after: float) -> None:
    """A load held before and another one held after the manoeuvre are neither preactuation nor postactuation."""
    run = two_mode_run(timestep=0.01)
    t = (run.time[:-1] + run.time[1:]) / 2
    held = np.where(t < MANOEUVRE[0], before, after)
    inside = (t > 0) & (t < 4)
    bump = np.where(inside, 1e4 * np.sin(np.pi * t / 4), 0.0)
    loaded = applying(run, held + bump, (before, after))
    assert preactuation_time(loaded) == 0
    assert postactuation_time(loaded) == 0
    assert peak_input(loaded) == pytest.approx(1e4 + after, rel=1e-5)
    # The bump stands on the load that is held at its end; where the other one is larger it counts from there.
    assert peak_input_above_rest(loaded) == pytest.approx(1e4 + after - max(before, after), rel=1e-5)


def test_holding_a_load_takes_no_input_above_rest() -> None:
    run = two_mode_run(timestep=0.01)
    picked_up = applying(run, np.where(run.time[:-1] < 1.0, 20.0, 50.0), (20.0, 50.0))
    assert peak_input(picked_up) == 50
    assert peak_input_above_rest(picked_up) == 0


def test_rest_at_one_end_only_leaves_the_other_times_undefined() -> None:
    run = two_mode_run(timestep=0.01)
    moving = applying(run, run.applied.values[:, 0], (0.0, np.nan))
    values = metrics(moving)
    assert values.postactuation_time is None
    assert values.notes["postactuation_time"] == "the input is not at rest after the manoeuvre: the plan goes on moving there"
    assert values.preactuation_time == preactuation_time(run)
    assert values.peak_input_above_rest == pytest.approx(PEAK_INPUT, rel=1e-4)
    assert metrics(applying(run, run.applied.values[:, 0], (np.nan, np.nan))).peak_input_above_rest is None


def test_a_run_that_begins_or_ends_in_mid_action_gives_a_lower_bound_and_says_so() -> None:
    run = two_mode_run(start=-0.2, end=4.3, timestep=0.01)
    values = metrics(run, duration=0.3)
    assert values.preactuation_time == pytest.approx(0.2)
    assert values.notes["preactuation_time"] == "at least: the input is above 1 % of its peak from the run's start on"
    assert values.postactuation_time == pytest.approx(0.3)
    assert values.notes["postactuation_time"] == "at least: the input is above 1 % of its peak until the run's end"
    whole = metrics(two_mode_run(timestep=1e-3))
    assert whole.postactuation_time == pytest.approx(np.log(1 / (0.01 * PEAK_INPUT)), abs=2e-3)  # e^-t after the manoeuvre
    assert whole.notes == {}


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
        ({"vibration_period": float("nan"), "manoeuvre": (4.0, 4.0)}, {}, r"no flexible mode .* duration="),
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


def test_without_a_flexible_mode_the_window_is_as_long_as_the_manoeuvre() -> None:
    run = replace(two_mode_run(modes=SINE, timestep=0.01), vibration_period=float("nan"))
    late = replace(run, output=replace(run.output, values=run.output.values + (run.time[:, None] > 8.05)))  # 4 s after 4 s
    values = metrics(late)
    assert values.residual_vibration == pytest.approx(2e-3, rel=1e-3)
    assert values.vibration_window == 4.0
    assert values.notes == {"residual_vibration": "no flexible mode: window of the manoeuvre's length, 4 s"}


@pytest.mark.parametrize(
    ("change", "options", "reason"),
    [
        ({}, {"periods": 7}, r"ends at t = 16 s, .* simulate until 18 s"),
        ({"vibration_period": float("nan"), "manoeuvre": (4.0, 4.0)}, {}, "no flexible mode and no manoeuvre of any length"),
    ],
)
def test_one_figure_that_is_not_defined_takes_none_of_the_others_with_it(
    change: dict[str, Any], options: dict[str, float], reason: str
) -> None:
    run = replace(two_mode_run(modes=SINE), **change)
    values = metrics(run, **options)
    assert values.residual_vibration is None
    assert re.search(reason, values.notes["residual_vibration"])
    others = [values[name] for name in values if name not in ("notes", "residual_vibration", "vibration_window")]
    assert len(others) == 7
    assert all(isinstance(value, float) and np.isfinite(value) for value in others)


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
    for name in ("residual_vibration", "preactuation_time", "postactuation_time"):
        assert values[name] is None
        assert "diverged" in values.notes[name]
    for name in ("rms_error", "peak_commanded_input", "peak_input_above_rest"):
        assert np.isfinite(values[name])
    with pytest.raises(InvtrackError, match="diverged"):
        residual_vibration(run)


def test_a_run_without_a_finite_sample_has_reasons_and_no_figures() -> None:
    run = diverged(two_mode_run(modes=SINE), at=5.0)
    bad = replace(run, output=replace(run.output, values=np.full_like(run.output.values, np.inf)))
    assert metrics(bad).max_error is None
    assert "no finite sample" in metrics(bad).notes["max_error"]
    assert metrics(bad).peak_input == pytest.approx(1e200)
    with pytest.raises(InvtrackError, match="no finite sample"):
        max_error(bad)


def test_a_completed_run_must_be_finite() -> None:
    run: RunResult = replace(diverged(two_mode_run(), at=5.0), status="completed")
    with pytest.raises(InvtrackError, match="was completed, but is not finite at t = 5"):
        max_error(run)
    assert metrics(run).max_error is None
    assert "was completed, but is not finite at t = 5" in metrics(run).notes["max_error"]


def test_the_summary_holds_all_metrics_by_name(tmp_path: Path) -> None:
    run = two_mode_run()
    folder = RunFolder(tmp_path)
    folder.keep(cases={run.name: {**metrics(run, periods=7), "status": "completed"}})
    folder.finish("complete")
    case = json.loads((tmp_path / "summary.json").read_text())["cases"]["exact"]
    assert set(case) == {
        "max_error", "rms_error", "residual_vibration", "vibration_window", "peak_input", "peak_commanded_input",
        "peak_input_above_rest", "preactuation_time", "postactuation_time", "notes", "status",
    }  # fmt: skip
    assert set(case["notes"]) == {"residual_vibration"}


@pytest.mark.parametrize("measure", [metrics, residual_vibration, lambda run, **window: state_vibration(run, ["tip"], **window)])
def test_a_number_of_periods_is_checked_also_where_a_duration_is_given(measure: Callable[..., object]) -> None:
    with pytest.raises(InvtrackError, match="periods must be"):
        measure(two_mode_run(), periods=float("nan"), duration=1.0)
