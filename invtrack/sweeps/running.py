"""Running a study at every point of a design, on threads of this machine or on any executor."""

from __future__ import annotations

import itertools
import os
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import ArrayLike

from invtrack.arguments import file_path, instance, items
from invtrack.arrays import increasing_times, shown, whole_number
from invtrack.errors import SweepError
from invtrack.results import metrics
from invtrack.results.result import RunResult
from invtrack.sweeps.design import Design
from invtrack.sweeps.fingerprint import study_hash
from invtrack.sweeps.procedure import Procedure, Study
from invtrack.sweeps.row import Outcome, Row, key_of
from invtrack.sweeps.swept import Swept

if TYPE_CHECKING:
    from invtrack.sweeps.dataset import Dataset

SECONDS_BETWEEN_PARTS = 1.0
"""Rows that come within this time of each other share a part file; a killed sweep computes no more than these again."""

SWITCHES = 1e-4
"""How long a thread may hold the interpreter while others wait [s]; Python's own default is fifty times as long."""

IN_FLIGHT = 256
"""Points that an executor has at once: more than a cluster has workers, few enough to be taken back soon."""


def sweep(
    study: Study,
    design: Design,
    *,
    out: str | Path,
    prepare: Callable[[], Any] | None = None,
    numbers: Callable[[RunResult], Mapping[str, Any]] = metrics,
    error_times: ArrayLike | None = None,
    files: Sequence[str | Path] = (),
    executor: Executor | None = None,
    workers: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> Swept:
    """Run a study at every point of a design and keep a row of each.

        def prepare():
            ...                                          # plant, plan, gains: once per process
            return plant, controller

        def study(point, seed, prepared):
            plant, controller = prepared
            change = invtrack.Change(point["instant"], tip_mass=point["mass"])
            return invtrack.simulate(plant, controller, schedule=[change], seed=seed)

        design = monte_carlo({"mass": stats.norm(100.0, 2.0), "instant": stats.uniform(1.5, 0.1)}, 2000)
        swept = sweep(study, design, out="runs/masses", prepare=prepare)

    Rows are in the folder within about a second of their being computed. A sweep that was interrupted or killed goes on where it
    was, with the same call; what it then leaves is what it would have left anyhow. Rows of another version of the study are never
    mixed in: they stand in a folder of their own, under the hash of the study, which covers the source texts of the modules that
    define its functions and of what these import, arguments bound to them, `files`, and the versions of the libraries; see
    docs/guide/sweeps.md. A run that diverges, or a point that an InvtrackError refuses, is a row with that status and its reason;
    any other exception ends the sweep, which keeps the rows that are done.

    Args:
        study: function of (point, seed), or of (point, seed, prepared) with `prepare`: a dict of values by the names of
            parameters, and a seed for everything random. Returns a RunResult, or numbers, texts and lists of numbers by name.
        design: the points; see `grid`, `latin_hypercube`, `monte_carlo`, `listed`.
        out: folder of the dataset, for one sweep at a time.
        prepare: makes what all points have in common; called once in each process, by the first point there.
        numbers: makes the numbers that are kept of a completed run; all metrics unless given.
        error_times: times (m,) [s] at which y - y_d of every run is kept too, for bands over time.
        files: what else the study depends on, such as its MJCF files: where their content changes it is another study.
        executor: what runs the points, which stays open; threads of this machine unless given. Processes get the functions by
            pickle, so these must be importable there, or the executor's own pickle must send their code.
        workers: how many threads; one for each core unless given.
        progress: called with the share that is done; a bar with a rate on stderr, where that is a terminal, unless given.

    Raises SweepError for a study, design or option that is not usable as asked, FileError where rows cannot be kept.
    """
    from invtrack.sweeps.dataset import Dataset  # loads pyarrow, which a worker of a cluster does without

    for name, function in (("study", study), ("numbers", numbers), *((("prepare", prepare),) if prepare is not None else ())):
        if not callable(function):
            raise SweepError(f"{name} must be a function, got {shown(function)}")
    instance("design", design, Design, expected="an invtrack.sweeps.Design, such as grid({...})", error=SweepError)
    if executor is not None:
        instance("executor", executor, Executor, expected="a concurrent.futures.Executor", error=SweepError)
        if workers is not None:
            raise SweepError("expected workers, for threads of this machine, or an executor, which has its own workers, got both")
    times = None if error_times is None else increasing_times("error_times", error_times, error=SweepError)
    needed = [file_path(path) for path in items("files", files, expected="a list of paths", error=SweepError)]
    code = study_hash([study, prepare, numbers, times], needed)
    procedure = Procedure(study, prepare, numbers, times, code)
    dataset = Dataset(file_path(out), code)
    earlier = dataset.rows()
    keys = [key_of(point, seed) for point, seed in zip(design.points, design.seeds, strict=True)]
    known = {i: earlier[key] for i, key in enumerate(keys) if key in earlier}
    missing = [i for i in range(len(design)) if i not in known]
    kept = _Kept(dataset)
    began = time.monotonic()
    if missing:
        count = whole_number("workers", os.cpu_count() or 1 if workers is None else workers, lowest=1, error=SweepError)
        with _report(progress, len(design), len(known)) as report, _executor(executor, count) as pool:
            _compute(procedure, design, missing, pool, kept, lambda done: report((len(known) + done) / len(design)))
    elapsed = time.monotonic() - began
    rows = {**known, **{row.index: row for row in kept.rows}}
    ordered = tuple(_at(rows[i], i) for i in range(len(design)))
    own = set(keys)
    others = [row for key, row in earlier.items() if key not in own]
    dataset.compact(ordered, others)
    rate = len(missing) / elapsed if missing else None
    return Swept(design, ordered, procedure, dataset.path, len(missing), rate)


@dataclass(eq=False)
class _Kept:
    """Rows that this call computed; those of them that are in no part file yet are `new`."""

    dataset: Dataset
    rows: list[Row] = field(default_factory=list)
    new: list[Row] = field(default_factory=list)
    written: float = -SECONDS_BETWEEN_PARTS

    def add(self, row: Row) -> None:
        self.rows.append(row)
        self.new.append(row)

    def write(self, *, now: bool = False) -> None:
        """Put the new rows into a part file, unless one was written just before."""
        if self.new and (now or time.monotonic() - self.written >= SECONDS_BETWEEN_PARTS):
            self.dataset.add(self.new)
            self.new = []
            self.written = time.monotonic()


def _compute(
    procedure: Procedure, design: Design, missing: Sequence[int], pool: Executor, kept: _Kept, report: Callable[[int], None]
) -> None:
    """Rows of the missing points, in whatever order they are done."""
    waiting: dict[Future[Outcome], int] = {}
    remaining: Iterator[int] = iter(missing)

    def collect(done: Iterable[Future[Outcome]]) -> None:
        for future in done:
            i = waiting.pop(future)
            try:
                outcome = future.result()
            except BaseException as error:
                error.add_note(f"at point {i} of the sweep, {dict(design.points[i])}, seed {design.seeds[i]}")
                raise
            kept.add(Row.of(i, design.points[i], design.seeds[i], outcome))

    try:
        report(0)
        while True:
            for i in itertools.islice(remaining, IN_FLIGHT - len(waiting)):
                waiting[pool.submit(procedure.outcome, design.points[i], design.seeds[i])] = i
            if not waiting:
                break
            done, _ = wait(waiting, timeout=SECONDS_BETWEEN_PARTS, return_when=FIRST_COMPLETED)
            collect(done)
            kept.write()
            report(len(kept.rows))
    except BaseException as error:
        running = {future: i for future, i in waiting.items() if not future.cancel()}
        _keep_done(running, design, kept)
        if isinstance(pool, ThreadPoolExecutor):  # a thread cannot be stopped: what it computes meanwhile is kept
            wait(running)
            _keep_done(running, design, kept)
        error.add_note(
            f"the sweep keeps {len(kept.rows)} rows of this call in {kept.dataset.folder}; the same call goes on from there"
        )
        raise
    kept.write(now=True)


def _keep_done(running: dict[Future[Outcome], int], design: Design, kept: _Kept) -> None:
    """Put what is done into a part file, and take it out of `running`."""
    for future in [future for future in running if future.done()]:
        i = running.pop(future)
        if not future.cancelled() and future.exception() is None:
            kept.add(Row.of(i, design.points[i], design.seeds[i], future.result()))
    kept.write(now=True)


@contextmanager
def _executor(given: Executor | None, workers: int) -> Iterator[Executor]:
    if given is not None:
        yield given
        return
    before = sys.getswitchinterval()
    # A run comes back from compiled code many times; each time it would wait for the interpreter as long as another may hold it.
    sys.setswitchinterval(min(before, SWITCHES))
    try:
        with ThreadPoolExecutor(workers, thread_name_prefix="sweep") as pool:
            yield pool
    finally:
        sys.setswitchinterval(before)


@contextmanager
def _report(given: Callable[[float], None] | None, total: int, known: int) -> Iterator[Callable[[float], None]]:
    if given is not None:
        yield given
        return
    from invtrack.studies.session import progress as progress_bar  # loads matplotlib, which a worker does without

    text = f"sweep, {known} rows are there" if known else "sweep"
    with progress_bar(text, total=total, unit="runs") as report:
        yield report


def _at(row: Row, index: int) -> Row:
    """The row at its place in this design."""
    return row if row.index == index else replace(row, index=index)
