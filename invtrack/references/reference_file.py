"""References from CSV files: which column is what, and in which unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from invtrack.arguments import file_path, require_text, texts
from invtrack.channels import Channels
from invtrack.errors import FileError, TrajectoryError
from invtrack.files import Header, read_table
from invtrack.references.columns import column_factor, named_column, time_column
from invtrack.references.samples import require_increasing, sampled_reference
from invtrack.references.signal import PiecewiseSignal
from invtrack.references.unit_conversion import Factor

WANTED = "y_d."
"""Begins the columns of the wanted output in a file that `export_plan` wrote."""


def load_reference(
    path: str | Path,
    *,
    time: str | None = None,
    channels: Channels | Sequence[str] | None = None,
    degree: int = 5,
    smoothness: int | None = None,
) -> PiecewiseSignal:
    """`sampled_reference` of the columns of a CSV file; lines that begin with # are skipped.

    Cells are separated by commas, semicolons or tabs, the latter two also with decimal commas. A column is named by its whole
    header text or by what stands there before its unit: "tip" finds "tip [m]", "tip (m)" and "tip/m". Without a header row the
    first column is the time in seconds, and the others are the outputs in their order. Of a file that `export_plan` wrote it is
    the wanted output y_d.

    Args:
        path: the file.
        time: the column of times; None: the one called "time" or "t". Converted to seconds from the unit in the header.
        channels: the columns of values, in the order of the plant's outputs; None: all others. Given with units, as `model.outputs`
            has them, values are converted from the units in the header, "mm" to "m", "deg" to "rad"; a column without unit is in
            that of its channel.
        degree, smoothness: as for `sampled_reference`.

    Raises FileError as `sampled_reference` does, and, naming file and line, where a row has another number of cells than the
    header, a cell is not a finite number, times do not increase, a column is not there, or its unit is not one that can be
    converted for certain.
    """
    path = file_path(path)
    time = None if time is None else require_text("time", time, error=FileError)
    if channels is not None and not isinstance(channels, Channels):
        channels = Channels(texts("channels", channels, expected="a list of names of columns", error=FileError))
    factors: list[Factor] = []

    def choose(header: Header) -> list[int]:
        first = time_column(path, header, time)
        others = _value_columns(path, header, first, channels)
        factors.append(column_factor(path, header, first, "s"))
        units = [""] * len(others) if channels is None else channels.units
        factors.extend(column_factor(path, header, i, unit) for i, unit in zip(others, units, strict=True))
        return [first, *others]

    table = read_table(path, choose)
    if len(table.columns) < 2:
        raise FileError(f"{path}: expected at least one column of values beside {table.columns[0]!r}, got none")
    values = np.column_stack([factor.applied(column) for factor, column in zip(factors, table.values.T, strict=True)])
    try:
        require_increasing(values[:, 0], lambda i: f"line {table.lines[i]}")
        return sampled_reference(values[:, 0], values[:, 1:], degree=degree, smoothness=smoothness)
    except TrajectoryError as error:
        raise FileError(f"{path}: {error}") from error


def _value_columns(path: Path, header: Header, first: int, channels: Channels | None) -> list[int]:
    others = [i for i in range(len(header.texts)) if i != first]
    if channels is None:
        wanted = [i for i in others if header.texts[i].startswith(WANTED)]
        return wanted or others
    if header.stated:
        return [named_column(path, header, name, prefix=WANTED) for name in channels.names]
    if len(others) != len(channels):
        raise FileError(
            f"{path} has no header row, so its {len(others)} column(s) beside the time are the outputs in their order; expected "
            f"{len(channels)}, for {channels}"
        )
    return others
