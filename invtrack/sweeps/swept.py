"""What a sweep gives back: its rows, columns of them, and each one again with its recording."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from invtrack.arguments import file_path, instance
from invtrack.arrays import Array, whole_number
from invtrack.errors import SweepError
from invtrack.frames import data_frame
from invtrack.results.result import RunResult
from invtrack.sweeps.design import Design
from invtrack.sweeps.procedure import Procedure
from invtrack.sweeps.row import Row


@dataclass(frozen=True, eq=False)
class Replay:
    """One row run again. run: None where the study returns numbers alone. same: whether it is the row's outcome bit for bit."""

    row: Row
    run: RunResult | None
    same: bool


@dataclass(frozen=True, eq=False)
class Swept:
    """The rows of a sweep, in the order of its design.

    Args:
        design: the points.
        rows: one for each point.
        procedure: what was done at each of them.
        path: the Parquet file that holds the same rows.
        computed: how many rows this call computed; the others were there already.
        runs_per_second: at which it did; None where it computed none.
    """

    design: Design
    rows: tuple[Row, ...]
    procedure: Procedure
    path: Path
    computed: int
    runs_per_second: float | None

    def __repr__(self) -> str:
        """What it is, without its rows."""
        counts = ", ".join(f"{count} {status}" for status, count in self.counts.items())
        return f"<Swept {len(self.rows)} rows ({counts}) over {', '.join(self.design.parameters)}, {self.path}>"

    @property
    def study(self) -> str:
        """The study's hash."""
        return self.procedure.hash

    @property
    def error_times(self) -> Array | None:
        """Times (m,) [s] of the errors in each row."""
        return self.procedure.error_times

    @property
    def counts(self) -> Mapping[str, int]:
        """Rows by status."""
        return dict(Counter(row.status for row in self.rows))

    @property
    def completed(self) -> NDArray[np.bool_]:
        """Which rows are of completed runs, (rows,)."""
        return np.array([row.status == "completed" for row in self.rows])

    def numbers(self, name: str) -> Array:
        """A parameter or a number of each row, (rows,); NaN where it is not defined. Raises SweepError where it is none."""
        cells = [row.point[name] if name in row.point else row.numbers.get(name) for row in self.rows]
        known = [*self.design.parameters, *dict.fromkeys(name for row in self.rows for name in row.numbers)]
        if name not in known:
            raise SweepError(f"no parameter or number named {name!r}; there are: {', '.join(known)}")
        if any(isinstance(cell, str) for cell in cells):
            raise SweepError(f"{name!r} is a text, expected the name of a number; read texts from the rows")
        return np.array([np.nan if cell is None else cell for cell in cells], dtype=float)

    def traces(self, name: str) -> Array:
        """A list in each row, such as "error_tip_position", as (rows, m); NaN in rows without it.

        Raises SweepError where no row has it, or rows have it in different lengths.
        """
        found = [row.traces.get(name) for row in self.rows]
        lengths = {len(values) for values in found if values is not None}
        if len(lengths) != 1:
            known = ", ".join(dict.fromkeys(name for row in self.rows for name in row.traces)) or "none"
            raise SweepError(
                f"the lists {name!r} have {sorted(lengths)} entries in different rows, expected one length"
                if lengths
                else f"no row has a list {name!r}; there are: {known}; a sweep that is given error_times keeps errors"
            )
        (length,) = lengths
        return np.array([np.full(length, np.nan) if values is None else values for values in found])

    def to_pandas(self) -> Any:
        """A pandas.DataFrame of the rows, over their indices: parameters, numbers, seeds, status, reasons; None: not defined.

        Lists such as errors over time are not in it: `traces` gives them. Raises InvtrackError where pandas is not installed.
        """
        names = [*self.design.parameters, *dict.fromkeys(name for row in self.rows for name in row.numbers)]
        columns: dict[str, list[Any]] = {
            name: [row.point[name] if name in row.point else row.numbers.get(name) for row in self.rows] for name in names
        }
        columns |= {name: [getattr(row, name) for row in self.rows] for name in ("seed", "status", "reason")}
        return data_frame(columns, index=[row.index for row in self.rows], index_name="index")

    def replay(self, row: Row | int, *, recording: str | Path | None = None) -> Replay:
        """Run one row again alone: `row`, or the one at this index.

        recording: where the run is recorded. On the machine that computed it the outcome is the row's bit for bit; on others it may
        differ by rounding. Raises SweepError where there is no such row, or where there is to be a
        recording but no run.
        """
        if not isinstance(row, Row):
            row = self.rows[whole_number("row", row, highest=len(self.rows) - 1, error=SweepError)]
        outcome, run = self.procedure.run(row.point, row.seed)
        again = Row.of(row.index, row.point, row.seed, outcome)
        if recording is not None:
            target = file_path(recording)
            if run is None:
                why = (
                    f"it was {again.status}: {again.reason}"
                    if again.reason
                    else "the study returns numbers in place of a RunResult"
                )
                raise SweepError(f"row {row.index} leaves no run to record; {why}")
            from invtrack.recording import save_recording  # loads Rerun, which no other part of a sweep uses

            save_recording(run, target)
        return Replay(again, run, again.equals(row))


def require_swept(value: Any) -> Swept:
    """The value; raises SweepError for what is no result of a sweep."""
    return instance("swept", value, Swept, expected="the result of invtrack.sweeps.sweep", error=SweepError)
