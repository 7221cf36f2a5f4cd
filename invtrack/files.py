"""Tables of numbers in CSV files, and files that appear complete or not at all."""

from __future__ import annotations

import csv
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from invtrack.arrays import Array
from invtrack.errors import FileError

CHUNK = 50_000
"""Rows that are turned from text to numbers, or back, together: memory stays linear in the table, with a small factor."""


@dataclass(frozen=True, eq=False)
class Table:
    """columns: header texts of the chosen columns; values (m, k); lines (m,): line of the file of each row; comments without #."""

    columns: tuple[str, ...]
    values: Array
    lines: NDArray[np.int64]
    comments: tuple[str, ...]


def read_table(path: str | Path, choose: Callable[[Sequence[str]], Sequence[int]]) -> Table:
    """Comma-separated numbers below one header row; blank lines and lines that begin with # may stand anywhere.

    choose: from the header's texts to the numbers of the columns to read, in the order wanted; the others may hold anything.

    Raises FileError, naming file and line, where the file cannot be read, has no header or no rows, a row has another number
    of cells than the header, or a chosen cell is not a finite number.
    """
    path = Path(path)
    comments: list[str] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = _content(file, comments)
            header = [text.strip() for text in _cells(next(rows, (0, ""))[1])]
            if not header:
                raise FileError(f"{path} is empty; expected a header row with the columns' names and rows of numbers below it")
            if len(set(header)) != len(header):
                raise FileError(f"{path} names a column twice; expected distinct names, got: {', '.join(header)}")
            chosen = list(choose(header))
            blocks: list[Array] = []
            lines: list[int] = []
            while block := list(islice(rows, CHUNK)):
                blocks.append(_numbers(path, header, chosen, block))
                lines.extend(number for number, _ in block)
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror}; expected a CSV file") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise FileError(f"{path} is not a CSV file in UTF-8: {error}") from error
    if not lines:
        raise FileError(f"{path} has a header row but no rows of numbers below it")
    names = tuple(header[i] for i in chosen)
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
    # Beside its target, because a rename is atomic only within one file system.
    draft = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        try:
            yield draft
            os.replace(draft, path)
        finally:
            draft.unlink(missing_ok=True)
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}; expected a writable folder with enough space") from error


def _content(file: Iterable[str], comments: list[str]) -> Iterator[tuple[int, str]]:
    """(line, text) of each row; comment lines go to `comments`."""
    for line, text in enumerate(file, start=1):
        if text.startswith("#"):
            comments.append(text[1:].strip())
        elif text.strip():
            yield line, text


def _cells(text: str) -> list[str]:
    return next(csv.reader([text]), [])


def _numbers(path: Path, header: list[str], chosen: list[int], block: list[tuple[int, str]]) -> Array:
    """The chosen cells of some rows (m, k)."""
    if all(text.count(",") == len(header) - 1 and '"' not in text for _, text in block):
        try:
            values: Array = np.loadtxt([text for _, text in block], delimiter=",", usecols=chosen, comments=None, ndmin=2)
        except ValueError:
            pass  # some cell is to blame: looked for below
        else:
            if np.all(np.isfinite(values)):
                return values
    return np.array([_row(path, line, header, chosen, _cells(text)) for line, text in block])


def _row(path: Path, line: int, header: list[str], chosen: list[int], cells: list[str]) -> list[float]:
    """The chosen cells of one row, with what is wrong with them."""
    if len(cells) != len(header):
        raise FileError(f"{path}, line {line}: expected {len(header)} cells as in the header row, got {len(cells)}")
    numbers = []
    for i in chosen:
        try:
            numbers.append(float(cells[i]))
        except ValueError:
            numbers.append(np.nan)
        if not np.isfinite(numbers[-1]):
            raise FileError(f"{path}, line {line}, column {header[i]!r}: expected a finite number, got {cells[i]!r}")
    return numbers


def _quoted(text: str) -> str:
    return '"' + text.replace('"', '""') + '"' if any(mark in text for mark in ',"\n\r') else text
