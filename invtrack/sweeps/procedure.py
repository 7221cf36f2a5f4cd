"""What is done at each point of a sweep, in whatever thread or process it runs."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from invtrack.arrays import Array
from invtrack.errors import InvtrackError
from invtrack.results.result import RunResult
from invtrack.sweeps.design import Value
from invtrack.sweeps.row import Outcome, outcome_of

Study = Callable[..., Any]
"""From (point, seed), or (point, seed, prepared) where something is prepared, to a RunResult or to numbers by name."""

KEPT = 2
"""Preparations that a process keeps: a worker of a cluster serves one sweep after the other."""


@dataclass
class _Prepared:
    """What one process prepared for one sweep: made by the first thread that needs it, while the others wait."""

    lock: threading.Lock = field(default_factory=threading.Lock)
    values: list[Any] = field(default_factory=list)


_prepared: OrderedDict[str, _Prepared] = (
    OrderedDict()
)  # by the study's hash; functions that are sent to workers have no other memory
_prepared_lock = threading.Lock()


@dataclass(frozen=True, eq=False)
class Procedure:
    """The study with all that decides its rows.

    Args:
        study: the user's function.
        prepare: makes what is common to all points, once in each process; None where there is no such thing.
        numbers: what is kept of a run.
        error_times: where the error of a run is kept too (m,) [s].
        hash: of all this.
    """

    study: Study
    prepare: Callable[[], Any] | None
    numbers: Callable[[RunResult], Mapping[str, Any]]
    error_times: Array | None
    hash: str

    def outcome(self, point: Mapping[str, Value], seed: int) -> Outcome:
        """What comes of a point: what executors run."""
        return self.run(point, seed)[0]

    def run(self, point: Mapping[str, Value], seed: int) -> tuple[Outcome, RunResult | None]:
        """What comes of a point, and the run, where the study returns one.

        An InvtrackError of the study makes a refused row. One of `prepare` concerns all points and is raised.
        """
        given = () if self.prepare is None else (self._prepared(self.prepare),)
        try:
            returned = self.study(dict(point), seed, *given)
        except InvtrackError as error:
            return Outcome("refused", str(error)), None
        if not isinstance(returned, RunResult):
            return outcome_of(returned), None
        return self._measured(returned), returned

    def _measured(self, run: RunResult) -> Outcome:
        """What is kept of a run."""
        traces = {} if self.error_times is None else errors_at(run, self.error_times)
        if run.status == "diverged":
            return Outcome("diverged", run.message, {}, traces)
        try:
            numbers = self.numbers(run)
        except InvtrackError as error:  # such as a run that is too short for what is asked of it
            return Outcome("refused", str(error), {}, traces)
        measured = outcome_of(numbers)
        return replace(measured, traces={**measured.traces, **traces})

    def _prepared(self, prepare: Callable[[], Any]) -> Any:
        with _prepared_lock:
            place = _prepared.setdefault(self.hash, _Prepared())
            _prepared.move_to_end(self.hash)
            while len(_prepared) > KEPT:
                _prepared.popitem(last=False)
        with place.lock:
            if not place.values:
                place.values.append(prepare())
        return place.values[0]


def errors_at(run: RunResult, times: Array) -> dict[str, Array]:
    """y - y_d of each output at these times (m,) [s], linear between samples; NaN before and after the run."""
    error = run.error
    return {
        f"error_{name}": np.interp(times, run.time, error[:, i], left=np.nan, right=np.nan)
        for i, name in enumerate(run.output.channels.names)
    }
