"""Tables of numbers in CSV files, and files that appear complete or not at all."""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.errors import FileError

CHUNK = 50_000
"""Rows that are turned from text to numbers, or back, together: memory stays linear in the table, with a small factor."""

THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2}(,\d{3})+")
"""A number in which commas may set off thousands."""


@dataclass(frozen=True)
class Header:
    """Texts of a header row, or "column 1", "column 2", ... where the file has none; stated: whether it has one."""

    texts: tuple[str, ...]
    stated: bool


@dataclass(frozen=True, eq=False)
class Table:
    """columns: header texts of the chosen columns; values (m, k); lines (m,): line of the file of each row; comments without #."""

    columns: tuple[str, ...]
    values: Array
    lines: NDArray[np.int64]
    comments: tuple[str, ...]


def read_table(path: str | Path, choose: Callable[[Header], Sequence[int]]) -> Table:
    """Rows of numbers, with or without one header row; blank lines and lines that begin with # may stand anywhere.

    Cells are separated by commas, semicolons or tabs. Between semicolons or tabs a comma may be the decimal sign, if no cell has a
    point, and at least one of the numbers cannot be read with thousands set off by commas.

    choose: from the header to the numbers of the columns to read, in the order wanted; the others may hold anything.

    Raises FileError, naming file and line, where the file cannot be read, has no rows, a row has another number of cells than the
    header, a chosen cell is not a finite number, or its commas could mean two things.
    """
    path = Path(path)
    comments: list[str] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = _content(file, comments)
            opening = list(islice(rows, 2))
            if not opening:
                raise FileError(f"{path} is empty; expected a header row with the columns' names and rows of numbers below it")
            cells = _Cells(path, _delimiter([text for _, text in opening]))
            header = cells.header(opening[0][1])
            if len(set(header.texts)) != len(header.texts):
                raise FileError(f"{path} names a column twice; expected distinct names, got: {', '.join(header.texts)}")
            chosen = list(choose(header))
            rows = chain(opening[1:] if header.stated else opening, rows)
            blocks: list[Array] = []
            lines: list[int] = []
            while block := list(islice(rows, CHUNK)):
                blocks.append(cells.numbers(header.texts, chosen, block))
                lines.extend(number for number, _ in block)
            cells.require_clear_commas()
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror}; expected a CSV file") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path} is not a CSV file in UTF-8: {error}") from error
    if not lines:
        raise FileError(f"{path} has a header row but no rows of numbers below it")
    names = tuple(header.texts[i] for i in chosen)
    return Table(names, np.concatenate(blocks), np.array(lines, dtype=np.int64), tuple(comments))


def write_table(path: str | Path, columns: Sequence[str], values: Array, comments: Sequence[str] = ()) -> None:
    """Header row, then `comments` behind #, then the rows with 17 significant digits, from which the same bits are read back.

    The header comes first, because many readers take the first line for it whatever it begins with.

    Raises FileError where the file cannot be written.
    """
    row_format = ",".join(["%.17g"] * len(columns)) + "\n"
    with replaced_when_complete(path) as draft, draft.open("wb") as file:
        file.write((",".join(_quoted(text) for text in columns) + "\n").encode())
        file.writelines(f"# {comment}\n".encode() for comment in comments)
        for first in range(0, len(values), CHUNK):
            rows = values[first : first + CHUNK].tolist()
            file.write("".join([row_format % tuple(row) for row in rows]).encode())


@contextmanager
def replaced_when_complete(path: str | Path) -> Iterator[Path]:
    """A draft to write to that takes the name `path` once all is written, so that the name never shows a part.

    Raises FileError where that fails; whatever stood at `path` before then still does.
    """
    path = Path(path)
    if path.is_dir():  # found out before the work rather than after it
        raise FileError(f"cannot write {path}: a folder has that name; choose another one")
    # Beside its target, because a rename is atomic only within one file system.
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        try:
            yield draft
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror or error}; expected a writable folder with enough space") from error


def _content(file: Iterable[str], comments: list[str]) -> Iterator[tuple[int, str]]:
    """(line, text) of each row; comment lines go to `comments`."""
    for line, text in enumerate(file, start=1):
        if text.startswith("#"):
            comments.append(text[1:].strip())
        elif text.strip():
            yield line, text


def _delimiter(lines: Sequence[str]) -> str:
    """What separates the cells: a semicolon or a tab that all lines have outside quotes, else a comma."""
    bare = [re.sub(r'"[^"]*"', "", line) for line in lines]
    return next((mark for mark in ";\t" if all(mark in line for line in bare)), ",")


@dataclass(eq=False)
class _Cells:
    """Cells of a file's lines, and what its numbers have shown so far of the meaning of commas in them.

    with_point, with_comma: lines with a cell that has a decimal point, and a comma; clear: whether some comma is the decimal sign
    for certain.
    """

    path: Path
    delimiter: str
    with_point: int = 0
    with_comma: int = 0
    clear: bool = False

    def header(self, text: str) -> Header:
        """The header in the first line, or that of a file whose first line is numbers already."""
        texts = self.split(text)
        stated = not all(map(self._is_number, texts))
        return Header(tuple(texts) if stated else tuple(f"column {i}" for i in range(1, len(texts) + 1)), stated)

    def split(self, text: str) -> list[str]:
        """The cells of a line."""
        return [cell.strip() for cell in next(csv.reader([text], delimiter=self.delimiter), [])]

    def numbers(self, header: Sequence[str], chosen: list[int], block: list[tuple[int, str]]) -> Array:
        """The chosen cells of some rows (m, k)."""
        if self.delimiter == "," and all(text.count(",") == len(header) - 1 and '"' not in text for _, text in block):
            try:
                values: Array = np.loadtxt([text for _, text in block], delimiter=",", usecols=chosen, comments=None, ndmin=2)
            except ValueError:
                pass  # some cell is to blame: looked for below
            else:
                if np.all(np.isfinite(values)):
                    return values
        return np.array([self._row(line, header, chosen, self.split(text)) for line, text in block])

    def require_clear_commas(self) -> None:
        """Raises FileError where all numbers with commas could as well be whole ones with their thousands set off."""
        if self.with_comma and not self.clear:
            raise FileError(
                f"{self.path}, line {self.with_comma}: a comma there may be the decimal sign or set off thousands; write the "
                "numbers with decimal points and without commas"
            )

    def _row(self, line: int, header: Sequence[str], chosen: list[int], cells: list[str]) -> list[float]:
        """The chosen cells of one row, with what is wrong with them."""
        if len(cells) != len(header):
            expected = f"{len(header)} cells as in the {'header' if header[0] != 'column 1' else 'first'} row"
            raise FileError(f"{self.path}, line {line}: expected {expected}, got {len(cells)}")
        numbers = []
        for i in chosen:
            cell = cells[i]
            if self.delimiter != ",":
                self._note_marks(line, cell)
                cell = cell.replace(",", ".")
            try:
                numbers.append(float(cell))
            except ValueError:
                numbers.append(np.nan)
            if not np.isfinite(numbers[-1]):
                raise FileError(f"{self.path}, line {line}, column {header[i]!r}: expected a finite number, got {cells[i]!r}")
        return numbers

    def _note_marks(self, line: int, cell: str) -> None:
        self.with_point = self.with_point or ("." in cell) * line
        if "," in cell:
            self.with_comma = self.with_comma or line
            self.clear = self.clear or THOUSANDS.fullmatch(cell) is None
        if self.with_point and self.with_comma:
            raise FileError(
                f"{self.path}, line {line}: expected one decimal sign throughout, got a comma in line {self.with_comma} and a "
                f"point in line {self.with_point}; write all numbers with decimal points and without commas"
            )

    def _is_number(self, cell: str) -> bool:
        try:
            return bool(np.isfinite(float(cell.replace(",", ".") if self.delimiter != "," else cell)))
        except ValueError:
            return False


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',"\n\r') else text
