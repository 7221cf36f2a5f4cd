"""What a running study has so far, and how it runs more; with a progress bar for what takes longer than a second or two."""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TextIO

from invtrack.control.protocol import Controller
from invtrack.errors import InvtrackError, LongRunWarning
from invtrack.plant.plant import Plant
from invtrack.results.result import Event, RunResult
from invtrack.simulation.closed_loop import simulate
from invtrack.simulation.linear_plant import LinearPlant
from invtrack.studies.options import StudyOptions
from invtrack.studies.table import Rows

if TYPE_CHECKING:
    from rich.console import Console

SECONDS_BETWEEN_UPDATES = 0.1  # a report from every physics step would cost more than the step


class MissingError(InvtrackError):
    """A case, sweep or section is asked for that this run does not have: not chosen, refused, or diverged."""


class DivergedError(InvtrackError):
    """A simulation diverged, so what was to be made of it is not there."""


class Session:
    """What a running study has so far: it is handed to every function that makes something of the cases.

    runs: the completed runs by case. numbers: of each case that was tried, what the summary says of it: its metrics and
    its "status", "completed", "diverged" or "refused". sections: values of the sweeps and sections that are done.
    diverged: what was lost to divergence, with the reason. remarks: what simulations warned of and which
    limits acted in them, by the name of the run.

    Where `session[case]`, `numbers_of`, `among` or `section` is asked for what is not there, the study leaves out the figure,
    section or text that asks: a study of which only some cases are run, or diverge, shows what there is.
    """

    def __init__(self, options: StudyOptions, *, console: Console | None = None) -> None:
        self._options = options
        self._console = console
        self._shown: Callable[[float], None] = _ignore
        self.runs: dict[str, RunResult] = {}
        self.numbers: dict[str, dict[str, Any]] = {}
        self.sections: dict[str, Any] = {}
        self.diverged: dict[str, str] = {}
        self.remarks: dict[str, list[str]] = {}

    def __getitem__(self, case: str) -> RunResult:
        """The completed run of a case."""
        if case not in self.runs:
            raise MissingError(f"case {case}")
        return self.runs[case]

    def numbers_of(self, case: str) -> dict[str, Any]:
        """The numbers of a completed case."""
        return self.numbers[self[case].name]

    def among(self, cases: Iterable[str] | None = None) -> list[RunResult]:
        """Those of the named cases (all unless given) that were completed, in the order in which they ran; at least one."""
        wanted = None if cases is None else list(cases)
        found = [run for name, run in self.runs.items() if wanted is None or name in wanted]
        if not found:
            raise MissingError("any case" if wanted is None else f"any of the cases {', '.join(wanted)}")
        return found

    def section(self, name: str) -> Any:
        """The value of a sweep (the list of its points' values) or section that is done."""
        if name not in self.sections:
            raise MissingError(f"section {name}")
        return self.sections[name]

    def rows(self, cases: Sequence[str] | None = None) -> Rows:
        """Rows for a table of the cases (all unless given) that were tried.

        A case that was not completed says so behind its name, and shows no numbers.
        """
        rows: dict[str, Mapping[str, Any] | None] = {}
        for name, numbers in self.numbers.items():
            if cases is None or name in cases:
                completed = numbers["status"] == "completed"
                rows[name if completed else f"{name} ({numbers['status']})"] = numbers if completed else None
        return rows

    def simulate(self, plant: Plant | LinearPlant, controller: Controller, *, name: str, **settings: Any) -> RunResult:
        """`invtrack.simulate` with the study's timestep, seed and progress, its warnings and the limits that acted kept as remarks.

        settings: further arguments, or others in place of these. Raises DivergedError where the run diverges.
        """
        result = self.tried(plant, controller, name=name, **settings)
        if result.status == "diverged":
            raise DivergedError(f"{name} diverged: {result.message}")
        return result

    def tried(self, plant: Plant | LinearPlant, controller: Controller, *, name: str, **settings: Any) -> RunResult:
        """The same, with a run that diverged returned as it is."""
        given = {"timestep": self._options.timestep, "seed": self._options.seed, "progress": self.report, **settings}
        with self._heard(name):
            result = simulate(plant, controller, name=name, **given)
        for text in _limits_that_acted(result):
            self._remark(name, text)
        return result

    @contextmanager
    def _heard(self, name: str) -> Iterator[None]:
        """Keep what a simulation warns of as remarks; that it will take long is said at once, everything else in the report."""
        others: list[tuple[Any, type[Warning], str, int]] = []

        def hear(
            message: Warning | str,
            category: type[Warning],
            filename: str,
            lineno: int,
            file: TextIO | None = None,
            line: str | None = None,
        ) -> None:
            text = str(message)
            if not issubclass(category, RuntimeWarning):
                others.append((message, category, filename, lineno))
            elif self._remark(name, text) and issubclass(category, LongRunWarning) and not self._options.quiet:
                print(f"{name}: {text}", file=sys.stderr)

        with warnings.catch_warnings():
            warnings.simplefilter("always", RuntimeWarning)
            warnings.showwarning = hear
            yield
        for message, category, filename, lineno in others:
            warnings.warn_explicit(message, category, filename, lineno)

    def _remark(self, name: str, text: str) -> bool:
        """Keep a remark on a case; whether it is a new one."""
        known = self.remarks.setdefault(name, [])
        if text in known:
            return False
        known.append(text)
        return True

    def report(self, share: float) -> None:
        """Show what share, from 0 to 1, of the activity that runs is done: the `progress` of a simulation or a sweep."""
        self._shown(share)

    @contextmanager
    def activity(self, description: str) -> Iterator[None]:
        """Show this description and how far the simulations made meanwhile have come."""
        if self._options.quiet:
            yield
            return
        with progress(description, console=self._console) as report:
            self._shown = report
            try:
                yield
            finally:
                self._shown = _ignore


@contextmanager
def progress(
    description: str, *, total: int | None = None, unit: str = "", console: Console | None = None
) -> Iterator[Callable[[float], None]]:
    """Show how far a piece of work has come; yields `report(fraction)`, fraction from 0 to 1.

        with progress("exact inversion") as report:
            for k in range(N):
                ...
                report((k + 1) / N)

    The bar goes to stderr, is erased at the end, and nothing is written where that is no terminal. Reports may come often: they are
    passed on ten times a second. Work that makes no report shows the time that it has taken so far. Where the work is a `total`
    of pieces called `unit`, it shows how many of them are done, and how many a second since the first report.
    """
    from rich.console import Console  # a study reads its options without it

    console = console or Console(file=sys.stderr)
    if not console.is_terminal:
        yield _ignore
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    pieces = TextColumn("{task.fields[pieces]}", markup=False)
    with Progress(*columns, pieces, console=console, transient=True) as bar:
        task = bar.add_task(description, total=None, pieces="")
        next_update = began = time.monotonic()
        first: float | None = None

        def report(fraction: float) -> None:
            nonlocal next_update, first
            now = time.monotonic()
            first = fraction if first is None else first
            if now >= next_update or fraction >= 1:
                next_update = now + SECONDS_BETWEEN_UPDATES
                done = "" if total is None else f"{round(fraction * total)} of {total} {unit}"
                if total is not None and now > began and fraction > first:
                    done += f", {total * (fraction - first) / (now - began):.3g} {unit}/s"
                bar.update(task, total=1.0, completed=min(max(fraction, 0.0), 1.0), pieces=done)

        yield report


def _limits_that_acted(result: RunResult) -> list[str]:
    """One text for each limit and contact: when it first acted in the run, and how often."""
    found: dict[str, list[Event]] = {}
    for event in result.events:
        if event.kind in ("limit", "contact"):
            found.setdefault(event.text.partition(", ")[0], []).append(event)
    return [
        f"in the run: {first.text} (from t = {first.time:.6g} s)" + (f", and {len(later)} times more" if later else "")
        for first, *later in found.values()
    ]


def _ignore(fraction: float) -> None:
    """Where nothing is shown."""
