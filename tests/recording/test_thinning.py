"""What a recording shows of a long run, and what it costs."""

from __future__ import annotations

import dataclasses
import tracemalloc
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from invtrack.recording import samples, save_recording
from invtrack.recording.thinning import AROUND, COLUMNS, Thinning, thinning
from invtrack.results.interval import shown_interval
from invtrack.results.result import RunResult, Signal
from tests.recording.conftest import Recorded
from tests.synthetic_runs import JUMP, MANOEUVRE, VIBRATION_PERIOD, two_mode_run

OUTPUT, INPUT = "/exact/output/\\[m\\]", "/exact/applied/\\[N\\]"


@pytest.fixture(scope="module")
def long_run() -> RunResult:
    """200 000 steps, some hundred of them a bucket."""
    return two_mode_run(timestep=1e-4)


def opened(result: RunResult) -> Thinning:
    """The thinning of a run that is recorded alone."""
    return thinning(result, shown_interval([result]))


def shown(result: RunResult, folder: Path, path: str) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the samples that the Rerun file has of a series, and its values."""
    recorded = Recorded(save_recording(result, folder / "run.rrd"))
    return np.array(recorded.column(path, "step")), np.array(recorded.column(path, "Scalars:scalars"))


def test_a_peak_of_one_sample_is_shown_wherever_it_stands(long_run: RunResult, tmp_path: Path) -> None:
    places = np.random.default_rng(0).integers(0, len(long_run.time) - 1, 20)
    output, force = long_run.output.values.copy(), long_run.applied.values.copy()
    output[places, 0] += 0.1 * np.where(np.arange(20) % 2, 1.0, -1.0)
    force[places, 0] *= -1.0
    spiked = dataclasses.replace(
        long_run, output=Signal(output, long_run.output.channels), applied=Signal(force, long_run.applied.channels)
    )
    for path, values in ((OUTPUT, output), (INPUT, force)):
        steps, rows = shown(spiked, tmp_path, path)
        assert set(places) <= set(steps)
        assert np.array_equal(rows, values[steps])
        assert len(steps) < 0.05 * len(values)


def test_a_plot_has_the_same_extent_in_every_column_as_that_of_all_samples(long_run: RunResult, tmp_path: Path) -> None:
    noise = np.random.default_rng(1).normal(size=(len(long_run.time), 1))
    noisy = dataclasses.replace(long_run, output=Signal(long_run.output.values + 1e-3 * noise, long_run.output.channels))
    steps, rows = shown(noisy, tmp_path, OUTPUT)
    start, end = shown_interval([noisy])
    column = np.floor((noisy.time - start) / (end - start) * COLUMNS)  # on a plot that shows the interval with which it opens
    for whole in range(0, COLUMNS, 50):
        inside = column == whole
        drawn = rows[column[steps] == whole, 0]
        near = noisy.output.values[np.abs(column - whole) <= 1, 0]
        assert len(drawn) < 0.2 * inside.sum()
        # The extremes of a column are drawn within it, or where a bucket reaches over its edge within the next one.
        around = rows[np.abs(column[steps] - whole) <= 1, 0]
        assert around.max() >= noisy.output.values[inside, 0].max()
        assert around.min() <= noisy.output.values[inside, 0].min()
        assert near.min() <= drawn.min() <= drawn.max() <= near.max()


finite = st.floats(-1e300, 1e300) | st.sampled_from([0.0, 1.0, np.nan, np.inf, -np.inf])


@settings(max_examples=200, deadline=None)
@given(
    series=st.lists(finite, min_size=1, max_size=60),
    sizes=st.tuples(st.integers(1, 9), st.integers(1, 9), st.integers(1, 9)),
    cuts=st.tuples(st.integers(0, 60), st.integers(0, 60)).map(sorted),
    marks=st.lists(st.integers(0, 59), max_size=2),
)
def test_the_least_and_the_largest_of_every_bucket_and_its_first_sample_are_kept(
    series: list[float], sizes: tuple[int, int, int], cuts: list[int], marks: list[int]
) -> None:
    values = np.array(series)
    parts = tuple(zip([0, *cuts], sizes, strict=True))
    rows = Thinning(parts, np.unique(np.array(marks, dtype=np.int64))).rows(values[:, np.newaxis])
    assert np.array_equal(rows, np.unique(rows))
    kept = set(rows)
    starts = {row for (first, size), end in zip(parts, [*cuts, 60], strict=True) for row in range(first, end, size)}
    starts = sorted(row for row in starts if row < len(series))
    assert set(starts) <= kept
    assert {row for mark in marks for row in range(mark - AROUND, mark + AROUND + 1) if 0 <= row < len(series)} <= kept
    for first, following in zip(starts, [*starts[1:], len(series) - 1], strict=True):
        bucket = range(first, following + 1)  # up to the next one's first sample, where the line goes
        numbers = [values[row] for row in bucket if not np.isnan(values[row])]
        drawn = [values[row] for row in bucket if row in kept and not np.isnan(values[row])]
        if numbers:
            assert (min(drawn), max(drawn)) == (min(numbers), max(numbers))


def test_smooth_series_cost_a_row_a_bucket(long_run: RunResult, tmp_path: Path) -> None:
    start, end = shown_interval([long_run])
    steps, _ = shown(long_run, tmp_path, "/exact/state/\\[m\\]")
    per_second = len(steps) / (long_run.time[-1] - long_run.time[0])
    assert COLUMNS / (end - start) <= per_second < 1.2 * COLUMNS / (end - start)


def test_all_samples_around_whatever_happens_are_shown(long_run: RunResult, tmp_path: Path) -> None:
    missing = long_run.state_reference.values.copy()
    missing[50_000:60_000, 0] = np.nan
    result = dataclasses.replace(long_run, state_reference=Signal(missing, long_run.state_reference.channels))
    steps, rows = shown(result, tmp_path, "/exact/state_reference/\\[m\\]")
    events = [int(np.argmin(np.abs(long_run.time - time))) for time in (*MANOEUVRE, JUMP)]
    for place in [*events, 0, len(long_run.time) - 1, 50_000, 60_000]:
        around = set(range(max(place - AROUND, 0), min(place + AROUND, len(long_run.time) - 1) + 1))
        assert around <= set(steps)
    assert np.array_equal(rows, missing[steps][:, :2], equal_nan=True)
    changes, masses = shown(result, tmp_path, "/exact/parameters/\\[kg\\]")
    jump = int(np.argmax(long_run.parameters.values[:, 0] == 100.0))
    assert {jump - 1, jump} <= set(changes)
    assert np.array_equal(np.unique(masses), [0.0, 100.0])


def test_a_vibration_that_is_short_beside_the_manoeuvre_keeps_its_shape(long_run: RunResult) -> None:
    fast = dataclasses.replace(long_run, vibration_period=0.02)
    assert np.diff(opened(fast).rows(fast.output.values)).max() * 1e-4 <= 0.02 / 20
    assert np.diff(opened(long_run).rows(long_run.output.values)).max() * 1e-4 > 3 * 0.02 / 20


def test_a_short_manoeuvre_in_a_long_interval_is_shown_in_detail(long_run: RunResult) -> None:
    never_at_rest = np.random.default_rng(3).normal(size=long_run.applied.values.shape)  # so that the plots open on long
    busy = dataclasses.replace(long_run, applied=Signal(never_at_rest, long_run.applied.channels), manoeuvre=(0.0, 0.4))
    begin, end = shown_interval([busy])
    assert (begin, end) == pytest.approx((-6.0, 6.8 + 0.03 * 12.8))
    times = busy.time[opened(busy).rows(busy.output.values)]
    assert np.diff(times[(times >= 0.0) & (times <= 0.4)]).max() <= 0.4 / 1000 * (1 + 1e-9)
    assert np.count_nonzero(times <= end) < 1.2 * (COLUMNS + 1000)


def test_thinning_knows_no_unit_of_time(long_run: RunResult) -> None:
    years = 1 / (365.25 * 86400)
    slow = dataclasses.replace(
        long_run,
        time=long_run.time * years,
        manoeuvre=(MANOEUVRE[0] * years, MANOEUVRE[1] * years),
        vibration_period=VIBRATION_PERIOD * years,
        timestep=long_run.timestep * years,
        events=[dataclasses.replace(event, time=event.time * years) for event in long_run.events],
    )
    assert np.array_equal(opened(slow).rows(slow.output.values), opened(long_run).rows(long_run.output.values))


def test_every_sample_can_be_shown(tmp_path: Path) -> None:
    part = two_mode_run(timestep=1e-3)
    assert len(opened(part).rows(part.output.values)) < 0.5 * len(part.time)
    recorded = Recorded(save_recording(part, tmp_path / "run.rrd", every_sample=True))
    assert recorded.column(OUTPUT, "step") == list(range(len(part.time)))
    assert recorded.column(INPUT, "step") == list(range(len(part.time) - 1))


def numbers_in(result: RunResult) -> int:
    """Bytes of all arrays of a run."""
    return sum(value.values.nbytes for value in vars(result).values() if isinstance(value, Signal)) + result.time.nbytes


def test_both_files_are_small_beside_the_data(long_run: RunResult, tmp_path: Path) -> None:
    path = save_recording(long_run, tmp_path / "run.rrd")
    assert path.stat().st_size < 15 * len(long_run.time)
    assert path.with_suffix(".parquet").stat().st_size < 0.5 * numbers_in(long_run)
    random = np.random.default_rng(2)
    noise = {
        name: Signal(random.normal(size=value.values.shape), value.channels)
        for name, value in vars(long_run).items()
        if isinstance(value, Signal)
    }
    path = save_recording(dataclasses.replace(long_run, **noise), tmp_path / "noise.rrd")  # type: ignore[arg-type]
    assert path.stat().st_size < 30 * len(long_run.time)
    assert path.with_suffix(".parquet").stat().st_size < 1.01 * numbers_in(long_run)


def test_saving_and_loading_make_no_second_copy_in_memory(
    long_run: RunResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "GROUP", 4096)
    pool = pa.proxy_memory_pool(pa.default_memory_pool())  # counts what Arrow allocates from now on
    before = pa.default_memory_pool()
    pa.set_memory_pool(pool)
    tracemalloc.start()
    try:
        samples.write_samples([long_run], tmp_path / "run.parquet", recording="one")
        written = tracemalloc.get_traced_memory()[1] + pool.max_memory()
        tracemalloc.reset_peak()
        loaded = samples.read_samples(tmp_path / "run.parquet")
        read = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
        pa.set_memory_pool(before)
    assert written < 0.2 * numbers_in(long_run)
    assert read < 1.2 * numbers_in(long_run)
    assert loaded["exact"].equals(long_run)
