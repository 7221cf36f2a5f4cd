"""Checks of what users hand in that is no array: its kind, a choice among names, lists, mappings, texts and paths."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from invtrack.arrays import Refusal, shown
from invtrack.errors import FileError

Kind = TypeVar("Kind")


def instance(name: str, value: object, kind: type[Kind] | tuple[type[Kind], ...], *, expected: str, error: Refusal) -> Kind:
    """The value, of this kind or one of these; raises `error` for anything else. `expected` says what would be right."""
    if not isinstance(value, kind):
        raise error(f"{name} must be {expected}, got {shown(value)}")
    return value


def one_of(name: str, value: object, choices: Sequence[str], *, error: Refusal) -> None:
    """Raises `error` unless the value is one of these texts."""
    if not isinstance(value, str) or value not in choices:
        raise error(f"{name} must be one of {', '.join(map(repr, choices))}, got {shown(value)}")


def flag(name: str, value: object, *, error: Refusal) -> bool:
    """The value, True or False; raises `error` for anything else."""
    return bool(instance(name, value, (bool, np.bool_), expected="True or False", error=error))


def require_text(name: str, value: object, *, error: Refusal) -> str:
    """The value, a text; raises `error` for anything else."""
    return instance(name, value, str, expected="a text", error=error)


def items(name: str, value: object, *, expected: str, error: Refusal) -> list[Any]:
    """What a list, tuple, array or other iterable holds; raises `error` for texts, mappings, sets and what cannot be listed.

    `expected` says what it is to hold: "a list of plans".
    """
    if not isinstance(value, Iterable) or isinstance(value, (str, bytes, Mapping, set, frozenset, np.ma.MaskedArray, type)):
        raise error(f"{name} must be {expected}, got {shown(value)}")
    try:
        return list(value)
    except TypeError as reason:  # iterable by its methods alone, as arrays without dimensions are
        raise error(f"{name} must be {expected}, got {shown(value)}") from reason


def texts(name: str, value: object, *, expected: str, error: Refusal) -> tuple[str, ...]:
    """The texts in a list; raises `error` for anything else, a single text among it. `expected`: "a list of names"."""
    listed = items(name, value, expected=expected, error=error)
    strange = [entry for entry in listed if not isinstance(entry, str)]
    if strange:
        raise error(f"{name} must be {expected}, got {shown(strange[0])} in it")
    return tuple(str(entry) for entry in listed)


def by_name(name: str, value: object, *, expected: str, error: Refusal) -> Mapping[str, Any]:
    """A mapping from texts; raises `error` for anything else. `expected`: "limits by the names of the inputs"."""
    mapping = instance(name, value, Mapping, expected=f"a dict of {expected}", error=error)
    strange = [key for key in mapping if not isinstance(key, str)]
    if strange:
        raise error(f"{name} must be a dict of {expected}, got {shown(strange[0])} for a name")
    return mapping


def file_path(value: object) -> Path:
    """The path of a file; raises FileError for what is none, or has no name."""
    if not isinstance(value, (str, Path)) or not str(value).strip() or not Path(value).name:
        raise FileError(f"expected the path of a file, such as 'runs/plan.csv', got {shown(value)}")
    return Path(value)
