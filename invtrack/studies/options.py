"""The options that every study takes on its command line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import tyro

from invtrack.arguments import flag, instance, texts
from invtrack.arrays import real_number, whole_number
from invtrack.errors import SimulationError

# One flag, --quiet, instead of the pair that a bool would give.
_Flag = tyro.conf.FlagCreatePairsOff[bool]
_OffByDefault = tyro.conf.arg(help_behavior_hint="(default: off)")
_Figures = Annotated[_Flag, tyro.conf.arg(help="Draw no figures.", help_behavior_hint="(default: figures are drawn)")]


def _folder(words: Sequence[str]) -> Path:
    # Path("") is the current directory, which nobody means who writes --out "$UNSET".
    if not words[0].strip():
        raise ValueError("expected a folder such as runs/trial, got an empty name")
    return Path(words[0])


_Folder = Annotated[
    Path | None,
    tyro.constructors.PrimitiveConstructorSpec(
        nargs=1,
        metavar="DIR",
        instance_from_str=_folder,
        is_instance=lambda value: value is None or isinstance(value, Path),
        str_from_instance=lambda value: [str(value)],
    ),
]


@dataclass(frozen=True, kw_only=True)
class StudyOptions:
    """Options of every study. A study with more options of its own derives from this class, with a docstring under each."""

    out: _Folder = None
    """Folder for summary.json, recordings and figures; made if it is not there, emptied of an earlier study's files."""

    timestep: float = 1e-3
    """Largest physics step [s]."""

    case: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME")] = ()
    """Run only this case, or sweep of further points; may be given several times."""

    seed: int = 0
    """Seed of everything random, such as the sensors' noise."""

    json: Annotated[_Flag, _OffByDefault] = False
    """Print the summary as JSON in place of tables and text."""

    quiet: Annotated[_Flag, _OffByDefault] = False
    """Print no tables, no text and no progress."""

    figures: _Figures = True
    """Whether to draw figures."""

    def __post_init__(self) -> None:
        if not 0 < real_number("--timestep", self.timestep, unit="s", error=SimulationError) < math.inf:
            raise SimulationError(f"--timestep: expected a positive, finite number of seconds such as 1e-3, got {self.timestep}")
        if self.out is not None:
            instance("--out", self.out, Path, expected="the path of a folder", error=SimulationError)
        texts("--case", self.case, expected="a list of names of cases", error=SimulationError)
        for name in ("json", "quiet", "figures"):
            flag(f"--{name}", getattr(self, name), error=SimulationError)
        whole_number("--seed", self.seed, error=SimulationError)

    def that_matter(self) -> dict[str, Any]:
        """The options that change a study's numbers, those of a derived class among them, by name."""
        elsewhere = {field.name for field in fields(StudyOptions)} - {"timestep", "seed"}
        return {field.name: getattr(self, field.name) for field in fields(self) if field.name not in elsewhere}
