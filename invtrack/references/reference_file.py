"""References from CSV files: which column is what, and in which unit."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from invtrack.arguments import file_path, require_text, texts
from invtrack.channels import Channels
from invtrack.errors import FileError, TrajectoryError
from invtrack.files import Header, read_table
from invtrack.references.samples import require_increasing, sampled_reference
from invtrack.references.signal import PiecewiseSignal
from invtrack.references.unit_conversion import Factor, conversion, is_unit

TIMES = ("time", "t")
"""What the column of times is called unless stated, in small or capital letters."""

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
        first = _time_column(path, header, time)
        others = _value_columns(path, header, first, channels)
        factors.append(_factor(path, header, first, "s"))
        units = [""] * len(others) if channels is None else channels.units
        factors.extend(_factor(path, header, i, unit) for i, unit in zip(others, units, strict=True))
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


def _time_column(path: Path, header: Header, time: str | None) -> int:
    if not header.stated:
        if time is not None:
            raise FileError(f"{path} has no header row, so none named {time!r}; leave `time` out: the first column is the time")
        return 0
    if time is not None:
        return _column(path, header, time)
    names = [_name_and_unit(text)[0].casefold() for text in header.texts]
    for name in TIMES:
        if names.count(name) == 1:
            return names.index(name)
    listed = ", ".join(header.texts)
    raise FileError(
        f"{path} has no column, or more than one, named 'time' or 't'; say which with time=..., its columns are: {listed}"
    )


def _value_columns(path: Path, header: Header, first: int, channels: Channels | None) -> list[int]:
    others = [i for i in range(len(header.texts)) if i != first]
    if channels is None:
        wanted = [i for i in others if header.texts[i].startswith(WANTED)]
        return wanted or others
    if header.stated:
        return [_column(path, header, name) for name in channels.names]
    if len(others) != len(channels):
        raise FileError(
            f"{path} has no header row, so its {len(others)} column(s) beside the time are the outputs in their order; expected "
            f"{len(channels)}, for {channels}"
        )
    return others


def _column(path: Path, header: Header, wanted: str) -> int:
    """Number of the column with this header text, or this text before its unit, by itself or as the wanted output of a plan."""
    names = [_name_and_unit(text)[0] for text in header.texts]
    for found in (header.texts, names, [name.removeprefix(WANTED) for name in names]):
        matches = [i for i, text in enumerate(found) if text == wanted]
        if matches:
            break
    if len(matches) != 1:
        count = f"{len(matches)} columns" if matches else "no column"
        raise FileError(f"{path} has {count} named {wanted!r}; its columns are: {', '.join(header.texts)}")
    return matches[0]


def _factor(path: Path, header: Header, column: int, to: str) -> Factor:
    """From the unit in the header to the one wanted; an unknown one of either is taken for the other."""
    unit = _name_and_unit(header.texts[column])[1] if header.stated else ""
    factor = conversion(unit or to, to or unit)
    if factor is None:
        raise FileError(
            f"{path}: expected the column {header.texts[column]!r} in [{to}] or a unit that converts to it for certain; convert "
            f"its values to [{to}] and say so in the header"
        )
    return factor


def _name_and_unit(text: str) -> tuple[str, str]:
    """("tip", "m") from "tip [m]", and where it is a unit from "tip (m)" and "tip/m"; the unit is empty where none is given."""
    for opening, closing in ("[]", "()"):
        name, bracket, unit = text.rpartition(opening)
        if bracket and unit.endswith(closing) and (opening == "[" or is_unit(unit[:-1].strip())):
            return name.strip(), unit[:-1].strip()
    name, slash, unit = text.partition("/")
    return (name.strip(), unit.strip()) if slash and name.strip() and is_unit(unit.strip()) else (text, "")
