"""The rows of a sweep on disk: part files of one Parquet dataset, whole or not there, and one file in the end.

<out>/study=<hash>/part-00000012-3f2a90c1.parquet   some rows, as they came
<out>/study=<hash>/rows.parquet                     all rows of the design, in its order
<out>/study=<hash>/earlier.parquet                  rows of earlier designs of the same study that this one does not have
"""

from __future__ import annotations

import uuid
import warnings
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from invtrack.errors import FileError, SweepError
from invtrack.files import replaced_when_complete
from invtrack.sweeps.row import Row

ROWS, EARLIER, PART = "rows.parquet", "earlier.parquet", "part-*.parquet"

PARAMETER, NUMBER, TRACE = "parameter", "number", "trace"
"""What a column is, under "invtrack" in its metadata."""

OWN = pa.schema(
    [
        pa.field("index", pa.int64(), nullable=False),
        pa.field("key", pa.string(), nullable=False),
        pa.field("seed", pa.int64(), nullable=False),
        pa.field("status", pa.string(), nullable=False),
        pa.field("reason", pa.string(), nullable=False),
        pa.field("digest", pa.string(), nullable=False),
    ]
)

_KINDS: dict[type, Any] = {bool: pa.bool_(), int: pa.int64(), float: pa.float64(), str: pa.string()}


class Dataset:
    """The rows of one study in one folder. One sweep at a time writes to it.

    Every row carries a digest of itself, and every page a checksum: what a file says is taken only where both agree.

    Raises FileError where the folder cannot be made or read.
    """

    def __init__(self, out: Path, study: str) -> None:
        self.folder = out / f"study={study}"
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            for draft in self.folder.glob(".*.tmp"):  # of a sweep that was killed as it wrote
                draft.unlink(missing_ok=True)
        except OSError as error:
            raise FileError(f"expected a folder for rows at {self.folder}, which cannot be made ready: {error.strerror}") from error

    @property
    def path(self) -> Path:
        """Where all rows are once the sweep is complete."""
        return self.folder / ROWS

    def rows(self) -> dict[str, Row]:
        """All rows that are there, by key. What is damaged is left out with a RuntimeWarning: it is computed again."""
        found: dict[str, Row] = {}
        for path in self._files():
            rows, damage = _read(path)
            found.update((row.key, row) for row in rows)
            if damage:
                warnings.warn(
                    f"{path} is damaged ({damage}); rows that only it holds are computed again", RuntimeWarning, stacklevel=4
                )
        return found

    def add(self, rows: Sequence[Row]) -> None:
        """Put rows into a part file of their own, which is there whole or not at all."""
        _write(self.folder / f"part-{rows[0].index:08d}-{uuid.uuid4().hex[:8]}.parquet", rows)

    def compact(self, rows: Sequence[Row], others: Sequence[Row]) -> None:
        """Put all rows into one file, in this order, and other designs' beside it; then remove the parts."""
        parts = list(self.folder.glob(PART))
        if others:
            _write(self.folder / EARLIER, sorted(others, key=lambda row: row.key))
        else:
            parts.append(self.folder / EARLIER)
        _write(self.path, rows)
        for path in parts:
            path.unlink(missing_ok=True)

    def _files(self) -> list[Path]:
        named = [self.folder / EARLIER, self.path]
        return [*sorted(self.folder.glob(PART)), *(path for path in named if path.exists())]


def _write(path: Path, rows: Sequence[Row]) -> None:
    with replaced_when_complete(path) as draft:
        pq.write_table(table_of(rows), draft, compression="zstd", write_page_checksum=True)


def table_of(rows: Sequence[Row]) -> pa.Table:
    """Rows as a table: columns that all rows have, the parameters, then numbers and traces, each in the order of their names.

    So the columns are the same in whatever order rows were computed and read.

    Raises SweepError for a number that is a text in another row.
    """
    own = {
        "index": [row.index for row in rows],
        "key": [row.key for row in rows],
        "seed": [row.seed for row in rows],
        "status": [row.status for row in rows],
        "reason": [row.reason for row in rows],
        "digest": [row.digest for row in rows],
    }
    fields, columns = list(OWN), [pa.array(own[field.name], field.type) for field in OWN]
    for what, attribute in ((PARAMETER, "point"), (NUMBER, "numbers"), (TRACE, "traces")):
        names = {name for row in rows for name in getattr(row, attribute)}
        for name in rows[0].point if what == PARAMETER else sorted(names):
            values = [getattr(row, attribute).get(name) for row in rows]
            kind = pa.list_(pa.float64()) if what == TRACE else _kind(name, values)
            fields.append(pa.field(name, kind, metadata={"invtrack": what}))
            columns.append(pa.array(values, kind))
    return pa.table(columns, schema=pa.schema(fields))


def _kind(name: str, values: Iterable[Any]) -> Any:
    kinds = {type(value) for value in values if value is not None}
    if len(kinds) > 1:
        raise SweepError(
            f"{name!r} is {' and '.join(sorted(kind.__name__ for kind in kinds))} in different rows; expected one kind of value"
        )
    return _KINDS[kinds.pop()] if kinds else pa.float64()


def _read(path: Path) -> tuple[list[Row], str]:
    """The rows of a file that are what was written, and what is wrong with the others."""
    try:
        content = path.read_bytes()
    except OSError as error:
        raise FileError(f"cannot read {path}, which may hold rows of this sweep: {error.strerror}") from error
    try:
        table = pq.read_table(pa.BufferReader(content), page_checksum_verification=True)
        whole = [row for row, digest in _rows_in(table) if row.digest == digest]
    except (pa.ArrowException, OSError, ValueError, KeyError, TypeError) as error:
        return [], f"it cannot be read: {str(error).splitlines()[0] if str(error) else type(error).__name__}"
    lost = table.num_rows - len(whole)
    return whole, f"{lost} of {table.num_rows} rows are not what was written" if lost else ""


def _rows_in(table: pa.Table) -> Iterable[tuple[Row, str]]:
    """Each row of a table, and the digest that it had when it was written."""
    by_kind: dict[str, list[str]] = {PARAMETER: [], NUMBER: [], TRACE: []}
    for field in table.schema:
        if field.metadata and b"invtrack" in field.metadata:
            by_kind[field.metadata[b"invtrack"].decode()].append(field.name)
    traces = {name: _lists(table[name]) for name in by_kind[TRACE]}
    for i, cells in enumerate(table.drop_columns(by_kind[TRACE]).to_pylist()):
        row = Row(
            index=cells["index"],
            point={name: cells[name] for name in by_kind[PARAMETER]},
            seed=cells["seed"],
            status=cells["status"],
            reason=cells["reason"],
            numbers={name: cells[name] for name in by_kind[NUMBER]},
            traces={name: values[i] for name, values in traces.items() if values[i] is not None},
        )
        yield row, cells["digest"]


def _lists(column: Any) -> list[Any]:
    """The arrays in a column of lists, None where there is none."""
    return [None if cell.values is None else cell.values.to_numpy(zero_copy_only=False).astype(np.float64) for cell in column]
