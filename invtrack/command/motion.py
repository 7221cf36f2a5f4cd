"""The options that say what a mechanism is to do."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from invtrack.command.limits import stated_limits
from invtrack.command.mechanism import Mechanism
from invtrack.errors import InvtrackError
from invtrack.plant import Plant
from invtrack.redesign import Limits

UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "": 1.0}


@dataclass(frozen=True, kw_only=True)
class Motion(Mechanism):
    """A mechanism, and how its outputs are to move."""

    move: Annotated[tuple[float, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="DISTANCE")] = ()
    """How far the output is to move from where it stands, in its own unit; once for each output, in their order."""

    duration: Annotated[float, tyro.conf.arg(name="in", metavar="SECONDS")] = 1.0
    """In how many seconds."""

    reference: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """Instead of --move and --in: a table of times and wanted outputs."""

    error: Annotated[str, tyro.conf.arg(metavar="SHARE")] = "1%"
    """Largest error that is acceptable, as a share of the motion: by it feedback is weighed, and as much may redesigns give up."""

    limit: Annotated[tuple[str, ...], tyro.conf.UseAppendAction, tyro.conf.arg(metavar="NAME=VALUE")] = ()
    """What an input (drive=12), its rate (drive:rate=50 per second) or an output (site:tip:x=-1:2) must never exceed: a number for
    both signs, or LOW:HIGH; may be given several times. Actuators' ranges are limits, too."""

    def limits(self, plant: Plant) -> Limits | None:
        """Of --limit; None where none is stated."""
        return stated_limits(self.limit, plant)

    def distances(self, plant: Plant) -> list[float]:
        """Of --move, one for each output."""
        if len(self.move) != len(plant.outputs):
            raise InvtrackError(f"--move: expected one distance for each of {', '.join(plant.outputs.names)}, got {len(self.move)}")
        return list(self.move)


def seconds(option: str, text: str) -> float:
    """0.005 from "5ms". Raises InvtrackError, with the option's name, for anything else."""
    found = re.fullmatch(r"\s*([0-9.eE+-]+)\s*(s|ms|us|)\s*", text)
    try:
        value = float(found[1]) * UNITS[found[2]] if found else 0.0
    except ValueError:
        value = 0.0
    if not value > 0:
        raise InvtrackError(f"{option}: expected a time such as 5ms or 0.005s, got {text!r}")
    return value


def share(option: str, text: str) -> float:
    """0.01 from "1%" or "0.01". Raises InvtrackError, with the option's name, for anything that is no share between 0 and 1."""
    number, percent, rest = text.partition("%")
    try:
        value = float(number) / (100 if percent else 1)
    except ValueError:
        value = 0.0
    if not 0 < value < 1 or rest.strip():
        raise InvtrackError(f"{option}: expected a share such as 1% or 0.01, got {text!r}")
    return value
