"""A sweep keeps a row of every point, goes on where it was, mixes nothing, and can run each row again."""

from __future__ import annotations

import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import invtrack
from invtrack.errors import FileError, InvtrackError, SweepError
from invtrack.sweeps import Swept, grid, listed, monte_carlo, rank_correlations, sweep
from tests.sweeps.oscillators import ERROR_TIMES, prepare, study, swept


def square(point: dict[str, Any], seed: int) -> dict[str, Any]:
    return {"square": point["a"] ** 2, "word": f"{point['a']}", "list": [point["a"], float(seed)]}


@pytest.fixture(scope="module")
def complete(tmp_path_factory: pytest.TempPathFactory) -> Swept:
    return swept(tmp_path_factory.mktemp("sweep"), points=12, workers=2)


def test_rows_hold_what_the_runs_show(complete: Swept) -> None:
    assert complete.counts == {"completed": 10, "diverged": 1, "refused": 1}
    row = complete.rows[2]
    run = study(dict(row.point), row.seed, prepare())
    measured = invtrack.metrics(run)
    assert all(row.numbers[name] == measured[name] for name in row.numbers)
    assert row.numbers["max_error"] == invtrack.max_error(run) > 0
    error = row.traces["error_y1"]
    inside = (run.time[0] <= ERROR_TIMES) & (run.time[-1] >= ERROR_TIMES)
    assert np.array_equal(np.isnan(error), ~inside)
    samples = [int(np.argmin(np.abs(run.time - t))) for t in ERROR_TIMES[inside]]
    np.testing.assert_allclose(error[inside], run.error[samples, 0], atol=1e-9)


def test_a_run_that_diverges_and_a_point_that_is_refused_are_rows_with_their_reasons(complete: Swept) -> None:
    diverged, refused = complete.rows[3], complete.rows[7]
    assert (diverged.status, refused.status) == ("diverged", "refused")
    assert diverged.reason.startswith("stopped at t = ")
    assert refused.reason == "expected a stiffness above zero, got -1"
    assert all(value is None for value in [*diverged.numbers.values(), *refused.numbers.values()])
    assert np.isnan(complete.numbers("max_error")[[3, 7]]).all()
    assert complete.completed.tolist() == [i not in (3, 7) for i in range(12)]


def test_the_rows_as_a_data_frame(complete: Swept) -> None:
    frame = complete.to_pandas()
    assert list(frame.index) == list(range(12))
    assert frame["status"].value_counts().to_dict() == {"completed": 10, "diverged": 1, "refused": 1}
    assert np.array_equal(frame["max_error"].astype(float), complete.numbers("max_error"), equal_nan=True)
    assert list(frame["stiffness"]) == list(complete.design.column("stiffness"))


def test_the_file_holds_the_rows_in_the_order_of_the_design(complete: Swept) -> None:
    table = pq.read_table(complete.path)
    assert table["index"].to_pylist() == list(range(12))
    assert table["seed"].to_pylist() == list(complete.design.seeds)
    assert table["stiffness"].to_pylist() == list(complete.design.column("stiffness"))
    assert table["max_error"].to_pylist() == [row.numbers.get("max_error") for row in complete.rows]
    assert [path.name for path in complete.path.parent.iterdir()] == ["rows.parquet"]
    assert complete.path.parent.name == f"study={complete.study}"


def test_the_same_call_again_computes_nothing_and_returns_the_same_rows(complete: Swept) -> None:
    before = complete.path.read_bytes()
    again = swept(complete.path.parents[1], points=12)
    assert (again.computed, again.runs_per_second) == (0, None)
    assert all(mine.equals(theirs) for mine, theirs in zip(again.rows, complete.rows, strict=True))
    assert again.path.read_bytes() == before


def test_any_executor_gives_the_same_file(complete: Swept, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    # Behind the installed package: a process of the pool imports the study from the checkout, and invtrack from where we have it.
    monkeypatch.setattr(sys, "path", [*sys.path, str(Path(__file__).parents[2])])
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        other = swept(tmp_path, points=12, executor=pool)
        assert pool.submit(abs, -1).result() == 1  # it stays open
    assert other.path.read_bytes() == complete.path.read_bytes()


def test_a_longer_design_computes_what_is_new_and_keeps_what_it_has_not(tmp_path: Path) -> None:
    parameters = {"a": [float(a) for a in range(9)]}
    first = sweep(square, grid(parameters), out=tmp_path)
    shorter = sweep(square, listed([{"a": 4.0}, {"a": 20.0}]), out=tmp_path)
    assert (first.computed, shorter.computed) == (9, 1)  # the first point has the seed that it has in the grid
    assert len(pq.read_table(shorter.path)) == 2
    assert len(pq.read_table(tmp_path / f"study={shorter.study}" / "earlier.parquet")) == 8
    again = sweep(square, grid(parameters), out=tmp_path)
    assert again.computed == 0
    assert len(pq.read_table(tmp_path / f"study={shorter.study}")) == 10


def test_a_monte_carlo_sweep_is_extended(tmp_path: Path) -> None:
    first = sweep(square, monte_carlo({"a": [0.5, 1.5, 2.5]}, 5), out=tmp_path)
    longer = sweep(square, monte_carlo({"a": [0.5, 1.5, 2.5]}, 12), out=tmp_path)
    assert (first.computed, longer.computed) == (5, 7)
    assert all(mine.equals(theirs) for mine, theirs in zip(first.rows, longer.rows, strict=False))


def test_rows_of_a_changed_study_are_not_mixed_in(tmp_path: Path) -> None:
    def scaled(factor: float) -> Swept:
        return sweep(lambda point, seed: {"value": factor * point["a"]}, grid({"a": [1.0, 2.0]}), out=tmp_path)

    first, second, first_again = scaled(1.0), scaled(10.0), scaled(1.0)
    assert (first.computed, second.computed, first_again.computed) == (2, 2, 0)
    assert second.numbers("value").tolist() == [10.0, 20.0]
    assert first_again.numbers("value").tolist() == [1.0, 2.0]


@pytest.mark.parametrize("kind", ["truncated", "flipped", "empty"])
def test_a_damaged_part_is_computed_again(tmp_path: Path, kind: str) -> None:
    design = grid({"a": [float(a) for a in range(20)]})
    first = sweep(square, design, out=tmp_path)
    whole = first.path.read_bytes()
    part = first.path.with_name("part-00000000-00000000.parquet")
    first.path.rename(part)
    third = len(whole) // 3
    damaged = {
        "truncated": whole[:third],
        "flipped": whole[:third] + bytes([whole[third] ^ 4]) + whole[third + 1 :],
        "empty": b"",
    }
    part.write_bytes(damaged[kind])
    with pytest.warns(RuntimeWarning, match="part-00000000-00000000.parquet is damaged"):
        again = sweep(square, design, out=tmp_path)
    assert again.computed > 0
    assert again.path.read_bytes() == whole
    assert not part.exists()


def test_a_row_that_is_not_what_was_written_is_computed_again(tmp_path: Path) -> None:
    design = grid({"a": [1.0, 2.0, 3.0]})
    first = sweep(square, design, out=tmp_path)
    whole = first.path.read_bytes()
    table = pq.read_table(first.path)
    forged = table.set_column(table.schema.get_field_index("square"), table.schema.field("square"), [[1.0, 4.5, 9.0]])
    pq.write_table(forged, first.path)
    with pytest.warns(RuntimeWarning, match="1 of 3 rows are not what was written"):
        again = sweep(square, design, out=tmp_path)
    assert again.computed == 1
    assert again.path.read_bytes() == whole


class _Counted:
    """A study that notes its calls, which are no part of what it is."""

    def __init__(self, calls: list[float]) -> None:
        self.calls = calls

    def __reduce__(self) -> Any:
        return _Counted, ([],)

    def __call__(self, point: dict[str, Any], seed: int) -> dict[str, Any]:
        self.calls.append(point["a"])
        time.sleep(0.002)
        return square(point, seed)


def test_an_interrupted_sweep_keeps_what_is_done_and_goes_on(tmp_path: Path) -> None:
    design = grid({"a": [float(a) for a in range(30)]})
    calls: list[float] = []

    def interrupt(share: float) -> None:
        if share > 0.2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as interruption:
        sweep(_Counted(calls), design, out=tmp_path, workers=2, progress=interrupt)
    assert "the same call goes on from there" in interruption.value.__notes__[0]
    done = len(calls)
    assert 6 < done < 30
    finished = sweep(_Counted(calls), design, out=tmp_path, workers=2, progress=lambda share: None)
    assert finished.computed == 30 - done
    assert sorted(calls) == [float(a) for a in range(30)]  # none twice
    assert finished.numbers("square").tolist() == [float(a * a) for a in range(30)]


MADE: list[int] = []
BOTH = threading.Barrier(2)


def plan_slowly() -> int:
    MADE.append(1)
    time.sleep(0.02)
    return 7


def add(point: dict[str, Any], seed: int, plan: int) -> dict[str, Any]:
    if point["a"] < 2:
        BOTH.wait(10)  # both threads are at work
    return {"sum": point["a"] + plan}


def test_what_is_common_is_prepared_once_per_process(tmp_path: Path) -> None:
    done = sweep(add, grid({"a": [0, 1, 2, 3]}), out=tmp_path, prepare=plan_slowly, workers=2)
    assert done.numbers("sum").tolist() == [7.0, 8.0, 9.0, 10.0]
    assert MADE == [1]


def test_an_error_that_is_no_refusal_ends_the_sweep_and_names_the_point(tmp_path: Path) -> None:
    def wrong(point: dict[str, Any], seed: int) -> dict[str, Any]:
        return {"value": {1.0: "one", 2.0: "two"}[point["a"]]}

    with pytest.raises(KeyError) as failure:
        sweep(wrong, grid({"a": [1.0, 2.0, 3.0]}), out=tmp_path, workers=1)
    assert failure.value.__notes__[0].startswith("at point 2 of the sweep, {'a': 3.0}, seed ")
    with pytest.raises(KeyError):
        sweep(wrong, grid({"a": [1.0, 2.0, 3.0]}), out=tmp_path, workers=1)
    assert sweep(wrong, grid({"a": [1.0, 2.0]}), out=tmp_path).computed == 0  # these rows were kept


def test_a_preparation_that_is_refused_ends_the_sweep(tmp_path: Path) -> None:
    def refuse() -> None:
        raise InvtrackError("no plan")

    with pytest.raises(InvtrackError, match="no plan"):
        sweep(lambda point, seed, plan: {"a": 1.0}, grid({"a": [1.0]}), out=tmp_path, prepare=refuse)


def test_a_row_run_again_is_the_row(complete: Swept, tmp_path: Path) -> None:
    replay = complete.replay(4, recording=tmp_path / "row.rrd")
    assert replay.same
    assert replay.row.equals(complete.rows[4])
    assert replay.run is not None
    (recorded,) = invtrack.load_recording(tmp_path / "row.rrd").values()
    assert recorded.equals(replay.run)
    assert complete.replay(complete.rows[3]).same  # the one that diverges
    with pytest.raises(SweepError, match="row 7 leaves no run to record; it was refused: expected a stiffness above zero"):
        complete.replay(7, recording=tmp_path / "none.rrd")
    with pytest.raises(SweepError, match="row must be a whole number from 0 to 11, got 12"):
        complete.replay(12)


def test_progress_counts_the_rows_that_were_there(tmp_path: Path) -> None:
    shares: list[float] = []
    sweep(square, monte_carlo({"a": [0.5, 1.5]}, 4), out=tmp_path, workers=1)
    sweep(square, monte_carlo({"a": [0.5, 1.5]}, 8), out=tmp_path, workers=1, progress=shares.append)
    assert shares == sorted(shares)
    assert shares[0] == 0.5
    assert shares[-1] == 1.0


def test_rank_correlations_find_what_matters(tmp_path: Path) -> None:
    def cubic(point: dict[str, Any], seed: int) -> dict[str, Any]:
        return {"value": np.exp(5 * point["a"]) - 0.1 * point["b"], "constant": 1.0}

    points = np.random.default_rng(0).random((60, 3))
    rows = [{"a": a, "b": b, "c": c, "name": "x", "same": 1.0} for a, b, c in points.tolist()]
    done = sweep(cubic, listed(rows), out=tmp_path)
    found = rank_correlations(done, "value")
    assert set(found) == {"a", "b", "c"}
    assert found["a"] > 0.98
    assert abs(found["c"]) < 0.4
    with pytest.raises(SweepError, match="no parameter or number named 'd'"):
        rank_correlations(done, "value", about={"d": 0.0})
    with pytest.raises(SweepError, match="'constant' is defined and not always the same, got 60 rows"):
        rank_correlations(done, "constant")


def test_what_grows_both_ways_is_found_by_the_distance_from_what_is_assumed(tmp_path: Path) -> None:
    offsets = np.random.default_rng(1).normal(size=80).tolist()
    done = sweep(
        lambda point, seed: {"value": (point["a"] - 3.0) ** 2}, listed([{"a": 3.0 + offset} for offset in offsets]), out=tmp_path
    )
    assert abs(rank_correlations(done, "value")["a"]) < 0.4
    assert rank_correlations(done, "value", about={"a": 3.0})["a"] == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"study": 3}, "study must be a function, got 3"),
        ({"numbers": None}, "numbers must be a function, got None"),
        ({"design": [{"a": 1}]}, "design must be an invtrack.sweeps.Design"),
        ({"executor": "dask"}, "executor must be a concurrent.futures.Executor, got 'dask'"),
        ({"workers": 0}, "workers must be a whole number from 1 on, got 0"),
        ({"error_times": [1.0, 0.0]}, "error_times must be finite and increase"),
        ({"study": lambda point, seed: 3.0}, "what the study returns must be a dict of a RunResult, or numbers"),
        ({"study": lambda point, seed: {"x": object()}}, "the study must return a RunResult, or numbers"),
        ({"study": lambda point, seed: {"x": np.eye(2)}}, r"'x' that the study returns must be a list of numbers \(m,\)"),
        ({"study": lambda point, seed: {"a": 1.0}}, "numbers under names of their own, got a twice"),
        ({"study": lambda point, seed: {"x": "text" if point["a"] > 1 else 1.0}}, "'x' is float and str in different rows"),
    ],
)
def test_what_is_no_sweep_is_refused(tmp_path: Path, options: dict[str, Any], message: str) -> None:
    given = {"study": square, "design": grid({"a": [1.0, 2.0]}), **options}
    with pytest.raises(SweepError, match=message):
        sweep(given.pop("study"), given.pop("design"), out=tmp_path, **given)


def test_workers_and_an_executor_are_one_too_many(tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool, pytest.raises(SweepError, match="got both"):
        sweep(square, grid({"a": [1.0]}), out=tmp_path, executor=pool, workers=2)


def test_a_place_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="expected a folder for rows at"):
        sweep(square, grid({"a": [1.0]}), out=tmp_path / "file")


def test_columns_that_are_not_there_are_named(complete: Swept) -> None:
    with pytest.raises(SweepError, match="no parameter or number named 'mass'; there are: number, stiffness, gain, max_error"):
        complete.numbers("mass")
    with pytest.raises(SweepError, match="no row has a list 'error'; there are: error_y1"):
        complete.traces("error")
    assert complete.traces("error_y1").shape == (12, len(ERROR_TIMES))
