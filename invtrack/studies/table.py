"""One table of results for the terminal, a file or a pipe."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from invtrack.arguments import by_name, instance, items, require_text
from invtrack.errors import InvtrackError

if TYPE_CHECKING:
    from rich.console import Console

Cell = float | int | str | None
Rows = Mapping[str, Mapping[str, Any] | None]
"""Cells by the key of their column, by row; other keys are not shown. A row that is None has nothing to show.

Texts by the key of a column under "notes" say what a cell of the row stands for, or why it holds nothing; they follow below the
table."""

GAP = "  "


@dataclass(frozen=True)
class Column:
    """One column: the name in its header, its unit ("" for text and counts) and the key of its values in each row.

    Without a key it is the name with underscores: Column("max error", "m") shows the rows' "max_error".

    Raises InvtrackError for what is no text.
    """

    name: str
    unit: str = ""
    key: str = ""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require_text(f"a column's {name}", value, error=InvtrackError)
        object.__setattr__(self, "key", self.key or self.name.replace(" ", "_"))


def print_table(
    title: str, *, columns: Sequence[Column], rows: Rows, row_header: str = "case", console: Console | None = None
) -> None:
    """Print one row per case and one column per quantity, units in the header, numbers to three significant digits.

    Where the output is too narrow, the columns that do not fit follow below with the cases repeated: no number is ever cut off. No
    control codes are written unless the output is a terminal.

    Args:
        title: above the table; none where it is empty.
        columns: the quantities.
        rows: cells by case; a value that is None, not defined, prints as a dash, and so does all of a row that is None.
        row_header: what the cases' own column is called.
        console: where it is printed; standard output unless given.

    Raises InvtrackError where a row has no value for a column.
    """
    for name, value in (("title", title), ("row_header", row_header)):
        require_text(name, value, error=InvtrackError)
    columns = items("columns", columns, expected="a list of Column", error=InvtrackError)
    for column in columns:
        instance("a column", column, Column, expected="an invtrack.studies.Column", error=InvtrackError)
    for case, row in by_name("rows", rows, expected="rows by the names of cases", error=InvtrackError).items():
        if row is not None:
            by_name(f"row {case!r}", row, expected="cells by the keys of columns", error=InvtrackError)
    from rich.console import Console  # a study reads its options without it

    console = (
        Console() if console is None else instance("console", console, Console, expected="a rich Console", error=InvtrackError)
    )
    headers = [_header_lines(column) for column in columns]
    height = max((len(header) for header in headers), default=1)
    cases = _padded([row_header], list(rows), height, left=True)
    blocks = [_padded(header, _cells(column, rows), height) for header, column in zip(headers, columns, strict=True)]
    if title:
        _print_line(console, title, "italic")
    for group in _groups(cases, blocks, console.width):
        lines = [GAP.join(parts).rstrip() for parts in zip(cases, *group, strict=True)]
        rule = "─" if console.encoding.startswith("utf") else "-"
        for line in filter(None, lines[:height]):
            _print_line(console, line, "bold")
        _print_line(console, rule * max(len(line) for line in lines))
        for line in lines[height:]:
            _print_line(console, line)
        _print_line(console, "")
    notes = _notes(columns, rows)
    for note in notes:
        _print_line(console, note)
    if notes:
        _print_line(console, "")


def short_number(value: float) -> str:
    """A number to three significant digits: plain from 0.01 to 1000, otherwise with a short exponent such as 6.02e-7; zero is 0."""
    if not math.isfinite(value):
        return str(value)
    rounded = float(f"{value:.2e}")
    if rounded == 0 or 0.01 <= abs(rounded) < 1000:
        return f"{rounded:#.3g}".rstrip(".") if rounded else "0"
    mantissa, exponent = f"{value:.2e}".split("e")
    return f"{mantissa}e{int(exponent)}"


def _print_line(console: Console, line: str, style: str = "") -> None:
    from rich.text import Text

    # As Text, because rich reads "[m]" in a plain string as markup; soft_wrap, because it would break or cut a long line.
    console.print(Text(line, style=style), soft_wrap=True)


def _header_lines(column: Column) -> list[str]:
    """The name, one word to a line, and its unit: columns stay as narrow as their numbers."""
    return column.name.split() + ([f"[{column.unit}]"] if column.unit else [])


def _cells(column: Column, rows: Rows) -> list[str]:
    cells = []
    for case, row in rows.items():
        if row is not None and column.key not in row:
            raise InvtrackError(f"row {case!r} has no value {column.key!r}; it has: {', '.join(row) or 'none'}")
        value: Cell = None if row is None else row[column.key]
        cells.append(short_number(value) if isinstance(value, float) else "-" if value is None else str(value))
    return cells


def _notes(columns: Sequence[Column], rows: Rows) -> list[str]:
    """What rows say of the cells shown, once for all rows of which the same is said."""
    said: dict[tuple[str, str], list[str]] = {}
    for column in columns:
        for case, row in rows.items():
            note = (row or {}).get("notes", {}).get(column.key)
            if note:
                said.setdefault((column.name, note), []).append(case)
    return [f"{name} ({', '.join(cases)}): {note}" for (name, note), cases in said.items()]


def _padded(header: Sequence[str], cells: Sequence[str], height: int, *, left: bool = False) -> list[str]:
    """Header, bottom-aligned in `height` lines, and cells, all of one width."""
    lines = [""] * (height - len(header)) + [*header, *cells]
    width = max(len(line) for line in lines)
    return [line.ljust(width) if left else line.rjust(width) for line in lines]


def _groups(cases: list[str], blocks: Sequence[list[str]], width: int) -> list[list[list[str]]]:
    """The columns in groups that fit beside the cases in `width` characters, at least one column in each."""
    groups: list[list[list[str]]] = [[]]
    used = len(cases[0])
    for block in blocks:
        needed = len(GAP) + len(block[0])
        if groups[-1] and used + needed > width:
            groups.append([])
            used = len(cases[0])
        groups[-1].append(block)
        used += needed
    return groups
