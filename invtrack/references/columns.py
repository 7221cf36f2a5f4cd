"""Which column of a table is what, by the names and units in its header."""

from __future__ import annotations

from pathlib import Path

from invtrack.errors import FileError
from invtrack.files import Header
from invtrack.references.unit_conversion import Factor, conversion, is_unit

TIMES = ("time", "t")
"""What the column of times is called unless stated, in small or capital letters."""


def time_column(path: Path, header: Header, time: str | None) -> int:
    """Number of the column of times: the one named so, or None: called "time" or "t". Raises FileError where it is not there."""
    if not header.stated:
        if time is not None:
            raise FileError(f"{path} has no header row, so none named {time!r}; leave `time` out: the first column is the time")
        return 0
    if time is not None:
        return named_column(path, header, time)
    names = [name_and_unit(text)[0].casefold() for text in header.texts]
    for name in TIMES:
        if names.count(name) == 1:
            return names.index(name)
    listed = ", ".join(header.texts)
    raise FileError(
        f"{path} has no column, or more than one, named 'time' or 't'; say which with time=..., its columns are: {listed}"
    )


def named_column(path: Path, header: Header, wanted: str, *, prefix: str = "") -> int:
    """Number of the column with this header text, or this text before its unit, by itself or behind a prefix.

    Raises FileError where there is not exactly one.
    """
    names = [name_and_unit(text)[0] for text in header.texts]
    for found in (header.texts, names, [name.removeprefix(prefix) for name in names]):
        matches = [i for i, text in enumerate(found) if text == wanted]
        if matches:
            break
    if len(matches) != 1:
        count = f"{len(matches)} columns" if matches else "no column"
        raise FileError(f"{path} has {count} named {wanted!r}; its columns are: {', '.join(header.texts)}")
    return matches[0]


def column_factor(path: Path, header: Header, column: int, to: str) -> Factor:
    """From the unit in the header to the one wanted; an unknown one of either is taken for the other.

    Raises FileError for units between which there is no certain conversion.
    """
    unit = name_and_unit(header.texts[column])[1] if header.stated else ""
    factor = conversion(unit or to, to or unit)
    if factor is None:
        raise FileError(
            f"{path}: expected the column {header.texts[column]!r} in [{to}] or a unit that converts to it for certain; convert "
            f"its values to [{to}] and say so in the header"
        )
    return factor


def name_and_unit(text: str) -> tuple[str, str]:
    """("tip", "m") from "tip [m]", and where it is a unit from "tip (m)" and "tip/m"; the unit is empty where none is given."""
    for opening, closing in ("[]", "()"):
        name, bracket, unit = text.rpartition(opening)
        if bracket and unit.endswith(closing) and (opening == "[" or is_unit(unit[:-1].strip())):
            return name.strip(), unit[:-1].strip()
    name, slash, unit = text.partition("/")
    return (name.strip(), unit.strip()) if slash and name.strip() and is_unit(unit.strip()) else (text, "")
