"""Sampled plans in files: CSV for any reader, npz for Python; both give back the same bits."""

from __future__ import annotations

import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
from numpy.typing import NDArray

from invtrack.errors import FileError, TrajectoryError
from invtrack.files import read_table, replaced_when_complete, write_table

Array = NDArray[np.float64]

TIME = "time [s]"

ORIGIN = "origin: "
"""Begins the comment in a CSV file that holds the origin."""

ARRAYS = ("u_ff", "x_ref", "y_d", "y")


@dataclass(frozen=True, eq=False)
class SampledPlan:
    """A planned trajectory at m instants: time (m,) [s], u_ff (m, p), x_ref (m, n), y_d (m, p) and planned y (m, p).

    What u_ff holds for the time after each instant is said in `notes`. names: per array its channels, with [unit] where known.
    origin: what the rows do not say of the plan that they come from, its linear model included, as JSON.

    Raises TrajectoryError where shapes do not fit.
    """

    time: Array
    u_ff: Array
    x_ref: Array
    y_d: Array
    y: Array
    names: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...] = field(default=())
    origin: str = ""

    def __post_init__(self) -> None:
        if self.time.ndim != 1 or set(self.names) != set(ARRAYS):
            raise TrajectoryError(
                f"expected times (m,) and names for {', '.join(ARRAYS)}, got {self.time.shape} and {list(self.names)}"
            )
        for array in ARRAYS:
            expected, shape = (len(self.time), len(self.names[array])), getattr(self, array).shape
            if shape != expected:
                raise TrajectoryError(f"{array} has shape {shape}, expected {expected} for its times and names")

    def equals(self, other: SampledPlan) -> bool:
        """Bit-for-bit equality of numbers, and equality of names, notes and origin."""
        same_text = (dict(self.names), self.notes, self.origin) == (dict(other.names), other.notes, other.origin)
        return same_text and all(
            getattr(self, name).shape == getattr(other, name).shape
            and getattr(self, name).tobytes() == getattr(other, name).tobytes()
            for name in ("time", *ARRAYS)
        )


def write_plan(plan: SampledPlan, path: str | Path) -> Path:
    """Write a plan in one piece: the path shows the old file or all of the new one.

    .csv: a header row ("time [s]", "u_ff.<name>", "x_ref.<name>", "y_d.<name>", "y.<name>"), the notes and the origin as comments
    behind #, rows with 17 significant digits. .npz: arrays under the same names, "<array>_names", "notes" and "origin".

    Raises FileError for another suffix, or where the file cannot be written.
    """
    path = Path(path)
    if _suffix(path) == ".csv":
        columns = [TIME, *(f"{array}.{name}" for array in ARRAYS for name in plan.names[array])]
        values = np.column_stack([plan.time, plan.u_ff, plan.x_ref, plan.y_d, plan.y])
        write_table(path, columns, values, (*plan.notes, *([ORIGIN + plan.origin] if plan.origin else [])))
        return path
    arrays: dict[str, Any] = {name: getattr(plan, name) for name in ("time", *ARRAYS)}
    arrays |= {f"{array}_names": np.array(plan.names[array], dtype=np.str_) for array in ARRAYS}
    with replaced_when_complete(path) as draft, draft.open("wb") as file:
        np.savez(file, **arrays, notes=np.array(plan.notes, dtype=np.str_), origin=np.array(plan.origin))
    return path


def read_samples(path: str | Path) -> SampledPlan:
    """The rows that `write_plan` or `export_plan` wrote, bit for bit.

    Raises FileError where the file cannot be read or holds no plan.
    """
    path = Path(path)
    return _from_csv(path) if _suffix(path) == ".csv" else _from_npz(path)


def _suffix(path: Path) -> str:
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".npz"):
        raise FileError(f"expected a plan file that ends in .csv or .npz, got {path.name!r}")
    return suffix


def _from_csv(path: Path) -> SampledPlan:
    table = read_table(path, lambda header: range(len(header)))
    owners = [column.partition(".")[0] for column in table.columns]
    expected = [TIME, *sorted(owners[1:], key=lambda owner: (*ARRAYS, owner).index(owner))]
    if owners != expected or set(owners[1:]) != set(ARRAYS):
        _refuse(path, "columns", table.columns)
    groups = {array: [i for i, owner in enumerate(owners) if owner == array] for array in ARRAYS}
    return SampledPlan(
        time=table.values[:, 0],
        **{array: table.values[:, columns] for array, columns in groups.items()},
        names={array: tuple(table.columns[i].partition(".")[2] for i in columns) for array, columns in groups.items()},
        notes=tuple(text for text in table.comments if not text.startswith(ORIGIN)),
        origin=next((text.removeprefix(ORIGIN) for text in table.comments if text.startswith(ORIGIN)), ""),
    )


def _from_npz(path: Path) -> SampledPlan:
    try:
        file = np.load(path, allow_pickle=False)
        arrays = dict(file) if isinstance(file, np.lib.npyio.NpzFile) else {}
    except OSError as error:
        raise FileError(f"cannot read {path}: {error.strerror or error}; expected a plan written by export_plan") from error
    except (zipfile.BadZipFile, EOFError, ValueError) as error:
        raise FileError(f"{path} is not a plan file: {error}") from error
    if not {"time", *ARRAYS, *(f"{array}_names" for array in ARRAYS), "notes", "origin"} <= arrays.keys():
        _refuse(path, "arrays", list(arrays))
    return SampledPlan(
        time=arrays["time"],
        **{array: arrays[array] for array in ARRAYS},
        names={array: tuple(arrays[f"{array}_names"].tolist()) for array in ARRAYS},
        notes=tuple(arrays["notes"].tolist()),
        origin=str(arrays["origin"]),
    )


def _refuse(path: Path, what: str, found: Sequence[str]) -> NoReturn:
    raise FileError(
        f"{path} is not a plan file: expected {what} time, {', '.join(ARRAYS)} as export_plan writes them, got: {', '.join(found)}"
    )
