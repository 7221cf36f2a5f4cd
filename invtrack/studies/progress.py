"""A progress bar for work that takes longer than a second or two."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

SECONDS_BETWEEN_UPDATES = 0.1  # a report from every physics step would cost more than the step


@contextmanager
def progress(description: str, *, console: Console | None = None) -> Iterator[Callable[[float], None]]:
    """Show how far a piece of work has come; yields `report(fraction)`, fraction from 0 to 1.

        with progress("exact inversion") as report:
            for k in range(N):
                ...
                report((k + 1) / N)

    The bar goes to stderr, is erased at the end, and nothing is written where that is no terminal. Reports may come often: they are
    passed on ten times a second. Work that makes no report shows the time that it has taken so far.
    """
    console = console or Console(file=sys.stderr)
    if not console.is_terminal:
        yield lambda fraction: None
        return
    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(description, total=None)
        next_update = time.monotonic()

        def report(fraction: float) -> None:
            nonlocal next_update
            now = time.monotonic()
            if now >= next_update or fraction >= 1:
                next_update = now + SECONDS_BETWEEN_UPDATES
                bar.update(task, total=1.0, completed=min(max(fraction, 0.0), 1.0))

        yield report
